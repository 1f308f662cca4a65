"""Viscosity as a function of temperature and pressure.

Pressures are gauge. Each law takes floats, arrays or expressions.
"""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, constant_like, exp, log
from rigctl.physics.constants import ZERO_CELSIUS


def vogel(temperature: Scalar, a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """Vogel's law ``mu0 = a * exp(b / (T - c))``: dynamic viscosity in Pa*s at atmospheric pressure.

    Parameters
    ----------
    temperature: T in K, above c.
    a: in Pa*s.
    b, c: in K.

    Source: Vogel (1921), Physikalische Zeitschrift 22.
    """
    return a * exp(b / (temperature - c))


def walther(temperature: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """Walther's law ``log10(log10(nu + 0.7)) = A - B * log10(T)``, nu in cSt: returns nu in m^2/s.

    Parameters
    ----------
    temperature: T in K.
    a, b: the dimensionless constants A and B.

    Source: ASTM D341, valid above 2 cSt.
    """
    kelvins = temperature / constant_like(1.0, temperature)
    ten = log(10.0)
    double_log = a - b * (log(kelvins) / ten)
    return 1e-6 * (exp(ten * exp(ten * double_log)) - 0.7)


def barus_factor(pressure: Scalar, coefficient: Scalar) -> Scalar:
    """Barus: ``mu / mu0 = exp(alpha * p)``.

    Parameters
    ----------
    pressure: p in Pa.
    coefficient: alpha in 1/Pa; about 2e-8 for mineral oils.

    Source: Barus (1893), American Journal of Science 45.
    """
    return exp(coefficient * pressure)


def modulus_coefficient(
    pressure: Scalar, temperature: Scalar, constants: tuple[Scalar, Scalar, Scalar, Scalar]
) -> Scalar:
    """``alpha(p, T) = 1 / (a1 + a2*t + (b1 + b2*t) * p)`` with t = T - 0 degC: Barus' coefficient, in 1/Pa.

    Parameters
    ----------
    pressure: p in Pa.
    temperature: T in K.
    constants: a1 in Pa, a2 in Pa/K, b1, b2 in 1/K; for HM oils about 334 bar, 3.2557 bar/K, 0.026266,
        0.000315/K.

    Source: Knezevic & Savic, Facta Universitatis, Mechanical Engineering 4(1) (2006).
    """
    a1, a2, b1, b2 = constants
    t = temperature - constant_like(ZERO_CELSIUS, temperature)
    return 1.0 / (a1 + a2 * t + (b1 + b2 * t) * pressure)


def modulus_factor(
    pressure: Scalar, temperature: Scalar, constants: tuple[Scalar, Scalar, Scalar, Scalar]
) -> Scalar:
    """The modulus equation: ``mu / mu0 = exp(alpha(p, T) * p)``, see `modulus_coefficient`."""
    return exp(modulus_coefficient(pressure, temperature, constants) * pressure)


def kinematic_viscosity(dynamic: Scalar, density: Scalar) -> Scalar:
    """``nu = mu / rho`` in m^2/s; 1 cSt is 1e-6 m^2/s.

    Parameters
    ----------
    dynamic: mu in Pa*s.
    density: rho in kg/m^3.
    """
    return dynamic / density


def walther_constants(
    temperature_1: float, kinematic_1: float, temperature_2: float, kinematic_2: float
) -> tuple[float, float]:
    """A and B of `walther` through two points, temperatures in K, viscosities in m^2/s.

    Source: ASTM D341.
    """
    ten = log(10.0)

    def double_log(kinematic: float) -> float:
        return log(log(kinematic / 1e-6 + 0.7) / ten) / ten

    slope = (double_log(kinematic_1) - double_log(kinematic_2)) / (log(temperature_2 / temperature_1) / ten)
    return double_log(kinematic_1) + slope * log(temperature_1) / ten, slope
