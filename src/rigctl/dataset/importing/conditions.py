"""The operating points of imported records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigctl.units import parse_unit

if TYPE_CHECKING:
    from rigctl.rig import Rig
    from rigctl.rig.layout import Layout


@dataclass(frozen=True)
class Conditions:
    """The columns that define the condition of a record, and how.

    Parameters
    ----------
    medians: defined by their median over the record.
    levels: commands, defined by their constant value in the record.
    starts: defined by their value at the record's start.
    clustered: those that are temperatures, which are equal within 1 K.
    """

    medians: tuple[str, ...] = ()
    levels: tuple[str, ...] = ()
    starts: tuple[str, ...] = ()
    clustered: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.medians, *self.levels, *self.starts)


def conditions_of(layout: Layout, rig: Rig) -> Conditions:
    """Return the controlled temperature and pressure of the rig, if the file has them.

    For a rig that controls neither, the conditions are its commands and the temperatures at the start of a
    record: two records that cool down from different temperatures are not replicates.
    """
    heat, pressure = rig.roles.heat, rig.roles.set_pressure
    temperature = heat.channel if heat is not None else "oil_temperature"
    setpoint = pressure.actuator if pressure is not None else "pressure_setpoint"
    medians = tuple(name for name in (temperature, setpoint) if name in layout.columns)
    if medians:
        return Conditions(medians=medians, clustered=tuple(name for name in medians if name == temperature))
    kelvin = parse_unit("K").dimension
    starts = tuple(
        name
        for name in layout.channels
        if parse_unit(layout.unit(name)).dimension == kelvin and name not in layout.differences
    )
    return Conditions(levels=layout.commands, starts=starts, clustered=starts)
