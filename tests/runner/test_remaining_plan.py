"""Which steps remain, which are repeated, and resuming an interrupted run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rigctl.clock import VirtualClock
from rigctl.dataset.run import open_run
from rigctl.errors import RigctlError
from rigctl.plan import Group, Node
from rigctl.procedure import expand, load_procedure
from rigctl.rig import load_rig
from rigctl.runner.launch import Launch, launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.operators.requests import Request
from rigctl.runner.remaining_plan import record_paths, remaining, setup_before
from rigctl.runner.resume import open_interrupted, relaunch
from run_workshop import RIG, ScriptedControl

CAMPAIGN = """\
procedure: small campaign
steps:
  - retract: {until: position < 1 mm, timeout: 10 s}
  - measure: {name: zero, value: mean(position), last: 0.2 s, unit: mm}
  - for: {oil: [21 degC, 22 degC]}
    do:
      - heat: {to: $oil, within: 0.5 K, settle: 5 s, timeout: 1 h}
      - for: {supply: [20 bar, 30 bar, 40 bar]}
        do:
          - retract: {until: position < 1 mm, timeout: 10 s}
          - set_pressure: {to: $supply, within: 0.5 bar, settle: 2 s, timeout: 60 s}
          - record: {name: stroke, rate: 100 Hz}
            do:
              - wait: 0.2 s
              - extend: {for: 0.5 s}
              - retract: {for: 0.5 s}
  - repeat: 3
    do:
      - record: {name: again, rate: 50 Hz}
        do:
          - wait: 1 s
"""


def labels(nodes: list[Node]) -> list[str]:
    return [node.label for node in nodes]


def test_every_record_has_a_unique_path(workshop: Any) -> None:
    plan = workshop.plan(CAMPAIGN.split("\n", 1)[1])
    paths = record_paths(plan.root)
    assert len(paths) == len(set(paths)) == 9


def test_a_plan_without_completed_records_remains_whole(workshop: Any) -> None:
    plan = workshop.plan(CAMPAIGN.split("\n", 1)[1])
    assert remaining(plan.root.children, lambda _: False) == list(plan.root.children)


def test_a_group_continues_at_its_first_incomplete_record(workshop: Any) -> None:
    plan = workshop.plan(CAMPAIGN.split("\n", 1)[1])
    done = set(record_paths(plan.root)[:4])
    left = remaining(plan.root.children, done.__contains__)
    assert len(left) == 2  # the sweep over the oil and the repetition, not the steps before them
    sweep = left[0]
    assert isinstance(sweep, Group)
    (second,) = remaining(sweep.children, done.__contains__)
    assert "22 degC" in second.label


def test_the_set_up_is_the_last_step_of_each_kind_before_a_record(workshop: Any) -> None:
    steps = """\
steps:
  - heat: {to: 21 degC, within: 0.5 K, settle: 5 s, timeout: 1 h}
  - set_pressure: {to: 20 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}
  - extend: {for: 1 s}
  - record: {name: a}
    do: [wait: 1 s]
  - set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}
  - retract: {for: 2 s}
  - record: {name: b}
    do: [wait: 1 s]
"""
    nodes = list(workshop.plan(steps).root.children)
    setup = labels(setup_before(nodes, 6))
    assert [text.split()[0] for text in setup] == ["heat", "set", "retract"]
    assert "30 bar" in setup[1]


@pytest.fixture
def plan_file(tmp_path: Path) -> Path:
    path = tmp_path / "campaign.yaml"
    path.write_text(CAMPAIGN.replace("steps:", f"rig: {RIG}\nsteps:", 1), encoding="utf-8")
    return path


def launch_until(plan_file: Path, tmp_path: Path, when: float) -> Any:
    procedure = load_procedure(plan_file)
    plan = expand(procedure, load_rig(procedure.rig_path))
    control = ScriptedControl([(when, Request.ABORT)])
    return launch(plan, how(tmp_path, controls=(control,)))


def how(tmp_path: Path, **more: Any) -> Launch:
    options = {"plant": "roles", "noise": "off", "quantised": "off"}
    return Launch(
        runs=tmp_path / "runs",
        operator=AutomaticOperator(),
        backend="simulated",
        options=options,
        clock=VirtualClock(),
        exclusive=False,
        response=0.0,
        **more,
    )


def test_an_interrupted_run_resumes_where_it_stopped(plan_file: Path, tmp_path: Path) -> None:
    first = launch_until(plan_file, tmp_path, 1e9)
    assert first.status == "finished", first.reason
    whole = open_run(first.folder)
    middle = float(whole.records["start"].iloc[4]) + 0.7
    cut = launch_until(plan_file, tmp_path, middle)
    assert cut.status == "aborted"
    before = open_interrupted(cut.folder)
    assert len(before.done.completed) == 4
    assert before.left == 5
    assert before.done.values["zero"][1] == "mm"
    result = relaunch(before, how(tmp_path))
    assert result.status == "finished", result.reason
    assert result.folder == cut.folder
    run = open_run(cut.folder)
    assert list(run.records["outcome"]) == ["complete"] * 4 + ["aborted"] + ["complete"] * 5
    assert [
        p for p, o in zip(run.records["path"], run.records["outcome"], strict=True) if o == "complete"
    ] == list(whole.records["path"])
    heats = [e for e in run.events["message"] if isinstance(e, str) and e.startswith("heat to")]
    assert len(heats) == 3  # 21, 22, and 22 again because the next record needs it
    with pytest.raises(RigctlError, match="finished"):
        open_interrupted(cut.folder)


def test_resuming_with_a_changed_procedure_is_refused(plan_file: Path, tmp_path: Path) -> None:
    cut = launch_until(plan_file, tmp_path, 60.0)
    plan_file.write_text(plan_file.read_text(encoding="utf-8") + "# a note\n", encoding="utf-8")
    with pytest.raises(RigctlError, match="procedure has changed"):
        open_interrupted(cut.folder)


def test_resuming_on_a_bench_with_other_options_is_refused(plan_file: Path, tmp_path: Path) -> None:
    cut = launch_until(plan_file, tmp_path, 60.0)
    before = open_interrupted(cut.folder)
    other = how(tmp_path)
    other = replace(other, options={**other.options, "noise": "on"})
    with pytest.raises(RigctlError, match=r"another bench .*got 'noise: on'; expected off"):
        relaunch(before, other)
    assert relaunch(before, how(tmp_path)).status == "finished"
