"""Imperfections that make a simulated bench behave like a real one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from rigctl.backends.simulated.faults import Fault


class Purpose(IntEnum):
    """What random numbers are drawn for; each purpose has its own stream, so that none affects another."""

    SENSORS = 0
    SETTINGS = 1


@dataclass(frozen=True)
class Imperfections:
    """Noise, scatter and faults of a simulated bench.

    Parameters
    ----------
    seed: determines all random numbers.
    noise: whether the sensors are noisy.
    quantised: whether the readings are quantised by the converters.
    scatter: by actuator, the relative standard deviation of its actual setting about the commanded one.
    answer_delay: response time of the simulated operator, s.
    faults: the faults and their times.
    """

    seed: int = 0
    noise: bool = True
    quantised: bool = True
    scatter: Mapping[str, float] = field(default_factory=dict)
    answer_delay: float = 0.0
    faults: tuple[Fault, ...] = ()

    def generator(self, purpose: Purpose) -> np.random.Generator:
        """Return the random generator for one purpose."""
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, purpose])))
