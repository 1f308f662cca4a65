"""The trials of the tier of small benches."""

from __future__ import annotations

from itertools import product

import numpy as np

from rigctl_validation.benches.bench import NOISES, SAMPLES
from rigctl_validation.benches.register import BENCHES
from rigctl_validation.small_benches.trial import BenchTrial

#: λ of the hidden effect: one that is surely detectable, and one visible in a plot
SIZES = (30.0, 100.0)
_SEEDS = 2


def bench_trials() -> tuple[BenchTrial, ...]:
    """Every bench with every sampling, noise and set of recorded inputs, hiding nothing and hiding something.

    In an order in which any part of them is a fair sample of all: each round of twenty has every bench once
    with something hidden and once with nothing, the rest drawn at random.
    """
    rng = np.random.default_rng(0)
    settings = list(product(SAMPLES, (True, False), NOISES, range(_SEEDS)))
    queues: list[list[BenchTrial]] = []
    for name in BENCHES:
        nothing = [BenchTrial(name, 0.0, s, r, n, seed) for s, r, n, seed in settings]
        hidden = [
            BenchTrial(name, SIZES[(index // _SEEDS + seed) % len(SIZES)], s, r, n, 100 + seed)
            for index, (s, r, n, seed) in enumerate(settings)
        ]
        queues += [[row[int(i)] for i in rng.permutation(len(row))] for row in (nothing, hidden)]
    trials: list[BenchTrial] = []
    for turn in range(len(settings)):
        trials += [queues[int(i)][turn] for i in rng.permutation(len(queues))]
    return tuple(trials)
