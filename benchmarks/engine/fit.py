"""The benchmark's fit: 8 parameters on 28 records with noise, from 30 % off."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats
from rigctl.engine.compile import compile_system
from rigctl.engine.least_squares import Block, Refused, Unknown, least_squares
from rigctl.engine.simulate import simulate

SIGMA = np.array([0.1, 1e4, 2e-4, 1e4])
NAMES = list(cylinder.NUISANCES)


def results(seeds: Sequence[int] = (0, 1, 2)) -> dict[str, Any]:
    """The median time over several starts, the better of two runs each, and what the fits came to."""
    compiled = compile_system(cylinder.build())
    random = np.random.default_rng(5)
    truth = simulate(compiled, cylinder.campaign()).require().outputs
    data = [clean + SIGMA * random.normal(size=clean.shape) for clean in truth]
    runs = []
    for seed in seeds:
        factor = 1.0 + 0.3 * np.random.default_rng(seed).uniform(-1.0, 1.0, len(NAMES))
        took = []
        for _ in range(2):
            start, cpu = time.perf_counter(), time.process_time()
            result = least_squares(evaluation(compiled, data), unknowns(factor), [()] * len(data))
            took.append((time.perf_counter() - start, time.process_time() - cpu))
        runs.append((min(wall for wall, _ in took), min(cpu for _, cpu in took), result))
    times = [wall for wall, _, _ in runs]
    return {
        "wall": float(np.median(times)),
        "slowest": max(times),
        "cpu": float(np.median([cpu for _, cpu, _ in runs])),
        "evaluations": [result.evaluations for *_, result in runs],
        "cost": [result.cost for *_, result in runs],
        "converged": all(result.converged for *_, result in runs),
    }


def unknowns(factor: Floats) -> list[Unknown]:
    """The 8 nuisance parameters, started at `factor` times their values."""
    found = []
    for (name, (unit, value, size)), off in zip(cylinder.NUISANCES.items(), factor, strict=True):
        lower = 0.1 * value if name != "pressure_offset" else -np.inf
        found.append(Unknown(name, value * off, lower, 10.0 * size, scale=size, unit=unit))
    return found


def evaluation(compiled: Any, data: Sequence[Floats]) -> Any:
    """Residuals and derivatives of every record, in units of their noise."""
    records = cylinder.campaign()

    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        moved = []
        for record in records:
            parameters = record.parameters.copy()
            parameters[: len(NAMES)] = shared
            moved.append(record.replace(parameters=parameters))
        result = simulate(compiled, moved, columns=NAMES if derivatives else ())
        if not result.ok:
            return Refused(result.summary())
        blocks = []
        for outputs, slopes, seen in zip(result.outputs, result.sensitivities, data, strict=True):
            columns = (slopes / SIGMA[:, None]).reshape(seen.size, -1) if derivatives else None
            blocks.append(Block(((outputs - seen) / SIGMA).ravel(), columns))
        return blocks

    return evaluate
