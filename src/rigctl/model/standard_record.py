"""One record of each family in which every effect of its library shows: what an effect is drawn on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rigctl.engine.excitation import Excitation
from rigctl.engine.system import System
from rigctl.errors import RigctlError
from rigctl.physics.family import ModelFamily


@dataclass(frozen=True)
class StandardRecord:
    """What is commanded, and when.

    Attributes
    ----------
    description: for people.
    times: of the samples, in s.
    switches: times and the inputs that change at each, SI; what is not named keeps its value, at first the
        family's usual one.
    initial: of the states that do not start as the family's usually do, SI.
    """

    description: str
    times: tuple[float, ...]
    switches: tuple[tuple[float, Mapping[str, float]], ...]
    initial: Mapping[str, float]

    def excitation(
        self, family: ModelFamily, system: System, parameters: Sequence[float], own: Mapping[str, float]
    ) -> Excitation:
        """The record for a system of `family`; `own` are the starts of its effects' states."""
        start = {state.name: state.start for state in family.states} | dict(own) | dict(self.initial)
        given = {item.name: item.value for item in family.inputs}
        rows = []
        for _, changed in self.switches:
            given |= changed
            rows.append([given[name] for name in system.input_names])
        return Excitation(
            times=np.array(self.times),
            switch_times=np.array([time for time, _ in self.switches]),
            inputs=np.array(rows),
            initial=np.array([start[name] for name in system.state_names]),
            parameters=np.array(parameters),
            name="standard record",
        )


def _grid(end: float, step: float, first: float = 0.0) -> tuple[float, ...]:
    return tuple(first + step * index for index in range(round((end - first) / step) + 1))


#: hot oil and the largest supply pressure of the published campaign: leakage, drift and the pump's limit show
_STROKE = StandardRecord(
    "wait 0.2 s, extend 1.05 s, hold closed 1 s, retract 1.5 s; oil at 60 degC, supply at 50 bar, heaters on",
    times=_grid(3.75, 0.01),
    switches=(
        (
            0.0,
            {"valve": 0.0, "heater_power": 2000.0, "pressure_setpoint": 50e5, "ambient_temperature": 295.15},
        ),
        (0.2, {"valve": 1.0}),
        (1.25, {"valve": 0.0}),
        (2.25, {"valve": -1.0}),
    ),
    initial={"oil_temperature": 333.15, "supply_pressure": 50e5, "pressure_b": 45e5},
)

_HEATERS = StandardRecord(
    "heater 1 at 80 %, after 10 min heater 2 at 40 %, both off after 20 min, until 30 min; room at 23 degC",
    times=_grid(1800.0, 5.0),
    switches=(
        (0.0, {}),
        (30.0, {"heater_1": 0.8}),
        (600.0, {"heater_2": 0.4}),
        (1200.0, {"heater_1": 0.0, "heater_2": 0.0}),
    ),
    initial={},
)

_TEMPERATURES = tuple(273.15 + 5.0 * index for index in range(21))
_PRESSURES = (0.0, 300e5)

#: each row of the table lasts a second and is read in its middle
_TABLE = StandardRecord(
    "0 to 100 degC in steps of 5, at 0 and then at 300 bar, a row each second",
    times=_grid(len(_TEMPERATURES) * len(_PRESSURES) - 0.5, 1.0, 0.5),
    switches=tuple(
        (float(row), {"oil_temperature": temperature, "pressure": pressure})
        for row, (pressure, temperature) in enumerate((p, t) for p in _PRESSURES for t in _TEMPERATURES)
    ),
    initial={},
)

STANDARD_RECORDS: Mapping[str, StandardRecord] = MappingProxyType(
    {"hydraulic_cylinder": _STROKE, "heater_board": _HEATERS, "oil_viscosity": _TABLE}
)


def standard_record(family: str) -> StandardRecord:
    """The standard record of a model family.

    Raises
    ------
    RigctlError
        the family has none.
    """
    if family not in STANDARD_RECORDS:
        raise RigctlError(
            "this family of models has no standard record",
            value=family,
            expected=f"one of {', '.join(STANDARD_RECORDS)}",
        )
    return STANDARD_RECORDS[family]
