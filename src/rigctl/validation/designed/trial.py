"""One trial of the tier ``design``, and which trials it consists of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rigctl.validation.scenario import Scenario, Wanted

#: λ of what is hidden in the first campaign: between hardly seen and told from its twins
SIZES = (10.0, 20.0, 40.0)
_SEEDS = 3
#: effects that the published campaign leaves in a class with others at one of these sizes, or nearly
TWINS = (
    "valve_leakage",
    "position_thermal_drift",
    "flow_area_thermal_drift",
    "laminar_throttle",
    "viscous_friction",
    "line_loss",
    "coulomb_friction",
    "stribeck_friction",
    "pump_slip",
    "piston_leakage",
    "cap_leakage",
    "rod_leakage",
)
#: two that are hidden together
_PAIRS = (
    ("valve_leakage", "coulomb_friction"),
    ("laminar_throttle", "valve_open_delay"),
    ("spring_load", "pump_slip"),
)
TEMPERATURES, PRESSURES = (20.0, 40.0, 60.0, 80.0), (20.0, 35.0, 50.0)


@dataclass(frozen=True)
class DesignTrial:
    """A learning on the separate bench; everything is fixed by it but the amplitudes.

    Attributes
    ----------
    hidden: one or two effects; `size` the λ of each in the first campaign, in sigmas.
    rounds: at most, the first included.
    """

    hidden: tuple[str, ...]
    size: float
    rounds: int = 2
    seed: int = 0

    @property
    def name(self) -> str:
        """All of it in one line, unique."""
        return f"{' '.join(self.hidden)} {self.size:g} {self.rounds} rounds seed {self.seed}"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of what is hidden."""
        return self.hidden

    @cached_property
    def scenario(self) -> Scenario:
        """The first campaign as the other tiers have it; sizes are measured in it."""
        return Scenario(
            kind="two" if len(self.hidden) > 1 else "one",
            hidden=tuple(Wanted(name, self.size) for name in self.hidden),
            repeated=0,
            noise_known=True,
            seed=self.seed,
            temperatures=TEMPERATURES,
            pressures=PRESSURES,
        )

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> DesignTrial:
        """The trial that `document` made."""
        return cls(**{**document, "hidden": tuple(document["hidden"])})


def design_trials() -> tuple[DesignTrial, ...]:
    """Every twin at every size; in an order in which a part is a fair sample of all."""
    found = [*_twins(), *_learnt()]
    order = np.random.default_rng(0).permutation(len(found))
    return tuple(found[int(i)] for i in order)


def _twins() -> Iterator[DesignTrial]:
    """One designed set each: the first campaign and one round."""
    for name in TWINS:
        for size in SIZES:
            for seed in range(_SEEDS):
                yield DesignTrial((name,), size, seed=70_000 + seed)


def _learnt() -> Iterator[DesignTrial]:
    """Learning to its end."""
    for k, pair in enumerate(_PAIRS):
        for size in SIZES[1:]:
            yield DesignTrial(pair, size, rounds=6, seed=71_000 + k)
    for k, name in enumerate(TWINS):
        yield DesignTrial((name,), SIZES[k % len(SIZES)], rounds=6, seed=72_000 + k)
