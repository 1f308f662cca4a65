"""The shipped procedures do what their comments state."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from rigctl.plan import Leaf, Plan, RecordNode, walk
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig
from rigctl.runner.simulation import simulate
from rigctl.steps.measure import Measure
from rigctl.steps.prompt import Prompt
from rigctl.steps.wait import Wait

ROOT = Path(__file__).parents[2]
PROCEDURES = sorted((ROOT / "procedures").glob("*.yaml"))
OF_HL32 = [path for path in PROCEDURES if "rig: rigs/hl32-bench.yaml" in path.read_text(encoding="utf-8")]


def plan_of(name: str, **arguments: str) -> Plan:
    procedure = load_procedure(ROOT / "procedures" / f"{name}.yaml")
    return expand(procedure, load_rig(procedure.rig_path), arguments)


def records(plan: Plan) -> list[RecordNode]:
    return [node for node in walk(plan.root) if isinstance(node, RecordNode)]


def conditions(plan: Plan) -> list[tuple[float, float]]:
    """Oil temperature in degC and supply pressure in bar of every record."""
    return [
        (round(r.sweep["oil"][0] - 273.15, 6), round(r.sweep["supply"][0] / 1e5, 6)) for r in records(plan)
    ]


@pytest.mark.parametrize("path", PROCEDURES, ids=lambda path: path.stem)
def test_each_procedure_expands_on_its_rig_and_has_records(path: Path) -> None:
    assert records(plan_of(path.stem))


@pytest.mark.parametrize("path", OF_HL32, ids=lambda path: path.stem)
def test_each_procedure_expands_on_the_instrumented_rig(path: Path) -> None:
    rig = load_rig(ROOT / "rigs" / "hl32-bench-instrumented.yaml")
    assert "pressure_a" in records(expand(load_procedure(path), rig))[0].channels or path.stem.startswith(
        ("calibrate", "viscometer")
    )


def test_the_campaign_has_the_published_conditions_and_times() -> None:
    plan = plan_of("campaign")
    assert conditions(plan) == [(t, p) for t in range(20, 90, 10) for p in (20, 30, 40, 50)]
    for record in records(plan):
        assert (record.name, record.rate) == ("stroke", 100.0)
        timed = [
            node.action.duration
            for node in walk(record)
            if hasattr(getattr(node, "action", None), "duration")
        ]  # type: ignore[union-attr]
        assert timed == [0.2, 1.05, 1.0, 1.5]
        assert sum(timed) == pytest.approx(3.75)


def test_the_campaign_checks_zeros_and_baseline_before_it_heats() -> None:
    plan = plan_of("campaign")
    first, second = plan.root.children
    names = [n.action.name for n in walk(first) if isinstance(n, Leaf) and isinstance(n.action, Measure)]
    assert names == ["zero_position", "noise_position", "baseline_pressure", "noise_pressure"]
    assert second.path == "2/for"


def test_the_campaign_repeats_conditions_on_request() -> None:
    counts = Counter(conditions(plan_of("campaign", repeats="2")))
    assert sum(counts.values()) == 28 + 14
    assert {condition for condition, count in counts.items() if count == 3} == {
        (float(t), 30.0) for t in range(20, 90, 10)
    }


def test_the_campaign_can_shuffle_its_pressures() -> None:
    shuffled = conditions(plan_of("campaign", shuffle="7"))
    assert sorted(shuffled) == sorted(conditions(plan_of("campaign")))
    assert shuffled != sorted(shuffled)
    assert [oil for oil, _ in shuffled] == sorted(oil for oil, _ in shuffled)
    assert shuffled == conditions(plan_of("campaign", shuffle="7"))


def test_the_viscometer_uses_both_tubes_at_40_degrees() -> None:
    plan = plan_of("viscometer")
    at_40 = [r.sweep["bore"][0] for r in records(plan) if r.sweep["bath"][0] == pytest.approx(313.15)]
    assert at_40 == pytest.approx([2e-3, 1.5e-3])


def test_the_viscometer_finds_the_viscosity_from_the_time() -> None:
    plan = plan_of("viscometer")
    for record in records(plan):
        prompts = [n.action for n in walk(record) if isinstance(n, Leaf) and isinstance(n.action, Prompt)]
        (measure,) = [n.action for n in walk(record) if isinstance(n, Leaf) and isinstance(n.action, Measure)]
        run_time = next(prompt.simulated for prompt in prompts if prompt.name == "run_time")
        assert run_time is not None
        assert 60.0 < run_time < 900.0
        value = float(measure.expression.evaluate({"run_time": run_time}))
        assert value == pytest.approx(record.sweep["nominal"][0], rel=1e-9)
        assert measure.passes(value)
        assert not measure.passes(1.3 * value)


@pytest.mark.parametrize("name", ["calibrate-pressure", "calibrate-thermocouple"])
def test_calibration_procedures_limit_the_deviation_from_a_reference(name: str) -> None:
    for record in records(plan_of(name)):
        measures = {
            n.action.name: n.action
            for n in walk(record)
            if isinstance(n, Leaf) and isinstance(n.action, Measure)
        }
        deviation = measures["deviation"]
        assert deviation.low is not None
        assert deviation.high == pytest.approx(-deviation.low)
        assert deviation.difference is (name == "calibrate-thermocouple")


def test_the_heater_board_procedure_steps_the_power_up_and_down() -> None:
    steps = records(plan_of("heater-board-steps"))
    assert [round(100 * r.sweep["power"][0]) for r in steps] == [*range(10, 110, 10), *range(90, 0, -10)]
    assert {r.rate for r in steps} == {1.0}
    waits = [n.action for r in steps for n in walk(r) if isinstance(n, Leaf) and isinstance(n.action, Wait)]
    assert {wait.duration for wait in waits} == {1200.0}
    shorter = records(plan_of("heater-board-steps", powers="20 %, 60 %", dwell="5 min", second="50 %"))
    assert [r.sweep["power"][0] for r in shorter] == pytest.approx([0.2, 0.6])


@pytest.mark.parametrize("heater", [1, 2])
def test_the_step_test_heats_the_heater_that_is_named(heater: int, tmp_path: Path) -> None:
    arguments = {"heater": str(heater), "power": "30 %", "dwell": "3 min"}
    found = simulate(ROOT / "procedures" / "tclab-step.yaml", arguments=arguments, runs=tmp_path).run.records
    assert list(found["name"]) == ["up", "down"]
    up = found.iloc[0]
    warmer = up["final_1"] - up["final_2"]
    assert abs(warmer) > 5.0
    assert (warmer > 0.0) == (heater == 1)


def test_the_rig_is_found_from_any_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    rig: Rig = load_rig(load_procedure(ROOT / "procedures" / "stroke.yaml").rig_path)
    assert rig.name == "HL32 bench"
