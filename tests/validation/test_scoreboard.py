"""The scoreboard of public benchmarks: files of NIST are read, fits are judged by certified digits."""

from __future__ import annotations

import json
import os
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from benchmarks.scoreboard.discrimination import searched
from benchmarks.scoreboard.nist import FORMULAS, fit, fits, read_problem
from benchmarks.scoreboard.page import RESULTS, page
from benchmarks.scoreboard.rival_cases import CASES, Case, table
from scipy.optimize import curve_fit

from commands import answer, call
from rigctl.analysis.fitting import fit_to_data, read_runs
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.model import load_model
from rigctl_validation.real.logs import FOLDER_VARIABLE

_FILE = """NIST/ITL StRD
Dataset Name:  BoxBOD            (BoxBOD.dat)
Data:          1 Response  (y)
               1 Predictor (x)
               y = b1*(1-exp[-b2*x])  +  e

        Start 1     Start 2           Parameter     Standard Deviation
  b1 =   100         150           {:.10E}  1.0E+01
  b2 =     0.75        0.5         {:.10E}  1.0E-01

Data:   y               x
{}
"""


def test_a_fit_has_the_digits_by_which_scipy_agrees(tmp_path: Path) -> None:
    x = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0])
    y = 214.0 * (1.0 - np.exp(-0.55 * x)) + np.array([3.0, -7.0, 9.0, -8.0, 5.0, -1.0])

    def model(x: object, b1: float, b2: float) -> object:
        return b1 * (1.0 - np.exp(-b2 * np.asarray(x)))

    found, _ = curve_fit(model, x, y, p0=[200.0, 0.5], ftol=1e-15, xtol=1e-15, gtol=1e-15)
    rows = "\n".join(f"  {one:.12g}  {other:.12g}" for one, other in zip(y, x, strict=True))
    path = tmp_path / "BoxBOD.dat"
    path.write_text(_FILE.format(*found, rows), encoding="utf-8")
    problem = read_problem(path)
    assert problem.starts.tolist() == [[100.0, 0.75], [150.0, 0.5]]
    assert np.array_equal(problem.x, x)
    assert all(fit(problem, start).digits >= 6.0 for start in (0, 1))
    path.write_text(_FILE.format(found[0], 1.01 * found[1], rows), encoding="utf-8")
    assert fit(read_problem(path), 0).digits == pytest.approx(2.0, abs=0.1)


def test_a_folder_without_a_problem_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"there is no Bennett5\.dat"):
        fits(tmp_path)


@pytest.mark.skipif(FOLDER_VARIABLE not in os.environ, reason=f"{FOLDER_VARIABLE} names no folder of logs")
def test_certified_regressions_are_solved_from_both_starts() -> None:
    folder = Path(os.environ[FOLDER_VARIABLE]) / "nist"
    if not folder.is_dir():
        pytest.skip("the folder of logs has no files of NIST")
    far = {("BoxBOD", 0), ("MGH10", 0)}  # starts from which this method ends elsewhere
    for name in FORMULAS.keys() - {"Bennett5", "MGH17"}:  # hundreds of iterations each
        problem = read_problem(folder / f"{name}.dat")
        for start in {0, 1} - {start for other, start in far if other == name}:
            assert fit(problem, start).digits >= 6.0, (name, start)


def _errors(case: Case, folder: Path) -> dict[str, float]:
    """The largest error of each rival fitted to many rows without noise, over the noise of the reading."""
    models = [load_model(path) for path in case.write(folder)]
    settings = case.settings_at_random(24, np.random.default_rng(5))
    path = folder / "exact.csv"
    path.write_text(
        table([*case.ranges, *case.noise], np.hstack([settings, case.truth(settings)])), encoding="utf-8"
    )
    run = open_run(import_file(path, models[0].rig, folder / "runs").path)
    fitted = {model.name: fit_to_data(model, read_runs(model, [run])) for model in models}
    return {
        name: max(one.errors[reading].rmse / sigma for reading, sigma in case.noise.items())
        for name, one in fitted.items()
    }


@pytest.mark.parametrize("name", sorted(CASES))
def test_the_right_rival_alone_reproduces_a_case_that_was_computed_without_rigctl(
    tmp_path: Path, name: str
) -> None:
    case = CASES[name]()
    errors = _errors(case, tmp_path)
    same = {case.right} | ({"M4"} if name == "vthr2014linear" else set())  # M4 has one term more
    assert errors.keys() == case.rivals.keys()
    for rival, error in errors.items():
        assert error < 0.01 if rival in same else error > 0.02, (rival, error)


def test_a_search_by_commands_finds_the_right_rival(tmp_path: Path) -> None:
    case, rng = CASES["mixing-M3"](), np.random.default_rng(1)
    settings = case.settings_at_random(case.first, rng)
    readings = case.measure(settings, rng)
    models = [word for path in case.write(tmp_path) for word in ("--model", str(path))]
    with chdir(tmp_path):
        assert call("init").exit_code == 0
        for _ in range(10):
            Path("so-far.csv").write_text(
                table([*case.ranges, *case.noise], np.hstack([settings, readings])), encoding="utf-8"
            )
            run = answer("import", "so-far.csv", "--rig", "rig.yaml")["run"]
            done = call("design", run, *models, "--records", "1", "--json")
            if done.exit_code:
                break
            (row,) = json.loads(done.stdout)["records"]
            point = np.array([[float(row["settings"][each]) for each in case.ranges]])
            settings = np.vstack([settings, point])
            readings = np.vstack([readings, case.measure(point, rng)])
    assert "nothing is left to distinguish: the odds of M3 against" in str(done.exception)


def test_searches_are_counted_by_what_they_name() -> None:
    found = searched(CASES["msm2010"](), range(1), designed=True)
    assert (found["named"], found["right"], found["rivals"]) == (["M9"], "M9", 10)
    stored = json.loads(RESULTS.read_text(encoding="utf-8"))["results"]["discrimination"]
    assert all({*one["named"]} <= {"", *(f"M{k}" for k in range(1, 11))} for one in stored)
    assert f"{sum(len(one['named']) for one in stored if one['designed'])} searches" in page()
