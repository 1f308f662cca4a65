"""A table beside a model: the rows are those of the file, and the predictions those of the law."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.fitting import fit_model
from rigctl.analysis.single_values.rows import TableRow, shows_unfitted, table_rows
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.noise import noise_of
from rigctl.model.measured.read import read_measurements

HELD_OUT = 12
ROW = TableRow(0, True, "60 degC", "kinematic_viscosity", "cSt", 16.0, 15.0, 0.5, 20.0, {})


def file_rows() -> list[dict[str, float]]:
    with shipped("data", "hl32-viscosity.csv").open(encoding="utf-8", newline="") as file:
        return [{name.split()[0]: float(text) for name, text in one.items()} for one in csv.DictReader(file)]


def vogel(celsius: float, a: float, b: float, c: float) -> float:
    """Kinematic viscosity, cSt: ``a·exp(b/(T − c))`` over a density that falls in a straight line."""
    density = 870.0 * (1.0 - 7e-4 * (celsius - 15.0))
    return 1e6 * a * float(np.exp(b / (celsius + 273.15 - c))) / density


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    done = import_file(shipped("data", "hl32-viscosity.csv"), None, Path(tmp_path_factory.mktemp("table")))
    model = load_model(shipped("models", "hl32-oil.yaml"))
    measurements = read_measurements(model, [open_run(str(done.path))])
    return fit_model(model, measurements, noise_of(measurements), (HELD_OUT,))


def of_kinematic(fitted: FitResult) -> list[TableRow]:
    return [row for row in table_rows(fitted) if row.quantity == "kinematic_viscosity"]


def test_every_row_agrees_with_the_file(fitted: FitResult) -> None:
    for row, read in zip(of_kinematic(fitted), file_rows(), strict=True):
        assert row.condition == f"{read['oil_temperature']:g} degC"
        assert (row.unit, row.measured) == ("cSt", pytest.approx(read["kinematic_viscosity"]))
        assert row.beside == {
            "kinematic_viscosity_vogel": pytest.approx(read["kinematic_viscosity_vogel"])
        }, "another law's value stands beside it, and another quantity does not"


def test_predictions_use_the_fitted_and_the_original_constants(fitted: FitResult) -> None:
    found = {u.name: float(v) for u, v in zip(fitted.problem.shared, fitted.values, strict=True)}
    fit = [found[name] for name in ("vogel_a", "vogel_b", "vogel_c")]
    for row, read in zip(of_kinematic(fitted), file_rows(), strict=True):
        celsius = read["oil_temperature"]
        assert row.predicted == pytest.approx(vogel(celsius, *fit), rel=1e-6)
        assert row.unfitted == pytest.approx(vogel(celsius, 3.1083e-5, 1132.5833, 147.4466), rel=1e-6)


def test_a_held_out_row_is_marked(fitted: FitResult) -> None:
    rows = of_kinematic(fitted)
    assert [row.record for row in rows if not row.fitted] == [HELD_OUT]
    assert [row.document()["held_out"] for row in rows] == [row.record == HELD_OUT for row in rows]


def test_sigmas_and_relative_errors_are_model_minus_measurement() -> None:
    assert (ROW.z, ROW.z_unfitted) == (-2.0, 8.0)
    assert (ROW.share(ROW.predicted), ROW.share(20.0)) == (-1 / 16, 0.25)
    assert replace(ROW, unfitted=None).z_unfitted is None


def test_original_constants_that_miss_the_data_by_far_are_not_shown() -> None:
    assert shows_unfitted([ROW])
    assert not shows_unfitted([ROW, replace(ROW, unfitted=30.0)]), "28 sigma off"
    assert not shows_unfitted([replace(ROW, unfitted=None)])


def test_time_series_have_no_rows(fitted: FitResult) -> None:
    measurements = fitted.problem.measurements
    timed = replace(measurements, records=tuple(replace(one, row=False) for one in measurements.records))
    assert table_rows(replace(fitted, problem=replace(fitted.problem, measurements=timed))) == ()
