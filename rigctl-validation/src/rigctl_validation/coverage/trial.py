"""One trial of the tier of coverage: a moving twin, and what is wrong with its sensors and its model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from rigctl_validation.coverage.misread import KINDS, WRITTEN, Kind, Misread, Written
from rigctl_validation.moving.trial import MovingTrial
from rigctl_validation.moving_benches.excitation import MOTIONS, Motion
from rigctl_validation.moving_benches.register import TWINS

_FIRST_SEED = 50_000


@dataclass(frozen=True)
class CoverageTrial:
    """A record of a moving twin with white noise, which the rig file states; fixes everything.

    Attributes
    ----------
    bench, motion, hidden, seed: see `MovingTrial`.
    kind, written: of the calibration of every channel, and how it is stated, see `Misread`.
    assumed: one number of the model is a guess.
    """

    bench: str
    motion: Motion
    hidden: str = ""
    kind: Kind = "line"
    written: Written = "parts"
    assumed: bool = False
    seed: int = 0

    @property
    def moving(self) -> MovingTrial:
        """The twin's record with right sensors."""
        return MovingTrial(self.bench, self.motion, self.hidden, "white", "stated", self.seed)

    @property
    def misread(self) -> Misread:
        """What is wrong with it."""
        return Misread(self.moving.campaign, self.kind, self.written, self.assumed)

    @property
    def name(self) -> str:
        """All of it in one line, unique: ``spring prbs, dry friction, line by parts, a guess, seed 3``."""
        hidden, guess = self.hidden or "nothing hidden", ", a guess" if self.assumed else ""
        return f"{self.bench} {self.motion}, {hidden}, {self.kind} by {self.written}{guess}, seed {self.seed}"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer."""
        return self.moving.truth

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> CoverageTrial:
        """The trial that `document` describes."""
        return cls(**document)


def coverage_trials() -> tuple[CoverageTrial, ...]:
    """Every bench, motion and kind of calibration, with and without a guess, hiding nothing and something.

    In an order in which any part of them is a fair sample of all.
    """
    trials = list(_every())
    return tuple(trials[int(i)] for i in np.random.default_rng(1).permutation(len(trials)))


def _every() -> Iterator[CoverageTrial]:
    turns = product(TWINS, MOTIONS, KINDS, WRITTEN, (False, True))
    for turn, (name, motion, kind, written, assumed) in enumerate(turns):
        if not TWINS[name].moves(motion):
            continue
        acting = TWINS[name].acting(motion)
        for hidden in ("", acting[turn % len(acting)]):
            yield CoverageTrial(
                name, motion, hidden, kind, written, assumed, _FIRST_SEED + 2 * turn + bool(hidden)
            )
