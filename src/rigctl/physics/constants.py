"""Constants of nature and of convention, in SI."""

#: 0 degC in K
ZERO_CELSIUS = 273.15
#: the standard atmosphere in Pa; gauge pressures count from it
ATMOSPHERE = 1.01325e5
#: the Stefan-Boltzmann constant in W/(m^2*K^4), CODATA 2018
STEFAN_BOLTZMANN = 5.670374419e-8
