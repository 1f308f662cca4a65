"""Excitations without rest: several sines, a pseudorandom binary sequence, one sine, a free decay."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

import numpy as np

from rigctl_validation.benches.bench import Floats

Motion: TypeAlias = Literal["multisine", "prbs", "sine", "decay"]
MOTIONS: Final[tuple[Motion, ...]] = ("multisine", "prbs", "sine", "decay")

#: sines of a multisine, and its shortest period in time constants
_SINES, _SHORTEST = 10, 4.0


def excitation(motion: Motion, samples: int, per_constant: float, rng: np.random.Generator) -> Floats:
    """A signal from −1 to 1, one value for each sample; zero for a free decay.

    Parameters
    ----------
    per_constant: samples in a time constant of the bench.
    """
    if motion == "decay":
        return np.zeros(samples)
    if motion == "prbs":
        hold = max(2, round(per_constant * rng.uniform(0.5, 2.0)))
        return np.repeat(rng.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples]
    if motion == "sine":
        periods = np.array([per_constant * rng.uniform(5.0, 20.0)])
    else:
        longest = max(0.5 * samples, 2.0 * _SHORTEST * per_constant)
        periods = np.exp(rng.uniform(np.log(_SHORTEST * per_constant), np.log(longest), _SINES))
    angles = 2.0 * np.pi * np.outer(np.arange(samples), 1.0 / periods)
    total = np.sin(angles + rng.uniform(0.0, 2.0 * np.pi, periods.size)).sum(axis=1)
    return np.asarray(total / np.abs(total).max())
