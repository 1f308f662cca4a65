"""Tables of single values: a correct law is adequate, and one level for all rows of a setting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.comparison import judge
from rigctl.analysis.fitting import fit_model
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.effects.record_level import record_level
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.fit.settings import level_of_rows, setting_scatter, setting_std
from rigctl.model.measured.noise import noise_of
from rigctl.model.measured.read import read_measurements
from rigctl.model.measured.record import Measurements
from rigctl.model.model import Model
from rigctl.rig.load import load_rig

Table = tuple[Model, Measurements]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Table]:
    folder = tmp_path_factory.mktemp("tables")

    def read(name: str) -> Table:
        strokes = name == "strokes"
        rig = load_rig(shipped("rigs", "hl32-bench.yaml")) if strokes else None
        run = import_file(shipped("data", f"hl32-{name}.csv"), rig, Path(folder)).path
        model = load_model(shipped("models", "hl32-textbook.yaml" if strokes else "hl32-oil.yaml"))
        return model, read_measurements(model, [open_run(str(run))])

    return read


def test_a_correct_law_is_adequate_in_ten_draws_of_the_noise(table: Callable[[str], Table]) -> None:
    """13 values with 0.7 % noise, estimated from the same 13. Ten draws show no rate of 1 %."""
    model, measured = table("viscosity")
    truth = fit_model(model, measured, noise_of(measured)).outputs
    rng = np.random.default_rng(8)
    for _ in range(10):
        made = tuple(
            replace(record, values=values * np.exp(0.007 * rng.standard_normal(values.shape)))
            for record, values in zip(measured.records, truth, strict=True)
        )
        again = replace(measured, records=made)
        assert judge(fit_model(model, again, noise_of(again)), "made").adequate


def test_relative_noise_refers_to_the_fitted_model(table: Callable[[str], Table]) -> None:
    model, measured = table("viscosity")
    fit = fit_model(model, measured, noise_of(measured))
    share = fit.problem.noise.channels[0].share
    before = np.concatenate([sigma[:, 0] for sigma in fit.problem.sigma])
    said = np.concatenate([outputs[:, 0] for outputs in fit.outputs])
    assert before == pytest.approx(share * said, rel=1e-3)


def test_the_scatter_of_settings_is_estimated_from_the_table(table: Callable[[str], Table]) -> None:
    model, measured = table("strokes")
    setting = record_level(model.family).setting
    assert setting is not None
    scatter = setting_scatter(measured, setting)
    assert scatter is not None
    assert scatter == pytest.approx(0.14, abs=0.02)  # 40 bar lies 8 % below the curve of the others
    assert setting_std(measured, setting) == pytest.approx(np.hypot(0.005, scatter))


def test_all_rows_of_a_setting_share_one_level(table: Callable[[str], Table]) -> None:
    model, measured = table("strokes")
    level, unknowns = level_of_rows(record_level(model.family), measured)
    assert level.settings == pytest.approx((20e5, 30e5, 40e5, 50e5))
    assert [unknown.name for unknown in unknowns] == [f"record.setting_{k}" for k in (1, 2, 3, 4)]
    fit = fit_model(model, measured, noise_of(measured))
    problem = fit.problem
    names = [unknown.name for unknown in problem.shared]
    moved = fit.values.copy()
    moved[names.index("record.setting_2")] += 0.1
    outputs = problem.simulate(moved, fit.local).require().outputs
    changed = [
        abs(float(after[-1, problem.channels[0]]) - float(before[-1, 0])) > 1e-3
        for after, before in zip(outputs, fit.outputs, strict=True)
    ]
    pressures = [record.condition["relief_valve"] for record in measured.records]
    assert changed == [pressure == pytest.approx(30e5) for pressure in pressures]


def test_time_series_have_no_setting_levels(table: Callable[[str], Table]) -> None:
    model, measured = table("strokes")
    timed = replace(measured, records=tuple(replace(record, row=False) for record in measured.records))
    level, unknowns = level_of_rows(record_level(model.family), timed)
    assert (level.settings, unknowns) == ((), [])
