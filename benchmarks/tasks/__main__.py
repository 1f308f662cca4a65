"""Tasks on one worker and on two, locally and on a cluster: ``python -m benchmarks.tasks``.

Efficiency is the time of one worker over twice that of two. Computing tasks show it only on an idle machine;
waiting tasks show the cost of distribution on any.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

from benchmarks.record import keep, table
from benchmarks.tasks.pieces import computes, nothing, waits
from benchmarks.tasks.scaling import Scheduler, efficiency
from rigctl.tasks import Workers, map_tasks


def seconds(work: object, pieces: int, workers: Workers) -> float:
    """Seconds from the first result on, without the start of the workers."""
    began = None
    for _ in map_tasks(work, range(pieces + 1), workers):  # type: ignore[arg-type, var-annotated]
        began = began or time.perf_counter()
    return time.perf_counter() - (began or 0.0)


def simulated() -> dict[str, dict[str, float]]:
    """Efficiency by duration of a task and number of workers, with a scheduler of 1 ms per task."""
    workers = (10, 100, 300, 1000)
    rows, results = [("a piece lasts", *(f"{count} workers" for count in workers))], {}
    for lasts in (0.1, 0.5, 1.0, 2.0, 10.0, 60.0):
        found = {f"{count} workers": efficiency(count, lasts, Scheduler()) for count in workers}
        results[f"{lasts:g} s"] = found
        rows.append((f"{lasts:g} s", *(f"{100 * value:.0f} %" for value in found.values())))
    table("simulated: one scheduler of 1 ms a piece, 50 pieces for each worker", rows)
    return results


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--pieces", type=int, default=24)
    arguments.add_argument("--simulate", action="store_true", help="only what needs no second core")
    asked = arguments.parse_args()
    simulation = simulated()
    if asked.simulate:
        return
    os.environ["PYTHONPATH"] = str(Path(__file__).parents[2])
    rows, results = [("work", "where", "1 worker [s]", "2 workers [s]", "efficiency")], {}
    for work in (waits, computes):
        for where, of in (
            ("processes", Workers),
            ("cluster", lambda count: Workers(cluster=f"local:{count}")),
        ):
            one, two = (seconds(work, asked.pieces, of(count)) for count in (1, 2))
            results[f"{work.__name__}, {where}"] = {
                "one [s]": one,
                "two [s]": two,
                "efficiency": one / two / 2,
            }
            rows.append((work.__name__, where, f"{one:.2f}", f"{two:.2f}", f"{100 * one / two / 2:.0f} %"))
    many = 2000
    per_task = seconds(nothing, many, Workers(cluster="local:2")) / many
    results["cluster, a piece of nothing [ms]"] = 1e3 * per_task
    table("pieces of half a second", rows)
    print(f"\na piece of nothing on a cluster: {1e3 * per_task:.2f} ms")
    keep(Path(__file__).parent, {**results, "simulated": simulation}, "distributed")


if __name__ == "__main__":
    main()
