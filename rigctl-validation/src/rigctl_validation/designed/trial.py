"""One trial of the tier ``design``, and which trials it consists of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from rigctl_validation.scenario import Scenario, Wanted

#: λ of the hidden effect in the first campaign: from hardly detectable to distinguished from its twins
SIZES = (10.0, 20.0, 40.0)
_SEEDS, _FIRST_SEED = 3, 70_000
#: sets of records at random for each first campaign, the first of one record
_DRAWS = 4
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
    """A learning loop on the separate bench; fixes everything except the amplitudes.

    Attributes
    ----------
    hidden: one or two effects; `size` the λ of each in the first campaign, in sigmas.
    rounds: largest number, including the first.
    taken: number of records at random points instead of a designed set; 0 for the designed set.
    draw: index of the random set.
    """

    hidden: tuple[str, ...]
    size: float
    rounds: int = 2
    seed: int = 0
    taken: int = 0
    draw: int = 0

    @property
    def name(self) -> str:
        """All of it in one line, unique."""
        text = f"{' '.join(self.hidden)} {self.size:g} {self.rounds} rounds seed {self.seed}"
        return f"{text} random {self.taken} draw {self.draw}" if self.taken else text

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of the hidden effects."""
        return self.hidden

    @cached_property
    def scenario(self) -> Scenario:
        """The first campaign as a scenario of the other tiers, in which sizes are measured."""
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
        """The trial that `document` describes."""
        return cls(**{**document, "hidden": tuple(document["hidden"])})


def design_trials() -> tuple[DesignTrial, ...]:
    """Every twin at every size, and as many with records at random instead of a designed set; in an order in
    which any part is a fair sample of all."""
    designed, at_random = _mixed([*_twins(), *_learning_trials()], 0), _mixed([*_at_random()], 1)
    both = zip_longest(designed, at_random)
    return tuple(one for pair in both for one in pair if one is not None)


def _mixed(trials: Sequence[DesignTrial], seed: int) -> list[DesignTrial]:
    return [trials[int(k)] for k in np.random.default_rng(seed).permutation(len(trials))]


def _at_random() -> Iterator[DesignTrial]:
    """First campaigns again, continued with one to four records at random points; at the largest size most
    campaigns leave no question open."""
    for one in _twins():
        if one.seed == _FIRST_SEED and one.size < SIZES[-1]:
            for draw in range(_DRAWS):
                yield replace(one, taken=1 + draw, draw=draw)


def _twins() -> Iterator[DesignTrial]:
    """One designed set each: the first campaign and one round."""
    for name in TWINS:
        for size in SIZES:
            for seed in range(_SEEDS):
                yield DesignTrial((name,), size, seed=_FIRST_SEED + seed)


def _learning_trials() -> Iterator[DesignTrial]:
    """Learning to its end."""
    for k, pair in enumerate(_PAIRS):
        for size in SIZES[1:]:
            yield DesignTrial(pair, size, rounds=6, seed=71_000 + k)
    for k, name in enumerate(TWINS):
        yield DesignTrial((name,), SIZES[k % len(SIZES)], rounds=6, seed=72_000 + k)
