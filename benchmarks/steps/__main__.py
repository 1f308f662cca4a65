"""The cost of the runner per step and per sample: ``python -m benchmarks.steps``.

A trivial step is a `set`: two events for the step, one for the command, a check of signals and requests, and
the due samples. The simple plant is used, so that mainly the runner is measured.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.record import keep, median_seconds, table
from rigctl.backends.registry import create_backend
from rigctl.clock import VirtualClock
from rigctl.dataset import RunHeader, RunWriter, Source, source_of_rig
from rigctl.files.shipped import shipped
from rigctl.plan import Plan
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import load_rig
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import run

STEPS = 20_000
SAMPLES = 60_000
TRIVIAL = f"""\
procedure: steps
steps:
  - repeat: {STEPS // 2}
    do:
      - set: {{heater: on}}
      - set: {{heater: off}}
"""
RECORD = f"""\
procedure: samples
steps:
  - record: {{name: a, rate: 100 Hz}}
    do:
      - wait: {SAMPLES // 100} s
"""
WATCH = f"""\
procedure: watch
steps:
  - wait: {{until: position > 100 mm, timeout: {SAMPLES // 10} s}}
"""


def carry_out(plan: Plan, folder: Path, options: Mapping[str, object]) -> None:
    backend = create_backend(plan.rig, "simulated", VirtualClock(), options)
    backend.open()
    source = Source(plan.name, plan.procedure.text)
    header = RunHeader(
        "20260101-000000-x", source, source_of_rig(plan.rig), plan.rig.layout, datetime.now(UTC)
    )
    writer = RunWriter.create(folder, header)
    writer.close = lambda *_: writer.flush()  # type: ignore[assignment, method-assign]  # tables: see benchmarks.journal
    run(plan, backend, writer, operator=AutomaticOperator())


def seconds(text: str, folder: Path) -> float:
    rig = load_rig(shipped("rigs") / "hl32-bench.yaml")
    plan = expand(parse_procedure(text), rig)
    options = {"plant": "roles", "noise": "on"}
    return median_seconds(lambda: carry_out(plan, folder, options), runs=5)


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = seconds("procedure: nothing\nsteps:\n  - wait: 0 s\n", folder)
        step = (seconds(TRIVIAL, folder) - start) / STEPS
        sample = (seconds(RECORD, folder) - start) / SAMPLES
        watched = (seconds(WATCH, folder) - start) / SAMPLES
    table(
        "the runner in virtual time",
        [
            ("", "us", "at most"),
            ("a trivial step, with its events", f"{step * 1e6:.1f}", "50"),
            ("a sample in a record, journal and interlocks", f"{sample * 1e6:.1f}", "60"),
            ("a sample that a condition looks at", f"{watched * 1e6:.1f}", "60"),
            ("start and end of a run", f"{start * 1e6:.0f}", ""),
        ],
    )
    results = {
        "microseconds_per_step": step * 1e6,
        "microseconds_per_sample": {"recorded": sample * 1e6, "watched": watched * 1e6},
        "microseconds_per_run": start * 1e6,
    }
    print(f"\nkept in {keep(Path(__file__).parent, results, 'python-statemachine')}")


if __name__ == "__main__":
    main()
