"""The set-points drawn on the Live page: those of every step with a target for a channel."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.live.steps import PlanPlaces
from rigctl.plan import Leaf, walk
from rigctl.procedure import expand, load_procedure
from rigctl.rig import load_rig
from rigctl.web.set_points import SetPoints

ROOT = Path(__file__).parents[2]
CYLINDER = """\
procedure: set-points
rig: hl32-bench.yaml
steps:
  - heat: {to: 40 degC, within: 0.5 K}
  - hold: {for: 1 min, channel: supply_pressure, within: 2 bar}
  - extend: {to: 100 mm, within: 1 mm}
  - wait: 1 s
"""
BOARD = """\
procedure: a ramp
rig: heater-board.yaml
steps:
  - control: {actuator: heater_1, channel: temperature_1, to: 50 degC, ramp: 10 K/min, gain: 4 %/K,
      rate: 1 Hz, for: 20 min}
"""


def watched(tmp_path: Path, bench: str, procedure: str) -> tuple[SetPoints, list[Leaf]]:
    """What is shown of a procedure, and its steps in order."""
    path = tmp_path / "procedure.yaml"
    path.write_text(procedure, encoding="utf-8")
    rig = load_rig(ROOT / "rigs" / bench)
    plan = expand(load_procedure(path), rig)
    found = SetPoints(rig)
    found.follow(PlanPlaces(plan))
    return found, [node for node in walk(plan.root) if isinstance(node, Leaf)]


def test_each_step_with_a_set_point_has_a_line(tmp_path: Path) -> None:
    found, steps = watched(tmp_path, "hl32-bench.yaml", CYLINDER)
    for number, step in enumerate(steps):
        for time, state in ((10.0 * number, "begin"), (10.0 * number + 9.0, "end")):
            found.take({"time": time, "kind": "step", "path": step.path, "state": state})
    asked = []

    def first(channel: str, time: float) -> float:
        asked.append((channel, time))
        return 31.5

    shown = found.shown(first, 0.0)
    assert [(one["channel"], one["begin"], one["end"]) for one in shown] == [
        ("oil_temperature", 0.0, 9.0),
        ("supply_pressure", 10.0, 19.0),
        ("position", 20.0, 29.0),
    ]
    assert [one["to"] for one in shown] == pytest.approx([40.0, 31.5, 100.0])
    assert [one["within"] for one in shown] == pytest.approx([0.5, 2.0, 1.0])
    assert asked == [
        ("supply_pressure", 10.0)
    ]  # only a step that holds the current value waits for a reading
    assert [one["channel"] for one in found.shown(first, 12.0)] == ["supply_pressure", "position"]


def test_a_ramp_without_a_start_value_is_drawn_from_the_first_reading(tmp_path: Path) -> None:
    found, (step,) = watched(tmp_path, "heater-board.yaml", BOARD)
    found.take({"time": 5.0, "kind": "step", "path": step.path, "state": "begin"})
    assert found.shown(lambda *_: None, 0.0) == []
    (line,) = found.shown(lambda *_: 25.0, 0.0)
    assert (line["from"], line["to"], line["end"]) == (25.0, pytest.approx(50.0), None)
    assert line["seconds"] == pytest.approx(150.0)  # 25 K at 10 K a minute
    found.take({"time": 80.0, "kind": "end", "status": "aborted"})
    assert found.shown(lambda *_: 25.0, 0.0)[0]["end"] == 80.0
