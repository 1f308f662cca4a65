"""The noise of a measured input's readings, where the readings alone tell it from motion.

A command is known exactly, and what looks like its noise is part of it: a heater switched at random, a
multisine. Readings are therefore said to have noise only if differences of rising order show a white floor
far below their motion, and if they are not the few levels of a command that was recorded as a channel.

Source: Gasser, Sroka & Jennen-Steinmetz, Biometrika 73 (1986) 625; Hall, Kay & Titterington, Biometrika 77
(1990) 521.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.noise import plateau

Floats = NDArray[np.float64]

#: most values of a signal that only takes a few levels
FEW_LEVELS = 12
#: least share of readings that repeat the one before, of a signal that is held
HELD = 0.8
#: a floor above this share of the standard deviation may be the motion itself
_MOST = 0.2
_ORDERS = 8
_FEWEST = 24


def measured_noise(times: Sequence[Floats], records: Sequence[Floats]) -> float | None:
    """The standard deviation of a reading, in its unit; None if motion and noise cannot be told apart."""
    long = [(t, values) for t, values in zip(times, records, strict=True) if values.size >= _FEWEST]
    if not long or has_few_levels([values for _, values in long]):
        return None
    floor = _white_floor(long)
    if floor is None or not 0.0 < floor <= _MOST * float(np.std(np.concatenate([u for _, u in long]))):
        return None
    return floor


def has_few_levels(records: Sequence[Floats]) -> bool:
    """Whether a signal has only a few values, or mostly repeats the one before, as a command does."""
    every = np.concatenate(records)
    every = every[np.isfinite(every)]
    steps = np.concatenate([np.diff(values) for values in records])
    return np.unique(every).size <= FEW_LEVELS or float(np.mean(steps == 0.0)) >= HELD


def _white_floor(records: Sequence[tuple[Floats, Floats]]) -> float | None:
    """The scaled deviation of a difference from the order on at which it no longer falls."""
    scales = [_scale(records, order) for order in range(1, _ORDERS + 1)]
    order = plateau(scales)
    return scales[order - 1] if order else None


def _scale(records: Sequence[tuple[Floats, Floats]], order: int) -> float:
    """Standard deviation of white noise by its differences of one order, robust against jumps of motion."""
    differences = np.concatenate([_differences(t, values, order) for t, values in records])
    return float(1.4826 * np.median(np.abs(differences)))


def _differences(times: Floats, values: Floats, order: int) -> Floats:
    """(n − order) divided differences, which remove a polynomial of degree order − 1 at any times; their
    weights have the norm 1, so that those of white noise have its standard deviation."""
    t = np.lib.stride_tricks.sliding_window_view(times, order + 1)
    u = np.lib.stride_tricks.sliding_window_view(values, order + 1)
    apart = (t[:, :, None] - t[:, None, :]) / (t[:, -1:, None] - t[:, :1, None])
    apart[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray((weights * u).sum(axis=1))
