"""The viscosity of an oil over temperature and pressure, as a table of measurements: Vogel's law and density.

There is no motion: the family's one state counts the rows of the table, a second each.
"""

from rigctl.physics.oil_viscosity.family import OIL_VISCOSITY

__all__ = ["OIL_VISCOSITY"]
