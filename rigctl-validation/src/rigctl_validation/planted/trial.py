"""One trial of the tier ``discovery``, and which trials it consists of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rigctl_validation.planted.terms import PLANTED
from rigctl_validation.scenario import NoiseVariant, Scenario

#: λ of the planted term
SIZES = (50.0, 150.0)
_NOTHING = 10
#: the noise variants with which terms are planted, and the conditions of the campaign
_NOISES: tuple[NoiseVariant, ...] = ("white", "coloured", "ten_bits")
_TEMPERATURES, _PRESSURES = (20.0, 40.0, 60.0, 80.0), (20.0, 35.0, 50.0)
_REPEATED = 4


@dataclass(frozen=True)
class PlantedTrial:
    """A campaign on the separate bench; fixes everything except the amplitude.

    Attributes
    ----------
    term: the planted term, "" for none; `size` its λ, in sigmas.
    sign: its direction.
    noise, chamber_pressures, seed: as in a `Scenario`.
    """

    term: str = ""
    size: float = 0.0
    sign: int = 1
    noise: NoiseVariant = "white"
    chamber_pressures: bool = False
    seed: int = 0

    @property
    def name(self) -> str:
        """A unique description in one line."""
        what = f"{self.term}{'+' if self.sign > 0 else '-'}{self.size:g}" if self.term else "nothing"
        chambers = "chambers " if self.chamber_pressures else ""
        return f"{what} {self.noise} {chambers}seed {self.seed}"

    @property
    def truth(self) -> tuple[str, ...]:
        """Name of the planted term."""
        return (self.term,) if self.term else ()

    @cached_property
    def scenario(self) -> Scenario:
        """The campaign without the term."""
        return Scenario(
            kind="nothing",
            noise=self.noise,
            chamber_pressures=self.chamber_pressures,
            repeated=_REPEATED,
            seed=self.seed,
            temperatures=_TEMPERATURES,
            pressures=_PRESSURES,
        )

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> PlantedTrial:
        """The inverse of `document`."""
        return cls(**document)


def planted_trials() -> tuple[PlantedTrial, ...]:
    """Every term at every size, and no term; in an order in which any first part is a fair sample."""
    trials = [*_planted(), *_nothing()]
    order = np.random.default_rng(0).permutation(len(trials))
    return tuple(trials[int(i)] for i in order)


def _planted() -> Iterator[PlantedTrial]:
    for index, term in enumerate(PLANTED):
        for row, size in enumerate(SIZES):
            yield PlantedTrial(
                term=term.name,
                size=size,
                sign=term.signs[row % len(term.signs)],
                noise=_NOISES[(index + row) % len(_NOISES)],
                chamber_pressures=bool((index + row) % 2),
                seed=60_000 + row,
            )


def _nothing() -> Iterator[PlantedTrial]:
    for seed in range(_NOTHING):
        yield PlantedTrial(
            noise=_NOISES[seed % len(_NOISES)], chamber_pressures=bool(seed % 2), seed=61_000 + seed
        )
