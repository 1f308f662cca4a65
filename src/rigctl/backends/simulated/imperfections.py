"""What makes a simulated bench behave like a real one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from rigctl.backends.simulated.faults import Fault


class Purpose(IntEnum):
    """What random numbers are for; each purpose has a stream of its own, so that none disturbs another."""

    SENSORS = 0
    SETTINGS = 1


@dataclass(frozen=True)
class Imperfections:
    """Noise, scatter and faults; everything random follows from `seed`.

    Parameters
    ----------
    seed: of every random number.
    noise: whether sensors are noisy.
    quantised: whether converters have a finite number of codes.
    scatter: by actuator, the relative standard deviation of what it is really set to each time.
    answer_delay: s until the operator has turned what is worked by hand.
    faults: what breaks, and when.
    """

    seed: int = 0
    noise: bool = True
    quantised: bool = True
    scatter: Mapping[str, float] = field(default_factory=dict)
    answer_delay: float = 0.0
    faults: tuple[Fault, ...] = ()

    def generator(self, purpose: Purpose) -> np.random.Generator:
        """The random numbers for one purpose."""
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, purpose])))
