"""The distributed tasks: functions that other processes can import."""

from __future__ import annotations

import time

import numpy as np

from rigctl.tasks import seed_of

#: duration of a task, about that of a fit, s
LASTS = 0.5


def computes(piece: int) -> float:
    """Compute for some seconds of CPU time on one core."""
    chance = np.random.default_rng(seed_of(1, piece))
    began = time.process_time()
    total = 0.0
    while time.process_time() - began < LASTS:
        total += float(np.linalg.svd(chance.normal(size=(40, 40)), compute_uv=False)[0])
    return total


def waits(piece: int) -> int:
    time.sleep(LASTS)
    return piece


def nothing(piece: int) -> int:
    return piece
