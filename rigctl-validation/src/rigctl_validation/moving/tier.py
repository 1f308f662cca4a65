"""The trials of the tier of moving twins."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import get_args

import numpy as np

from rigctl_validation.moving.spoiled import Spoiled
from rigctl_validation.moving.trial import MovingTrial
from rigctl_validation.moving_benches.campaign import Statement
from rigctl_validation.moving_benches.excitation import MOTIONS, Motion
from rigctl_validation.moving_benches.register import TWINS
from rigctl_validation.moving_benches.slow_noise import COLOURS, Colour

#: benches of the spoiled logs, and the motion of each
_SPOILED: tuple[tuple[str, Motion], ...] = (("spring", "multisine"), ("tanks", "prbs"), ("motor", "sine"))


def moving_trials() -> tuple[MovingTrial, ...]:
    """Every bench, motion and colour of noise, stated in every way, hiding nothing and something.

    Noise that is not stated comes twice: its rates matter most for a bench that never rests. Then logs that
    are spoiled. In an order in which any part of them is a fair sample of all.
    """
    trials = [*_every_statement(), *_unstated_again(), *_spoiled()]
    order = np.random.default_rng(0).permutation(len(trials))
    return tuple(trials[int(i)] for i in order)


def _every_statement() -> Iterator[MovingTrial]:
    seed = 0
    for name, motion, colour in _benches():
        for stated in range(3):
            statement = _statement(stated, seed)
            seed += 1
            yield from _nothing_or_hidden(name, motion, colour, statement, seed)


def _unstated_again() -> Iterator[MovingTrial]:
    for turn, (name, motion, colour) in enumerate(_benches()):
        yield from _nothing_or_hidden(name, motion, colour, "unstated", 30_000 + turn)


def _benches() -> Iterator[tuple[str, Motion, Colour]]:
    for name, motion in product(TWINS, MOTIONS):
        if TWINS[name].moves(motion):
            yield from ((name, motion, colour) for colour in COLOURS)


def _nothing_or_hidden(
    name: str, motion: Motion, colour: Colour, statement: Statement, seed: int
) -> Iterator[MovingTrial]:
    acting = TWINS[name].acting(motion)
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
