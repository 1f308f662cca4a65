"""A model on records it was not fitted to: whether it is as good there, and otherwise what it lacks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rigctl
from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import Comparison
from rigctl.analysis.held_out import unseen
from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.dataset.importing import import_file
from rigctl.report.analysis.held_out import unseen_sections
from rigctl.rig import load_rig

ROOT = Path(__file__).parents[2]
RECORDS = ("H1_000_030", "H1_000_050", "H1_000_090", "H1_030_000", "H1_090_000")
MODEL = """
model: heater_board
rig: {rig}
parameters:
  heater_gain_1: {{value: 1.33 W, fit: true}}
  convection: {{value: {convection} mW/K, fit: true}}
  heat_capacity: 2 J/K
effects:
  heater_coupling: {{conductance: 0.0038 W/K, area: 1.6 cm^2}}
  heater_lag: {{lag: 27.6 s}}
  radiation: {{area: 5.65 cm^2}}
"""


def judged(
    folder: Path, convection: float, hold_out: str | None = None
) -> tuple[Comparison, list[HeldOutGroup]]:
    """A model of the real board, fitted to the few records in which it warms up."""
    lines = (ROOT / "data" / "heater-board-steps.csv").read_text("utf-8").splitlines(keepends=True)
    kept = [one for one in lines if one.startswith(("#", "time")) or one.split(",")[1] in RECORDS]
    (folder / "few.csv").write_text("".join(kept), "utf-8")
    rig = ROOT / "rigs" / "heater-board.yaml"
    done = import_file(folder / "few.csv", load_rig(rig), folder / "runs")
    path = folder / "board.yaml"
    path.write_text(MODEL.format(rig=rig.as_posix(), convection=convection), "utf-8")
    run, model = rigctl.open_run(done.path), rigctl.load_model(path)
    compared = compare([run], [model], only="heater_1 > 0 %", hold_out=hold_out)
    return compared, list(unseen(compared, compared.models[0]))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> list[HeldOutGroup]:
    return judged(tmp_path_factory.mktemp("unseen"), 5.05, hold_out="heater_1 == 50 %")[1]


def test_unseen_records_are_grouped_by_the_reason_they_were_left_out(found: list[HeldOutGroup]) -> None:
    held_out, cooling = found
    assert (held_out.why, held_out.condition, len(held_out.records)) == ("hold_out", "heater_1 == 50 %", 1)
    assert (cooling.why, cooling.condition, len(cooling.records)) == ("only", "heater_1 > 0 %", 2)
    assert cooling.where.startswith("heater_1 0 %")


def test_an_equally_good_group_is_reported_with_errors_and_noise(found: list[HeldOutGroup]) -> None:
    held_out = found[0]
    assert held_out.as_good
    assert held_out.remedies == ()
    assert re.fullmatch(
        r"On the 1 record held out by 'heater_1 == 50 %' the model is as good as where it was fitted: "
        r"temperature_1 [\d.]+ K \(fitted [\d.]+, noise [\d.]+\), temperature_2 .*",
        held_out.statement,
    )


def test_a_start_not_at_rest_is_a_remedy_for_the_cooling_records(found: list[HeldOutGroup]) -> None:
    """The heating element is warm at the start of a cooling record, but cold in the model."""
    cooling = found[1]
    assert cooling.worse[0] == "temperature_1"
    stretches = cooling.course["temperature_1"]
    assert all(one.start < one.end for one in stretches)
    assert min(one.peak for one in stretches) < -1.0, "the board cools later than the model says"
    assert "In temperature_1 the model is too low by up to" in cooling.statement
    best = cooling.remedies[0]
    assert best.kind in ("starts", "effect")
    starts = next(one for one in cooling.remedies if one.kind == "starts")
    assert starts.names == ("heater_lag",)
    assert starts.rmse["temperature_1"] < cooling.fit.errors["temperature_1"].rmse


def test_the_json_document_agrees_with_the_statement(found: list[HeldOutGroup]) -> None:
    document = found[1].document()
    assert document["statement"] == found[1].statement
    assert document["channels"]["temperature_1"]["unit"] == "K"
    assert [one["kind"] for one in document["remedies"]] == [one.kind for one in found[1].remedies]


DUCT = """
family: duct
states:
  flow: {start: 0 m/s, scale: 0.1 m/s, rate: (gain*damper - flow)/lag}
inputs:
  damper: {value: 0 %}
parameters:
  gain: {value: 1.8 m/s, bounds: [0.1 m/s, 10 m/s]}
  lag: {value: 0.3 s, bounds: [10 ms, 10 s]}
outputs:
  flow: {unit: m/s, formula: flow}
"""
DUCT_RIG = """
name: duct
model: family.yaml
channels:
  flow: {{unit: m/s, quantity: speed, noise: 0.01 m/s, calibration: {{uncertainty: 0.2 m/s{kind}}}}}
actuators:
  damper: {{kind: level, unit: "%", low: 0 %, high: 100 %}}
safe_state: {{damper: 0 %}}
"""
DUCT_MODEL = """
model: family.yaml
rig: rig.yaml
parameters: {gain: {value: 1.8 m/s, fit: true}, lag: {value: 0.3 s, fit: true}}
"""


def flow_meter(folder: Path, kind: str, zeros: tuple[float, float, float]) -> HeldOutGroup:
    """The record that was not selected, of three of a duct whose flow meter has a zero error in each."""
    texts = {"family": DUCT, "rig": DUCT_RIG.format(kind=kind), "model": DUCT_MODEL}
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, "utf-8")
    times, rng = np.arange(0.0, 4.0, 0.02), np.random.default_rng(8)
    lines = ["time [s],record,damper [%],flow [m/s]"]
    for record, (level, zero) in enumerate(zip((0.3, 0.6, 0.9), zeros, strict=True)):
        flow = 2.0 * level * (1.0 - np.exp(-np.clip(times - 1.0, 0.0, None) / 0.4)) + zero
        flow += 0.01 * rng.standard_normal(times.size)
        lines += [
            f"{t:.2f},{record},{100.0 * level * (t > 1.0):g},{y:.4f}"
            for t, y in zip(times, flow, strict=True)
        ]
    (folder / "log.csv").write_text("\n".join(lines), "utf-8")
    done = import_file(folder / "log.csv", load_rig(folder / "rig.yaml"), folder / "runs")
    model = rigctl.load_model(folder / "model.yaml")
    compared = compare([rigctl.open_run(done.path)], [model], only="damper < 80 %")
    (group,) = unseen(compared, compared.models[0])
    return group


@pytest.mark.parametrize("kind", [", kind: point", ""], ids=["kind stated", "uncertainty alone"])
def test_an_error_of_a_sensor_is_the_same_in_the_records_not_selected(tmp_path: Path, kind: str) -> None:
    assert flow_meter(tmp_path, kind, (0.15, 0.15, 0.15)).as_good


@pytest.mark.parametrize("kind", [", kind: point", ""], ids=["kind stated", "uncertainty alone"])
def test_another_zero_in_the_records_not_selected_is_seen(tmp_path: Path, kind: str) -> None:
    """One calibration has one error: it is not found anew where the model is to be judged."""
    assert not flow_meter(tmp_path, kind, (0.15, 0.15, -0.1)).as_good


def test_without_a_selection_no_records_are_unseen(tmp_path: Path) -> None:
    lines = (ROOT / "data" / "hl32-viscosity.csv").read_text("utf-8")
    (tmp_path / "viscosity.csv").write_text(lines, "utf-8")
    done = import_file(tmp_path / "viscosity.csv", None, tmp_path / "runs")
    model = rigctl.load_model(ROOT / "models" / "hl32-oil.yaml")
    compared = compare([rigctl.open_run(done.path)], [model])
    assert unseen(compared, compared.models[0]) == ()


def test_the_report_plots_only_groups_that_the_model_predicts_badly(found: list[HeldOutGroup]) -> None:
    (section,) = unseen_sections(found)
    assert section.id == "unseen"
    assert [plot.id for plot in section.plots] == ["unseen-1"], "what is as good needs no picture"
    body = str(section.body)
    assert body.index("as good as where it was fitted") < body.index("misses something")
    assert "109.3 °C" in body
    assert "degC" not in body
    assert unseen_sections([]) == []


def test_a_held_out_setting_of_a_table_has_no_error_course(tmp_path: Path) -> None:
    """Its rows are not a time series, and its setting has a level that the others do not share."""
    rig = ROOT / "rigs" / "hl32-bench.yaml"
    done = import_file(ROOT / "data" / "hl32-strokes.csv", load_rig(rig), tmp_path / "runs")
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    held_out = "pressure == 30 bar"
    compared = compare([rigctl.open_run(done.path)], [model], hold_out=held_out, refit=False)
    (one,) = unseen(compared, compared.models[0])
    assert (one.why, len(one.records)) == ("hold_out", 2)
    assert all(stretches == () for stretches in one.course.values())
    assert {remedy.kind for remedy in one.remedies} <= {"starts", "values"}
