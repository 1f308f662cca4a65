"""One trial of the tier of several devices: a campaign, and what reads it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Final, Literal, TypeAlias, get_args

from rigctl_validation.bench.devices import Device
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.scenario import Scenario, Wanted

#: one device; several, whose ages have been measured; or several, of which one is older than anybody knows
Reading: TypeAlias = Literal["one", "several", "shifted"]

#: the devices of a split bench, and how well the age of each has been measured, 95 %, s
DEVICES: Final[Mapping[Device, float]] = {
    Device("daq", ("position",), rate=100.0, age=0.012): 2e-3,
    Device("plant", ("supply_pressure",), rate=50.0, age=0.06, phase=0.003): 5e-3,
    Device("logger", ("pressure_a", "pressure_b"), rate=100.0, age=0.03, phase=0.007): 3e-3,
    Device("meter", ("oil_temperature",), rate=10.0, age=0.25, phase=0.041): 2e-2,
}
#: where the age of the first of them has not been measured: what is stated of its clock, 95 %, s
UNMEASURED: Final = 0.025

#: a few strokes that show each of these effects
_TEMPERATURES, _PRESSURES, _REPEATED = (20.0, 80.0), (20.0, 50.0), 1
_SIZE = 30.0
_HIDDEN = (
    "coulomb_friction",
    "valve_open_delay",
    "piston_leakage",
    "laminar_throttle",
    "relief_thermal_drift",
    "spring_load",
    "position_backlash",
    "entrained_air",
)
_FIRST_SEED = 70_000


@dataclass(frozen=True)
class DevicesTrial:
    """A campaign as it is read by one device or by several; fixes everything except the amplitude."""

    scenario: Scenario
    reading: Reading

    @property
    def name(self) -> str:
        """All of it in one line, unique."""
        return f"{self.scenario.name}, {self.reading}"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer."""
        return self.scenario.truth

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return {"scenario": self.scenario.document(), "reading": self.reading}

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> DevicesTrial:
        """The trial that `document` describes."""
        return cls(Scenario.read(document["scenario"]), document["reading"])


def devices_trials() -> tuple[DevicesTrial, ...]:
    """Every campaign in each reading, one after the other, so that any part of the tier compares them."""
    return tuple(DevicesTrial(*pair) for pair in product(_scenarios(), get_args(Reading)))


def _scenarios() -> Iterator[Scenario]:
    for turn, effect in enumerate(_HIDDEN):
        # nothing is hidden as often as something, with few and with many channels in turn
        for hidden in ((Wanted(effect, _SIZE, find_hidden(effect).signs[0]),), ()):
            yield Scenario(
                "one" if hidden else "nothing",
                hidden,
                chamber_pressures=bool(turn % 2),
                repeated=_REPEATED,
                seed=_FIRST_SEED + turn,
                temperatures=_TEMPERATURES,
                pressures=_PRESSURES,
            )
