"""The viscosity of an oil over temperature and pressure, as a table of measurements: Vogel's law and density.

There is no motion, and so no state: each row of a table lasts a second.
"""
