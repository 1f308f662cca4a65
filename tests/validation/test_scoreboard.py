"""The scoreboard of public benchmarks: files of NIST are read, fits are judged by certified digits."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from benchmarks.scoreboard.nist import FORMULAS, fit, fits, read_problem
from scipy.optimize import curve_fit

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
