"""One trial on a small bench: the hidden effect and its size, sampling, recorded inputs and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from rigctl_validation.benches.bench import BenchCampaign, Noise, Sampling, SmallBench
from rigctl_validation.benches.register import find_bench


@dataclass(frozen=True)
class BenchTrial:
    """A campaign on a small bench; fixes everything except the amplitude.

    Attributes
    ----------
    bench: its name.
    size: λ of the hidden effect, in sigmas; 0 for none.
    sampling, recorded, noise, seed: see `BenchCampaign`.
    """

    bench: str
    size: float = 0.0
    sampling: Sampling = "fast"
    recorded: bool = True
    noise: Noise = "white"
    seed: int = 0

    @property
    def name(self) -> str:
        """All of it in one line, unique: ``motor 30 fast recorded white seed 3``."""
        recorded = "recorded" if self.recorded else "unrecorded"
        return f"{self.bench} {self.size:g} {self.sampling} {recorded} {self.noise} seed {self.seed}"

    @cached_property
    def _bench(self) -> SmallBench:
        return find_bench(self.bench)

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer."""
        return self._bench.hidden.counts_as if self.size else ()

    def campaign(self, amplitude: float) -> BenchCampaign:
        """The campaign that hides its effect with this amplitude."""
        return BenchCampaign(self._bench, amplitude, self.sampling, self.recorded, self.noise, self.seed)

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""
        return asdict(self)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> BenchTrial:
        """The trial that `document` describes."""
        return cls(**document)
