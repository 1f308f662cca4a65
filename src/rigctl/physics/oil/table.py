"""The oil's properties as functions of temperature and pressure, as a table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.physics.oil.oils import Oil

_MOST_ROWS = 100_000


@dataclass(frozen=True)
class OilRow:
    """The oil at one temperature (K) and gauge pressure (Pa): kg/m^3, m^2/s, Pa*s."""

    temperature: float
    pressure: float
    density: float
    kinematic_viscosity: float
    dynamic_viscosity: float


def oil_table(
    oil: Oil, temperatures: Iterable[float], pressures: Iterable[float] = (0.0,), law: str = "barus"
) -> tuple[OilRow, ...]:
    """Every combination of temperature (K) and gauge pressure (Pa), pressure running fastest.

    Raises
    ------
    RigctlError
        the law is unknown, a temperature is below the pole of Vogel's law, or there are too many rows.
    """
    at_pressures = tuple(pressures)
    at_temperatures = tuple(temperatures)
    if len(at_temperatures) * len(at_pressures) > _MOST_ROWS:
        raise RigctlError(
            "the table is too long",
            value=f"{len(at_temperatures)} x {len(at_pressures)} rows",
            expected=f"at most {_MOST_ROWS}",
        )
    return tuple(_row(oil, t, p, law) for t in at_temperatures for p in at_pressures)


def _row(oil: Oil, temperature: float, pressure: float, law: str) -> OilRow:
    dynamic = oil.dynamic_viscosity(temperature, pressure, law)
    density = oil.density(temperature)
    return OilRow(temperature, pressure, density, dynamic / density, dynamic)
