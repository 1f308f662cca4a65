"""The ends of a table: the rows that a fit leaves out are those at the ends, of any quantity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.analysis.fitting import fit_model
from rigctl.analysis.linear.candidates import candidates
from rigctl.analysis.linear.linearisation import Linearisation, linearise
from rigctl.analysis.single_values.findings import end_left_out
from rigctl.analysis.single_values.rows import TableRow, table_rows
from rigctl.answers.findings.tables import findings
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.measured.noise import noise_of
from rigctl.model.measured.read import read_measurements

OFF = 0.9


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Linearisation, tuple[TableRow, ...]]:
    """Viscosity at every other temperature, density between; the density at 80 degC is far off."""
    folder = Path(tmp_path_factory.mktemp("mixed"))
    lines = shipped("data", "hl32-viscosity.csv").read_text("utf-8").splitlines()
    read = [line.split(",") for line in lines if line[:1].isdigit()]
    table = ["oil_temperature [degC],kinematic_viscosity [cSt],density [kg/m^3]"]
    for k, (celsius, viscosity, *_) in enumerate(read):
        density = 870.0 * (1.0 - 7e-4 * (float(celsius) - 15.0)) * (OFF if k == len(read) - 1 else 1.0)
        table.append(f"{celsius},{viscosity}," if k % 2 else f"{celsius},,{density:.2f}")
    (folder / "mixed.csv").write_text("\n".join(table) + "\n", "utf-8", newline="\n")
    model = load_model(shipped("models", "hl32-oil.yaml"))
    run = open_run(str(import_file(folder / "mixed.csv", None, folder / "runs").path))
    measured = read_measurements(model, [run])
    fit = fit_model(model, measured, noise_of(measured))
    whole = fit.problem.rebuilt(model, library=True)
    return linearise(fit, whole, candidates(model)[:1]), table_rows(fit)


def test_the_ends_of_a_table_of_two_quantities_are_left_out(
    mixed: tuple[Linearisation, tuple[TableRow, ...]],
) -> None:
    hot, cold = findings(end_left_out(*mixed))
    assert "the 3 values from 70 degC to 80 degC" in hot
    assert "the 3 values from 20 degC to 30 degC" in cold
    # the law of the density is not fitted, so that the wrong reading remains its error
    assert f"{100 * (1 / OFF - 1):.1f} % (" in hot
    assert "more than measured for density at 80 degC" in hot


def test_an_error_at_a_reading_of_zero_is_given_in_its_unit_instead_of_percent(
    mixed: tuple[Linearisation, tuple[TableRow, ...]],
) -> None:
    linearisation, rows = mixed
    hot, _ = findings(end_left_out(linearisation, [replace(row, measured=0.0) for row in rows]))
    assert "kg/m^3 more than measured for density" in hot
    assert "%" not in hot
