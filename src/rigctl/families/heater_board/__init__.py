"""Two heaters with a thermometer each, on one board.

``C * dT1/dt = P1 - U * (T1 - Ta)``, and the same for the second: one lump each, no coupling. Temperatures are
in K, heater commands from 0 to 1.

Source: Incropera & DeWitt, Fundamentals of Heat and Mass Transfer, lumped capacitance; the board is the
two-heater temperature control lab used in teaching.
"""
