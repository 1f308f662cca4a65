"""Surveys of many runs: their false alarms and their cost: ``python -m benchmarks.survey``.

``--chance`` draws series without a change and counts the false alarms of the scan; ``--years`` simulates
years on the separate bench, some without a change and some in which the valve's leak grows; ``--runs`` times
a survey of runs of 28 records, and extrapolates to a thousand.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.record import keep, table
from rigctl.dataset import open_run
from rigctl.engine.result_cache.cached import switched_off
from rigctl.model import load_model
from rigctl.monitoring.significance import scan
from rigctl.monitoring.survey import survey
from rigctl.tasks import Workers
from rigctl_validation.bench.campaign import PRESSURES, TEMPERATURES, Campaign, Scatter
from rigctl_validation.bench.parameters import BenchParameters
from rigctl_validation.campaign_run import make_run

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
RIG, MODEL = ROOT / "rigs" / "hl32-bench.yaml", ROOT / "models" / "hl32-textbook.yaml"
Draw = Callable[[np.random.Generator, int], NDArray[np.float64]]


def _neighbours(correlation: float, heavy: bool = False) -> Draw:
    def draw(generator: np.random.Generator, count: int) -> NDArray[np.float64]:
        values = generator.standard_t(3, count) if heavy else generator.standard_normal(count)
        for k in range(1, count):
            values[k] = correlation * values[k - 1] + math.sqrt(1 - correlation**2) * values[k]
        return values

    return draw


SCATTERS: dict[str, Draw] = {
    "normal": lambda g, n: g.standard_normal(n),
    "Student's t, 2 degrees": lambda g, n: g.standard_t(2, n),
    "Cauchy": lambda g, n: g.standard_cauchy(n),
    "one run in ten five times as far": lambda g, n: (
        g.standard_normal(n) * np.where(g.random(n) < 0.1, 5.0, 1.0)
    ),
    "neighbours correlated, 0.3": _neighbours(0.3),
    "neighbours correlated, 0.6": _neighbours(0.6),
    "neighbours correlated, 0.6, Student's t, 3 degrees": _neighbours(0.6, heavy=True),
    "neighbours correlated, 0.8": _neighbours(0.8),
}


def chance(courses: int) -> dict[str, dict[str, float]]:
    """How often a series without a change has p < 1 %, and p < 1 %/40, the level for one of forty."""
    counts = (20, 50, 100)
    rows, results = [("scatter between runs", *(f"{n} runs" for n in counts))], {}
    for name, draw in SCATTERS.items():
        generator = np.random.default_rng(1)
        found: dict[str, float] = {}
        for count in counts:
            order = np.arange(count, dtype=float)
            p_values = np.array([scan(draw(generator, count), order).p_value for _ in range(courses)])
            found[f"{count} runs"] = float(np.mean(p_values < 0.01))
            found[f"{count} runs, one of forty"] = float(np.mean(p_values < 0.01 / 40))
        results[name] = found
        told = ((found[f"{n} runs"], found[f"{n} runs, one of forty"]) for n in counts)
        rows.append((name, *(f"{100 * one:.1f} % ({100 * forty:.2f} %)" for one, forty in told)))
    table(f"false alarms at 1 % (at 0.025 %), {courses} courses each", rows)
    return results


def _year(folder: Path, runs: int, seed: int, grown: float) -> None:
    """A year on the separate bench: each run's throttle and damping scatter; the leak grows from 40 % on."""
    draw = np.random.default_rng(seed)
    for k in range(runs):
        bench = BenchParameters(
            spool_leak=2e-15 + grown * max(0.0, k / runs - 0.4) / 0.6,
            throttle_area=3.3e-6 * (1 + 0.002 * draw.standard_t(3)),
            damping=120.0 * (1 + 0.03 * draw.standard_t(3)),
        )
        campaign = Campaign(
            bench=bench,
            scatter=Scatter(setting=0.002),
            temperatures=(30.0, 60.0),
            pressures=(25.0, 45.0),
            seed=1000 * seed + k,
        )
        started = datetime(2026, 1, 1, 8, tzinfo=UTC) + timedelta(days=365 * k / runs)
        make_run(campaign, RIG, folder, started=started)


def years(count: int, runs: int, grown: float) -> dict[str, Any]:
    """Surveys of some years with the whole library, and their results."""
    model = load_model(MODEL)
    verdicts, named, first, sizes = [], [], [], []
    for seed in range(1, count + 1):
        with tempfile.TemporaryDirectory() as place, switched_off():
            folder = Path(place)
            _year(folder, runs, seed, grown)
            opened = [open_run(path) for path in sorted(folder.iterdir())]
            found = survey(opened, model, workers=Workers(1))
        verdicts.append(found.verdict)
        if found.changes:
            change = found.changes[0]
            named.append(" or ".join([change.quantity.name, *change.alike[:3]]))
            first.append(change.first_sure)
            sizes.append([change.shape.before, change.shape.after])
        print(f"year {seed}: {found.verdict}, {found.statement[:160]}", flush=True)
    alarms = sum(verdict == "changed" for verdict in verdicts)
    print(f"{alarms} of {count} years of {runs} runs told a change; leak grown by {grown:g} m^3")
    return {
        "years": count,
        "runs of each": runs,
        "grown [m^3]": grown,
        "changed": alarms,
        "named": named,
        "first sure, run": statistics.median(first) if first else None,
        "before and after [m^3]": sizes,
    }


def cost(runs: int) -> dict[str, float]:
    """Wall and CPU time of a survey of runs of 28 records on two cores, per run and for a thousand.

    In two worker processes, as a survey of many runs has them; their start is in both times that are
    subtracted.
    """
    os.environ["RIGCTL_RESULTS"] = "off"  # in the worker processes too
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for k in range(runs):
            campaign = Campaign(
                bench=BenchParameters(spool_leak=2e-15),
                scatter=Scatter(setting=0.002),
                temperatures=TEMPERATURES,
                pressures=PRESSURES,
                seed=k,
            )
            make_run(campaign, RIG, folder, started=datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=k))
        opened = [open_run(path) for path in sorted(folder.iterdir())]
        times = []
        for count in (runs // 2, runs):
            began, used = time.perf_counter(), sum(os.times()[:4])
            survey(opened[:count], load_model(MODEL), name=False, workers=Workers(2))
            times.append((time.perf_counter() - began, sum(os.times()[:4]) - used))
    more = runs - runs // 2
    wall, processor = ((times[1][k] - times[0][k]) / more for k in (0, 1))
    print(f"each run: {wall:.2f} s, {processor:.2f} s of processor; a thousand on two cores: "
          f"{1000 * processor / 2 / 60:.1f} min of two quiet cores")  # fmt: skip
    return {
        "each run [s]": wall,
        "each run, processor [s]": processor,
        "1000 runs [min]": 1000 * processor / 120,
    }


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--chance", type=int, metavar="COURSES", default=0)
    arguments.add_argument("--years", type=int, metavar="N", default=0)
    arguments.add_argument(
        "--grown", type=float, metavar="M3", default=0.0, help="of the leak in such a year"
    )
    arguments.add_argument("--each", type=int, metavar="RUNS", default=24, help="of a year")
    arguments.add_argument("--runs", type=int, metavar="N", default=0)
    asked = arguments.parse_args()
    if not (asked.chance or asked.years or asked.runs):
        asked.chance, asked.runs = 1000, 12
    if asked.chance:
        keep(HERE, chance(asked.chance), name="chance")
    if asked.years:
        told = years(asked.years, asked.each, asked.grown)
        keep(HERE, told, name="years-grown" if asked.grown else "years-unchanged")
    if asked.runs:
        keep(HERE, cost(asked.runs), name="cost")


if __name__ == "__main__":
    main()
