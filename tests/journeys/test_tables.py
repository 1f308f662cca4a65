"""Tables of single values, from the import to a page: published viscosities and strokes, and made ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from commands import MODEL, answer, told
from rigctl.cli.commands.init import create_project
from rigctl.cli.main import app

OIL = "models/hl32-oil.yaml"
#: the only effects that can reverse the sign of the trend of the published strokes
CLASS = {
    "valve_delay_thermal",
    "relief_thermal_drift",
    "flow_area_thermal_drift",
    "position_thermal_drift",
}
TEMPERATURES = np.arange(20.0, 81.0, 5.0)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    create_project(folder)
    return folder


@pytest.fixture(autouse=True)
def wide(inside: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal wide enough for a table with all its columns."""
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture(scope="module")
def viscosity(bench: Path) -> str:
    return imported(bench, "data/hl32-viscosity.csv")


@pytest.fixture(scope="module")
def strokes(bench: Path) -> str:
    return imported(bench, "data/hl32-strokes.csv", "--rig", "rigs/hl32-bench.yaml")


@pytest.fixture(scope="module")
def diagnosed(bench: Path, strokes: str) -> dict[str, Any]:
    """The published strokes, diagnosed with the textbook model, and put on a page."""
    with chdir(bench):
        return answer("diagnose", strokes, "--model", MODEL, "--design", "-o", "strokes.html")


def imported(folder: Path, *arguments: str) -> str:
    with chdir(folder):
        return str(answer("import", *arguments)["run"])


def made(name: str, heading: str, rows: Sequence[tuple[float | None, ...]], *more: str) -> str:
    """Import a synthetic table."""
    cells = (",".join("" if cell is None else f"{cell:.5g}" for cell in row) for row in rows)
    Path(name).write_text("\n".join([heading, *cells]) + "\n", encoding="utf-8", newline="\n")
    return str(answer("import", name, *more)["run"])


def vogel(temperature: float) -> float:
    """cSt, of HL32 by the printed constants."""
    dynamic = 3.1083e-5 * np.exp(1132.5833 / (temperature + 273.15 - 147.4466))
    return float(1e6 * dynamic / (870.0 * (1.0 - 7e-4 * (temperature - 15.0))))


def test_the_published_viscosities_agree_with_vogels_law_once_fitted(viscosity: str) -> None:
    found = answer("compare", viscosity, "--model", OIL)
    assert found["adequate"]
    assert list(found["channels"]) == ["kinematic_viscosity"]  # the other was computed from it
    channel = found["channels"]["kinematic_viscosity"]
    assert channel["unit"] == "cSt"
    assert channel["noise_share"] == pytest.approx(0.0072, abs=1e-4)
    assert any("dynamic_viscosity" in note and "computed from" in note for note in found["notes"])
    assert any("0.72 % of the value" in note for note in found["notes"])
    rows = found["rows"]
    assert [row["condition"] for row in rows[:2]] == ["20 degC", "25 degC"]
    hot = rows[-1]
    assert (hot["condition"], hot["measured"]) == ("80 degC", pytest.approx(9.5))
    assert hot["unfitted"] == pytest.approx(hot["beside"]["kinematic_viscosity_vogel"], rel=1e-4)
    before = (hot["unfitted"] - hot["measured"]) / hot["noise"]
    assert before == pytest.approx(-4.2, abs=0.2)  # 3.1 % at the hot end by the printed constants
    assert abs(hot["z"]) < 1.5  # which a refit of the constants removes
    assert {place["by"] for place in found["where"]} == {"channel", "condition"}
    said = " ".join(found["findings"])
    for words in ("13 values for 3 fitted constants", "one of the constants", "Fitted without the 3 values"):
        assert words in said


def test_a_table_is_printed_by_condition_in_the_units_of_its_file(viscosity: str) -> None:
    shown = told("compare", viscosity, "--model", OIL, "-v")
    for words in ("agrees with the 13 values", "80 degC", "[cSt]", "as in its file", "vogel", "0.72 %"):
        assert words in shown
    assert not re.search(r"line \d", shown)
    assert "m^2/s" not in shown


def test_vogels_law_fails_on_held_out_values_at_high_temperature(viscosity: str) -> None:
    found = answer("compare", viscosity, "--model", OIL, "--hold-out", "oil_temperature > 65 degC")
    out = [row for row in found["rows"] if row["held_out"]]
    assert [row["condition"] for row in out] == ["70 degC", "75 degC", "80 degC"]
    assert all(row["z"] < -2.0 for row in out)
    assert "Of the 3 values held out, at 80 degC" in " ".join(found["findings"])


def test_the_undecidable_effect_and_the_measurements_that_would_decide_are_listed(viscosity: str) -> None:
    found = answer("diagnose", viscosity, "--model", OIL)
    assert found["verdict"] == "adequate"
    assert "capillary_end_correction" in " ".join(found["findings"])
    steps = " ".join(found["next_steps"])
    assert "at 100 degC too" in steps
    assert re.search(r"read each condition \d times", steps)


def test_the_page_of_a_table_has_no_time_axis(viscosity: str) -> None:
    told("report", viscosity, "--model", OIL, "--diagnose", "-o", "viscosity.html")
    page = Path("viscosity.html").read_text(encoding="utf-8")
    for words in ("What these data can and cannot tell", "What to measure next", "over oil temperature [°C]"):
        assert words in page
    assert "time in the record" not in page
    assert "</b> samples" not in page
    assert "ΔmBIC" not in page  # no effect is missing


def test_the_textbook_model_has_the_wrong_trend_for_the_published_strokes(strokes: str) -> None:
    found = answer("compare", strokes, "--model", MODEL)
    assert not found["adequate"]
    assert "the wrong direction" in found["statement"]
    assert found["trends"][0]["wrong_sign"]
    assert found["channels"]["position"]["unit"] == "mm"
    assert {row["quantity"] for row in found["rows"]} == {"stroke"}
    assert found["rows"][-1]["condition"] == "60 degC, 50 bar"
    assert "share an offset" in " ".join(found["findings"])


def test_strokes_imported_without_their_rig_get_the_same_comparison(bench: Path, strokes: str) -> None:
    """The pressure of each row used to be ignored, and a load of 9.5 kN to be named instead, at 88 sigma."""
    bare = imported(bench, "data/hl32-strokes.csv")
    found, same = (answer("compare", run, "--model", MODEL) for run in (bare, strokes))
    assert found["rows"] == same["rows"]
    assert found["statement"] == same["statement"]
    assert found["findings"] == same["findings"]


def test_only_models_that_predict_a_column_of_the_table_are_suggested(bench: Path) -> None:
    for file, suggested in (
        ("hl32-strokes.csv", "rigctl report latest"),
        ("hl32-viscosity.csv", "rigctl compare latest --model models/hl32-oil.yaml"),
    ):
        said = CliRunner().invoke(app, ["import", f"data/{file}"]).stderr
        assert f"Next: {suggested}\n" in said


def test_the_published_strokes_leave_the_class_that_corrects_the_trend(
    diagnosed: dict[str, Any],
) -> None:
    assert diagnosed["verdict"] == "ambiguous"
    assert [set(names) for names in diagnosed["classes"]] == [CLASS]
    excluded = {one["effect"]: one for one in diagnosed["excluded"]}
    for name in ("piston_leakage", "rod_leakage", "valve_leakage", "laminar_throttle", "viscous_friction"):
        assert name in excluded
    for name in ("coulomb_friction", "entrained_air", "relief_override", "stribeck_friction"):
        assert excluded[name]["reached"] < 0.25
    assert excluded["pump_slip"]["only"] == ["50 bar"]
    assert not CLASS & set(excluded)
    sizes = {one["effect"]: one["parameters"]["coefficient"]["value"] for one in diagnosed["ranking"][:4]}
    assert sizes["valve_delay_thermal"] == pytest.approx(1.9, abs=0.15)  # 75 ms in 40 K
    assert sizes["relief_thermal_drift"] == pytest.approx(0.003, abs=3e-4)


def test_the_next_measurements_after_the_strokes_are_listed_in_words(diagnosed: dict[str, Any]) -> None:
    steps = " ".join(diagnosed["next_steps"])
    assert "record supply_pressure over time: it distinguishes relief_thermal_drift from the others" in steps
    assert "record position over time instead of one number: it distinguishes valve_delay_thermal" in steps
    assert "pressure_b" in steps  # a channel that the bench could have
    assert "more values of oil_temperature than 20 degC and 60 degC" in steps
    assert "repeat each condition" in steps
    page = Path("strokes.html").read_text(encoding="utf-8")
    for words in ("What is excluded", "What to measure next", "stroke over oil temperature"):
        assert words.casefold() in page.casefold()
    assert "time in the record" not in page


def test_the_next_rows_after_the_strokes_are_designed_for_separation(diagnosed: dict[str, Any]) -> None:
    """A drift of the sensor and one of the throttle change every stroke alike: no row can tell them apart."""
    designed = diagnosed["next_experiment"]
    assert designed["procedure"] is None
    assert {frozenset(pair) for pair in designed["separates"]} >= {
        frozenset(("position_thermal_drift", "flow_area_thermal_drift"))
    }
    assert designed["probability"] < 0.5
    assert 0 < len(designed["records"]) <= 4
    for row in designed["records"]:
        assert row["steps"] == ["read stroke"]
        assert 5.0 <= float(row["settings"]["oil_temperature"].split()[0]) <= 85.0
        assert 10.0 <= float(row["settings"]["relief_valve"].split()[0]) <= 55.0
    first = designed["records"][0]
    assert first["expected_separation"] > first["separation_of_repeat"]


def test_a_capillary_end_correction_is_found_in_repeated_readings() -> None:
    rng = np.random.default_rng(5)
    rows = []
    for temperature in np.repeat(np.arange(0.0, 101.0, 10.0), 3).tolist():
        true = vogel(temperature)
        read = true + 2.0 * 15.0 / (true + np.sqrt(true**2 + 4.0 * 15.0))
        rows.append((temperature, read * np.exp(0.004 * rng.standard_normal())))
    run = made("capillary.csv", "oil_temperature [degC],kinematic_viscosity [cSt]", rows)
    found = answer("diagnose", run, "--model", OIL)
    assert (found["verdict"], found["effects"]) == ("missing_effect", ["capillary_end_correction"])
    size = found["ranking"][0]["parameters"]["correction"]
    assert abs(size["value"] - 15.0) < 4.0 * size["std"]


def test_empty_cells_are_left_out() -> None:
    rng = np.random.default_rng(6)
    rows = [
        (t, None if t in (35.0, 70.0) else vogel(t) * np.exp(0.007 * rng.standard_normal()))
        for t in TEMPERATURES.tolist()
    ]
    run = made("gaps.csv", "oil_temperature [degC],kinematic_viscosity [cSt]", rows)
    found = answer("compare", run, "--model", OIL)
    assert (found["adequate"], len(found["rows"])) == (True, 11)


def test_values_at_one_condition_are_identified_by_their_record() -> None:
    rng = np.random.default_rng(7)
    rows = [(40.0, vogel(40.0) * (1.0 + 0.01 * rng.standard_normal())) for _ in range(8)]
    run = made("same.csv", "oil_temperature [degC],kinematic_viscosity [cSt]", rows)
    found = answer("compare", run, "--model", OIL)
    assert found["rows"][2]["condition"] == "record 2"
    assert found["channels"]["kinematic_viscosity"]["noise_source"] == "replicates"


def test_the_record_number_of_compare_is_the_number_that_runs_exclude_takes() -> None:
    """The worst record of compare is the one that 'runs exclude' leaves out."""
    rng = np.random.default_rng(11)
    rows = [(40.0, vogel(40.0) * (1.0 + 0.01 * rng.standard_normal())) for _ in range(8)]
    rows[5] = (40.0, 2.0 * vogel(40.0))
    run = made("worst.csv", "oil_temperature [degC],kinematic_viscosity [cSt]", rows)
    found = answer("compare", run, "--model", OIL)["rows"]
    worst = max(found, key=lambda row: abs(row["measured"] - row["model"]))
    number = worst["condition"].removeprefix("record ")
    told("runs", "exclude", run, number, "--reason", "mistyped")
    listed = answer("runs", "show", run)["records"]
    assert [entry["record"] for entry in listed if entry["excluded"]] == [int(number)] == [5]
    assert len(answer("compare", run, "--model", OIL)["rows"]) == 7
