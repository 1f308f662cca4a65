"""A new kind of step needs one file: it is found, read, previewed and carried out without other changes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

NEW_STEP = '''
"""`note`: write a line into the run's events after a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rigctl.plan.action import Action
from rigctl.plan.behaviour import Behaviour, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf


class NoteStep(Step):
    """Write a line into the events."""

    verb: ClassVar[str] = "note"
    example: ClassVar[str] = "- note: valve replaced"
    note: str

    def build(self, context: Context) -> Leaf:
        return context.leaf(f"note {self.note}", Note(self.note))


@dataclass(frozen=True, slots=True)
class Note(Action):
    text: str

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        return Forecast(7.0, Basis.TIMED, state)

    def carry_out(self, bench: StepBench) -> Behaviour:
        yield Until(bench.now + 7.0)
        bench.event("note", self.text)
        return Outcome.COMPLETE
'''

USE = """
import sys
from pathlib import Path

import rigctl.steps

rigctl.steps.__path__.append(sys.argv[1])

from rigctl.errors import RigctlError
from rigctl.planning import preview
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import load_rig
from rigctl.runner.simulation import simulate

written = Path(sys.argv[1]) / "noted.yaml"
written.write_text(f"procedure: noted\\nrig: {sys.argv[2]}\\nsteps:\\n  - note: valve replaced\\n")
print("expected", preview(expand(parse_procedure(written.read_text()), load_rig(Path(sys.argv[2])))).seconds)
run = simulate(written, runs=Path(sys.argv[1]) / "runs").run
events = run.events
print("logged", "valve replaced" in events["message"].tolist())
try:
    parse_procedure("procedure: x\\nsteps: [{noet: a}]")
except RigctlError as error:
    print("nearest", error.nearest)
"""


def test_a_new_step_in_one_file_is_previewed_carried_out_and_suggested(tmp_path: Path) -> None:
    (tmp_path / "note.py").write_text(dedent(NEW_STEP), encoding="utf-8")
    rig = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"
    done = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path), str(rig)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["expected 7.0", "logged True", "nearest note"]
