"""A table of strokes that lacks a set-point: the assumed value is reported, and can be given."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.dataset.importing import import_file
from rigctl.dataset.run import Run, open_run
from rigctl.files.shipped import shipped
from rigctl.model import Model, load_model
from rigctl.model.measured.assumed import assuming
from rigctl.model.measured.read import read_measurements
from rigctl.model.measured.record import Measurements


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(shipped("models") / "hl32-textbook.yaml")


def table(folder: Path, text: str, model: Model) -> Run:
    (folder / "strokes.csv").write_text(text, encoding="utf-8")
    assert model.rig is not None
    return open_run(str(import_file(folder / "strokes.csv", model.rig, folder / "runs").path))


def pressures(measured: Measurements) -> list[float]:
    """The largest commanded pressure of each row, bar."""
    column = measured.inputs.index("pressure_setpoint")
    return [record.inputs[:, column].max() / 1e5 for record in measured.records]


def test_a_missing_pressure_is_reported_and_can_be_assumed(tmp_path: Path, model: Model) -> None:
    run = table(tmp_path, "oil_temperature [degC],stroke [mm]\n20,125\n60,119\n", model)
    silent = read_measurements(model, [run])
    assert pressures(silent) == pytest.approx([50.0, 50.0])
    assert "not recorded: pressure_setpoint; taken as 50 bar" in " ".join(map(str, silent.notes))
    for said in ("pressure_setpoint=30 bar", "relief_valve=30 bar"):
        given = read_measurements(model, [assuming(run, model, [said])])
        assert pressures(given) == pytest.approx([30.0, 30.0])
        assert "30 bar" in " ".join(map(str, given.notes))
        assert "taken as" not in " ".join(map(str, given.notes))


def test_a_missing_oil_temperature_is_reported(tmp_path: Path, model: Model) -> None:
    text = "pressure_setpoint [bar],stroke [mm]\n20,77\n30,97\n40,100\n50,125\n"
    measured = read_measurements(model, [table(tmp_path, text, model)])
    assert pressures(measured) == pytest.approx([20.0, 30.0, 40.0, 50.0])
    assert [str(note) for note in measured.notes if "not recorded" in str(note)] == [
        "not recorded: oil_temperature; taken as 20 degC in rows without it, a column of that name says "
        "otherwise"
    ]


def test_a_table_with_all_set_points_gives_no_note(tmp_path: Path, model: Model) -> None:
    text = "oil_temperature [degC],pressure_setpoint [bar],stroke [mm]\n20,30,97\n60,50,119\n"
    measured = read_measurements(model, [table(tmp_path, text, model)])
    assert pressures(measured) == pytest.approx([30.0, 50.0])
    assert not [str(note) for note in measured.notes if "not recorded" in str(note)]
