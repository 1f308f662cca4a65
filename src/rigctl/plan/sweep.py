"""The points of a sweep: lists, even spacing, nesting, pairing, repetition and a seeded order."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from math import floor, prod

from rigctl.errors import RigctlError
from rigctl.plan.values import with_value
from rigctl.units import Quantity

Point = dict[str, Quantity]

#: `to` counts as reached if the last value misses it by less than this fraction of a step
_SLACK = 1e-9


def stepped(first: Quantity, stop: float, step: float, allow: Callable[[int], None]) -> list[Quantity]:
    """Return ``first, first + step, …``, up to `stop` at most, in the unit of `first`.

    Raises
    ------
    RigctlError
        the step is zero or leads away from `stop`, or `allow` refuses this number of values.
    """
    if step == 0.0:
        raise RigctlError("the step of a range is zero", value=str(with_value(first, step)))
    count = (stop - first.value) / step + _SLACK
    if count < 0.0:
        raise RigctlError(
            "the step leads away from 'to'",
            value=f"{step:g} {first.unit.text}".strip(),
            expected="a negative step" if step > 0.0 else "a positive step",
        )
    allow(int(min(count, 1e12)) + 1)
    return [with_value(first, first.value + index * step) for index in range(floor(count) + 1)]


def spaced(first: Quantity, stop: float, count: int) -> list[Quantity]:
    """Return `count` evenly spaced values from `first` to `stop`, both included; a single one is `first`.

    Raises
    ------
    RigctlError
        `count` is less than one.
    """
    if count < 1:
        raise RigctlError("this sweep is empty", value=str(count), expected="a count of at least 1")
    width = (stop - first.value) / (count - 1) if count > 1 else 0.0
    return [with_value(first, first.value + index * width) for index in range(count)]


def combine(axes: Mapping[str, Sequence[Quantity]], allow: Callable[[int], None]) -> list[Point]:
    """Return all combinations, with the first variable changing most slowly."""
    allow(prod(len(values) for values in axes.values()))
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def paired(axes: Mapping[str, Sequence[Quantity]]) -> list[Point]:
    """Return points of corresponding values: the first value of every list, then the second ones, and so on.

    Raises
    ------
    RigctlError
        the lists differ in length.
    """
    lengths = {name: len(values) for name, values in axes.items()}
    if len(set(lengths.values())) > 1:
        raise RigctlError(
            "paired sweeps need lists of one length",
            value=", ".join(f"{name} has {length}" for name, length in lengths.items()),
        )
    return [dict(zip(axes, values, strict=True)) for values in zip(*axes.values(), strict=True)]


def repeated(points: Sequence[Point], times: int) -> list[Point]:
    """Return all points `times` times, so that replicates are one whole sweep apart in time."""
    return list(points) * times


def shuffled(points: Sequence[Point], seed: int, path: str) -> list[Point]:
    """Return the points in a random order determined by the seed (Fisher-Yates shuffle, Mersenne Twister).

    `path` is the path of the sweep in the plan: an inner sweep has a different order at each point of the
    outer one, so that an effect of the order is not mistaken for one of the outer variable. Python guarantees
    the sequence of `random()` for a seed across versions, so only that method is used.
    """
    order = list(points)
    draw = random.Random(f"{seed}:{path}").random  # noqa: S311 - an order, not a secret
    for index in range(len(order) - 1, 0, -1):
        other = int(draw() * (index + 1))
        order[index], order[other] = order[other], order[index]
    return order
