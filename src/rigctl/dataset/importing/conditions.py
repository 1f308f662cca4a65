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
    """Which columns make the condition of a record, and how.

    Parameters
    ----------
    medians: by their median over the record.
    levels: commands, by the value that they keep throughout the record.
    starts: by their value at the record's start.
    clustered: which of them are temperatures, equal when they are within 1 K.
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
    """The temperature that the rig heats and the pressure that it sets, where it does and the file has them.

    A rig that does neither is known by its commands and by the temperatures at which a record starts: a
    record that cools down is no repetition of one that cools down from elsewhere.
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
