"""Viscosity and density of an oil as functions of temperature and pressure, in a table of measurements.

The base laws are Vogel's law and linear thermal expansion. Nothing moves, so that there is no state: each row
of the table lasts a second.
"""
