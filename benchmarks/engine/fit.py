"""The benchmark's fit: 8 parameters on 28 records with noise, started 30 % off."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats
from benchmarks.engine.timing import best
from rigctl.engine.compile import compile_system
from rigctl.engine.least_squares import Block, Refused, Unknown, least_squares
from rigctl.engine.simulate import simulate

SIGMA = np.array([0.1, 1e4, 2e-4, 1e4])
NAMES = list(cylinder.NUISANCES)


def results(seeds: Sequence[int] = (0, 1, 2)) -> dict[str, Any]:
    """For several starts, the faster of two runs and its optimum, and SciPy's fit from the first start."""
    compiled = compile_system(cylinder.build())
    random = np.random.default_rng(5)
    truth = simulate(compiled, cylinder.campaign()).require().outputs
    data = [clean + SIGMA * random.normal(size=clean.shape) for clean in truth]
    evaluate, local = evaluation(compiled, data), [()] * len(data)
    times, fits = [], []
    for seed in seeds:
        started = unknowns(start_factor(seed))
        times.append(best(lambda: least_squares(evaluate, started, local), 2))  # noqa: B023
        fits.append(least_squares(evaluate, started, local))
    return {
        **{kind: float(np.median([one[kind] for one in times])) for kind in ("wall", "cpu")},
        "slowest": max(one["wall"] for one in times),
        "evaluations": [result.evaluations for result in fits],
        "cost": [result.cost for result in fits],
        "converged": all(result.converged for result in fits),
        "scipy": by_scipy(evaluate, unknowns(start_factor(seeds[0])), fits[0].values, fits[0].std),
    }


def start_factor(seed: int) -> Floats:
    """Up to 30 % off."""
    return np.asarray(1.0 + 0.3 * np.random.default_rng(seed).uniform(-1.0, 1.0, len(NAMES)))


def by_scipy(evaluate: Any, started: Sequence[Unknown], ours: Floats, std: Floats) -> dict[str, Any]:
    """SciPy's trust-region reflective fit on the same residuals and derivatives."""
    import scipy.optimize

    def blocks(values: Floats, derivatives: bool) -> Any:
        found = evaluate(values, (), derivatives)
        if isinstance(found, Refused):
            raise RuntimeError(found.reason)
        return found

    start, cpu = time.perf_counter(), time.process_time()
    found = scipy.optimize.least_squares(
        lambda x: np.concatenate([block.residual for block in blocks(x, False)]),
        [unknown.start for unknown in started],
        lambda x: np.concatenate([block.shared for block in blocks(x, True)]),
        bounds=([u.lower for u in started], [u.upper for u in started]),
        x_scale=[u.size for u in started],
        ftol=1e-10,
    )
    return {
        "wall": time.perf_counter() - start,
        "cpu": time.process_time() - cpu,
        "cost": float(found.cost),
        "evaluations": int(found.nfev + found.njev),
        # between the two optima, in standard deviations of the estimate
        "largest_difference": float(np.abs((found.x - ours) / std).max()),
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
