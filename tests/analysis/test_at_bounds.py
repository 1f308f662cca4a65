"""Record-level unknowns are limited to their bounds in the tests as in the fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.analysis.comparison import compare
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.rig.load import load_rig
from rigctl_validation.benches.bench import BenchCampaign, write_bench
from rigctl_validation.benches.register import find_bench


def imported(folder: Path, higher: float) -> tuple[Run, Model]:
    """A mass on a spring with an unrecorded push of at most 3 N or 5 mm; record 3 reads `higher` mm more."""
    log = write_bench(BenchCampaign(find_bench("spring"), 0.0, "slow", False, "white", 3), folder)
    heading, *rows = (line.split(",") for line in log.read_text(encoding="utf-8").splitlines())
    for row in rows:
        if row[1] == "3":
            row[-1] = f"{float(row[-1]) + higher:.9g}"
    log.write_text("\n".join(",".join(row) for row in [heading, *rows]) + "\n", encoding="utf-8")
    run = import_file(log, load_rig(folder / "rig.yaml"), folder / "runs").path
    return open_run(run), load_model(folder / "model.yaml")


def compared(run: Run, model: Model, *, refit: bool) -> ModelComparison:
    return compare([run], [model], refit=refit).models[0]


def test_a_record_beyond_the_bounds_of_its_unknowns_fails_the_chi_squared_test(tmp_path: Path) -> None:
    run, model = imported(tmp_path / "fine", 2.0)
    fine = compared(run, model, refit=True)
    assert fine.adequate
    known = fine.fit.model
    assert compared(run, known, refit=False).adequate
    far, _ = imported(tmp_path / "far", 20.0)
    for found in (compared(far, model, refit=True), compared(far, known, refit=False)):
        tests = found.adequacy.tests
        assert tests["chi2"].p_value < 1e-6
        # the residuals of the fit, not those with unbounded unknowns
        assert tests["chi2"].statistic == pytest.approx(found.fit.chi2_reduced * tests["chi2"].dof, rel=0.02)
