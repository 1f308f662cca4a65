"""Bootstrap intervals: as wide as the actual scatter, independent of the noise model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commands import answer, refusal, told
from rigctl.analysis.bootstrap import Bootstrap, bootstrap
from rigctl.analysis.comparison import compare
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import FitResult
from rigctl.model.load import load_model
from rigctl.tasks import Workers

#: an oil by Vogel's law, cSt over degC, similar to the shipped table
TEMPERATURES = np.arange(10.0, 90.0, 10.0)


def viscosity(temperature: np.ndarray) -> np.ndarray:
    return 0.0707 * np.exp(911.0 / (temperature + 273.15 - 164.9))


def fitted(folder: Path, shared: float, each: float, readings: int = 2) -> FitResult:
    """So many readings at each temperature, with a shared relative error and an independent one."""
    rng = np.random.default_rng(3)
    lines = ["oil_temperature [degC],kinematic_viscosity [cSt]"]
    for temperature in TEMPERATURES:
        common = shared * rng.normal()
        for _ in range(readings):
            value = viscosity(temperature) * np.exp(common + each * rng.normal())
            lines.append(f"{temperature:g},{value:.6g}")
    table = folder / "oil.csv"
    table.write_text("\n".join(lines) + "\n", "utf-8")
    run = open_run(import_file(table, None, folder / "runs").path)
    return compare([run], [load_model(shipped("models") / "hl32-oil.yaml")]).models[0].fit


def ratios(found: Bootstrap) -> list[float]:
    """Ratio of the bootstrap's scatter to the standard deviations of the fit."""
    return [one.std / one.fit_std for one in found.parameters]


@pytest.fixture(scope="module")
def independent(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return fitted(tmp_path_factory.mktemp("independent"), 0.0, 0.01)


def test_for_independent_noise_the_intervals_match_the_standard_deviations_of_the_fit(
    independent: FitResult,
) -> None:
    found = bootstrap(independent, 20, workers=Workers(1))
    assert (found.by, found.failed) == ("condition", 0)
    assert all(0.6 < ratio < 1.6 for ratio in ratios(found))
    for one in found.parameters:
        assert one.low < one.value < one.high
        assert one.high - one.low == pytest.approx(3.92 * one.std, rel=0.4)


def test_errors_shared_by_the_readings_of_a_condition_widen_the_intervals(tmp_path: Path) -> None:
    found = bootstrap(fitted(tmp_path, 0.02, 0.005, readings=3), 15, workers=Workers(1))
    assert all(ratio > 2.0 for ratio in ratios(found))


def test_the_intervals_do_not_depend_on_the_number_of_workers(independent: FitResult) -> None:
    assert bootstrap(independent, 3, workers=Workers(1)) == bootstrap(independent, 3, workers=Workers(2))


def test_a_bootstrap_needs_more_than_one_record_and_a_fitted_parameter(independent: FitResult) -> None:
    from dataclasses import replace

    with pytest.raises(RigctlError, match=r"two fitted records, better ten, got '1'"):
        bootstrap(replace(independent, fitted=(0,)), 10)
    with pytest.raises(
        RigctlError, match="no parameter was fitted, so there is nothing to bootstrap; expected a model"
    ):
        bootstrap(replace(independent, solution=None), 10)


def test_a_diagnosis_reports_bootstrap_intervals_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    create_project(tmp_path)
    told("import", "data/hl32-viscosity.csv")
    ask = ("diagnose", "latest", "--model", "models/hl32-oil.yaml")
    found = answer(*ask, "--bootstrap", "4", "--workers", "1")["bootstrap"]
    assert (found["repetitions"], found["by"], found["level"]) == (4, "condition", 0.95)
    assert set(found["parameters"]) == {"vogel_a", "vogel_b", "vogel_c"}
    assert "--bootstrap and --apply do not go together" in refusal(*ask, "--bootstrap", "20", "--apply")


def test_options_of_the_bootstrap_are_refused_before_the_diagnosis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A single record was refused after the diagnosis; what distributes the bootstrap was ignored without."""
    monkeypatch.chdir(tmp_path)
    create_project(tmp_path)
    told("import", "data/hl32-viscosity.csv")
    monkeypatch.setattr("rigctl.analysis.diagnosis.diagnose_comparison", None)
    text = Path("models/hl32-oil.yaml").read_text("utf-8")
    for fixed in ("1132.5833 K", "147.4466 K"):
        text = text.replace(f"{fixed}, fit: true", f"{fixed}, fit: false")
    Path("models/one.yaml").write_text(text, "utf-8")
    ask = ("diagnose", "latest", "--model", "models/one.yaml")
    one = ("--bootstrap", "20", "--only", "record == 1")
    assert "at least two fitted records, better ten, got '1'" in refusal(*ask, *one)
    assert "--workers is for --bootstrap, which was not given" in refusal(*ask, "--workers", "2")
    assert "--cluster is for --bootstrap, which was not given" in refusal(*ask, "--cluster", "local:2")
