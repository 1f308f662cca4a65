"""The cost of a design with five rivals and three hundred candidates: ``python -m benchmarks.designing``.

Two strokes of the simulated cylinder with sticking seals: the diagnosis leaves a class, and records are
designed. CPU time and wall time are given: a design runs in one process, with the engine's threads.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from benchmarks.record import keep, table
from rigctl.analysis.diagnosis import diagnose
from rigctl.design.design import design_experiment
from rigctl.design.information_so_far import known_so_far
from rigctl.design.rivals import question_of
from rigctl.design.scheme import schemes_of, stage_of
from rigctl.design.search import CANDIDATES, Workshop, first_candidates
from rigctl.engine.result_cache import switched_off
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.runner.simulation import simulate

HERE = Path(__file__).parent
CAMPAIGN = {"temperatures": "20 degC", "pressures": "30 bar, 50 bar"}
T = TypeVar("T")


@switched_off()
def main() -> None:
    """Measure, print, and keep it beside this file."""
    model = load_model(shipped("models", "hl32-textbook.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(
            shipped("procedures", "campaign.yaml"),
            arguments=CAMPAIGN,
            effects=["stribeck_friction"],
            seed=4,
            runs=folder,
        ).run
        found, diagnosed = timed(lambda: diagnose([run], model))
        question = question_of(found)
        rig = question.rivals[0].fit.problem.measurements.rig
        assert rig is not None
        stage = stage_of(question.rivals[0].fit, rig)
        schemes = schemes_of(stage, question.rivals[0].fit.problem.records)
        known = known_so_far(question.rivals)
        workshop = Workshop(question.rivals, known, stage)
        good, candidates = timed(lambda: first_candidates(workshop, schemes, 0))
        made, designed = timed(lambda: design_experiment([run], model, diagnosis=found))
    rivals = len(question.rivals)
    rows = [
        ("", "seconds of processor", "of the clock"),
        ("the diagnosis before", *shown(diagnosed)),
        (
            f"{workshop.tried} candidates with each of {rivals} rivals, {len(good)} let through",
            *shown(candidates),
        ),
        (f"the whole design: {len(made.records)} records, {made.notes[0]}", *shown(designed)),
    ]
    table(f"Designing for {rivals} rivals, {CANDIDATES} candidates at first", rows)
    results = {
        "rivals": rivals,
        "candidates": workshop.tried,
        "diagnosis_s": diagnosed,
        "candidates_s": candidates,
        "design_s": designed,
        "note": made.notes[0],
    }
    print(f"kept in {keep(HERE, results, 'numpy', 'scipy', 'numba')}")


def timed(work: Callable[[], T]) -> tuple[T, tuple[float, float]]:
    """The result, with its CPU and wall time, s."""
    cpu, wall = time.process_time(), time.perf_counter()
    found = work()
    return found, (time.process_time() - cpu, time.perf_counter() - wall)


def shown(seconds: tuple[float, float]) -> tuple[str, str]:
    """Format the figures for a table."""
    return f"{seconds[0]:.1f}", f"{seconds[1]:.1f}"


if __name__ == "__main__":
    main()
