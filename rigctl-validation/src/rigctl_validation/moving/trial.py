"""One trial on a moving twin: its motion, what it hides, its noise, and what the rig file states of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rigctl_validation.moving.spoiled import Spoiled
from rigctl_validation.moving_benches.campaign import MovingCampaign, Statement
from rigctl_validation.moving_benches.excitation import Motion
from rigctl_validation.moving_benches.register import find_twin
from rigctl_validation.moving_benches.slow_noise import Colour

#: what the best fit without the hidden effect leaves, in sigmas of the white noise
LEAST_LEFT, MOST_LEFT = 3.0, 15.0


@dataclass(frozen=True)
class MovingTrial:
    """A record of a moving twin; fixes everything.

    Attributes
    ----------
    bench, motion, colour, statement, seed: see `MovingCampaign`.
    hidden: name of what it hides; "" for nothing.
    spoiled: what is wrong with the log or the rig file; "" for nothing.
    """

    bench: str
    motion: Motion
    hidden: str = ""
    colour: Colour = "white"
    statement: Statement = "unstated"
    seed: int = 0
    spoiled: Spoiled = ""

    @property
    def name(self) -> str:
        """All of it in one line, unique: ``spring prbs, dry friction, ar noise stated, seed 3``."""
        hidden = self.hidden or "nothing hidden"
        spoiled = f", {self.spoiled}" if self.spoiled else ""
        noise = f"{self.colour} noise {self.statement}"
        return f"{self.bench} {self.motion}, {hidden}, {noise}, seed {self.seed}{spoiled}"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer."""
        return find_twin(self.bench).find(self.hidden).counts_as if self.hidden else ()

    @property
    def beside(self) -> tuple[str, ...]:
        """Names that are not wrong: where the noise drifts, so does the zero of the reading."""
        if self.colour != "drift":
            return ()
        return tuple(f"drift_of_{channel}" for channel in find_twin(self.bench).bench.noise)

    @property
    def wanted(self) -> float:
        """What the hidden effect is to leave, in sigmas of the white noise: drawn on a logarithmic scale."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(9,)))
        return float(LEAST_LEFT * (MOST_LEFT / LEAST_LEFT) ** rng.uniform())

    @property
    def campaign(self) -> MovingCampaign:
        """Its record."""
        twin = find_twin(self.bench)
        hidden = twin.find(self.hidden) if self.hidden else None
        return MovingCampaign(twin, self.motion, hidden, self.colour, self.statement, self.seed)

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> MovingTrial:
        """The trial that `document` describes."""
        return cls(**document)
