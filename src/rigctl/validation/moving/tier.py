"""The trials of the tier of moving twins."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import get_args

import numpy as np

from rigctl.validation.moving.spoiled import Spoiled
from rigctl.validation.moving.trial import MovingTrial
from rigctl.validation.moving_benches.campaign import Statement
from rigctl.validation.moving_benches.excitation import MOTIONS, Motion
from rigctl.validation.moving_benches.register import TWINS
from rigctl.validation.moving_benches.slow_noise import COLOURS

#: benches of the spoiled logs, and the motion of each
_SPOILED: tuple[tuple[str, Motion], ...] = (("spring", "multisine"), ("tanks", "prbs"), ("motor", "sine"))


def moving_trials() -> tuple[MovingTrial, ...]:
    """Every bench, motion and colour of noise, stated in every way, hiding nothing and something.

    Then logs that are spoiled. In an order in which any part of them is a fair sample of all.
    """
    trials = [*_nothing_or_hidden(), *_spoiled()]
    order = np.random.default_rng(0).permutation(len(trials))
    return tuple(trials[int(i)] for i in order)


def _nothing_or_hidden() -> Iterator[MovingTrial]:
    seed = 0
    for name, motion in product(TWINS, MOTIONS):
        twin = TWINS[name]
        if motion == "decay" and not twin.decay:
            continue
        acting = [each.name for each in twin.hidden if not each.only or motion in each.only]
        for colour, stated in product(COLOURS, range(3)):
            statement = _statement(stated, seed)
            seed += 1
            yield MovingTrial(name, motion, "", colour, statement, seed)
            yield MovingTrial(name, motion, acting[seed % len(acting)], colour, statement, 10_000 + seed)


def _statement(turn: int, seed: int) -> Statement:
    """Unstated, stated, or wrongly stated: in turn five times too small and too large."""
    wrong: tuple[Statement, Statement] = ("too small", "too large")
    return ("unstated", "stated", wrong[seed // 3 % 2])[turn]


def _spoiled() -> Iterator[MovingTrial]:
    kinds: tuple[Spoiled, ...] = tuple(kind for kind in get_args(Spoiled) if kind)
    for seed, (kind, (bench, motion)) in enumerate(product(kinds, _SPOILED)):
        yield MovingTrial(bench, motion, seed=20_000 + seed, spoiled=kind)
