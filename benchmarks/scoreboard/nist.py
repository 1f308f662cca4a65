"""The nonlinear regressions of NIST's Statistical Reference Datasets, fitted by rigctl's own least squares.

Every file has two starts, certified values to eleven digits and their data. The residuals are analytic
functions of the parameters, so a complex step gives their derivatives to the last digit:
``df/db = Im f(b + ih)/h``.

Sources: NIST/ITL Statistical Reference Datasets, nonlinear regression, public domain; W. Squire, G. Trapp,
Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998) 110.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import Block, Options, Refused, Unknown, least_squares
from rigctl.errors import RigctlError

#: parameters b and predictor x (or predictors) to the response; complex b gives complex values
Formula = Callable[[NDArray[Any], NDArray[np.float64]], NDArray[Any]]
#: far below the digits that are compared, and more iterations than a fit of a bench is allowed
_OPTIONS = Options(cost=1e-14, step=1e-10, gradient=1e-13, iterations=2000)
_STEP = 1e-30
_DIGITS = 11.0  # of the certified values


def _ratio(above: int) -> Formula:
    """A polynomial over another with the constant 1: the first `above` parameters belong to the numerator."""

    def value(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
        return np.polyval(b[:above][::-1], x) / np.polyval([*b[above:][::-1], 1.0], x)

    return value


def _exponentials(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _peaks(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
    first = b[2] * np.exp(-(((x - b[3]) / b[4]) ** 2))
    return b[0] * np.exp(-b[1] * x) + first + b[5] * np.exp(-(((x - b[6]) / b[7]) ** 2))


def _saturating(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
    return b[0] * (1.0 - np.exp(-b[1] * x))


def _ultrasonic(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


def _pressures(b: NDArray[Any], x: NDArray[np.float64]) -> NDArray[Any]:
    turn = 2.0 * np.pi * x
    year = b[0] + b[1] * np.cos(turn / 12.0) + b[2] * np.sin(turn / 12.0)
    slow = b[4] * np.cos(turn / b[3]) + b[5] * np.sin(turn / b[3])
    return year + slow + b[7] * np.cos(turn / b[6]) + b[8] * np.sin(turn / b[6])


FORMULAS: dict[str, Formula] = {
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1.0 / b[2]),
    "BoxBOD": _saturating,
    "Chwirut1": _ultrasonic,
    "Chwirut2": _ultrasonic,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": _pressures,
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _peaks,
    "Gauss2": _peaks,
    "Gauss3": _peaks,
    "Hahn1": _ratio(4),
    "Kirby2": _ratio(3),
    "Lanczos1": _exponentials,
    "Lanczos2": _exponentials,
    "Lanczos3": _exponentials,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Misra1a": _saturating,
    "Misra1b": lambda b, x: b[0] * (1.0 - (1.0 + b[1] * x / 2.0) ** (-2)),
    "Misra1c": lambda b, x: b[0] * (1.0 - (1.0 + 2.0 * b[1] * x) ** (-0.5)),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1.0 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1.0 + np.exp(b[1] - b[2] * x)) ** (1.0 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": _ratio(4),
}


@dataclass(frozen=True)
class Problem:
    """A regression as NIST certifies it.

    Attributes
    ----------
    starts: (2, p) both starting points.
    certified: (p) values to eleven digits.
    x: (n), or (2, n) with two predictors.
    y: (n) the response; its logarithm where that is what the model gives.
    """

    name: str
    starts: NDArray[np.float64]
    certified: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


@dataclass(frozen=True)
class Fitted:
    """A fit from one of a problem's starts; `digits` are those of its worst parameter, 0 for a failure."""

    name: str
    start: int
    digits: float
    iterations: int
    milliseconds: float


def read_problem(path: Path) -> Problem:
    """Read a file of NIST."""
    text = path.read_text(encoding="latin-1")
    number = r"\s+(\S+)"
    rows = re.findall(rf"^\s*b\d+\s*={number * 3}", text, re.MULTILINE)
    first, second, certified = np.array(rows, dtype=float).T
    table = text[text.rindex("Data:") :].split("\n", 1)[1]
    y, *x = np.array([line.split() for line in table.splitlines() if line.strip()], dtype=float).T
    named = path.stem
    response = np.log(y) if named == "Nelson" else y
    return Problem(
        named, np.array([first, second]), certified, x[0] if len(x) == 1 else np.array(x), response
    )


def fit(problem: Problem, start: int) -> Fitted:
    """Fit from the first (0) or the second (1) start; a failure has no right digit."""
    formula, spread = FORMULAS[problem.name], float(np.std(problem.y))

    def evaluate(
        b: NDArray[np.float64], _local: Sequence[NDArray[np.float64]], derivatives: bool
    ) -> Sequence[Block] | Refused:
        with np.errstate(all="ignore"):
            residual = (formula(b, problem.x) - problem.y) / spread
            if not np.isfinite(residual).all():
                return Refused("the formula has no finite value")
            if not derivatives:
                return [Block(residual)]
            ahead = b + 1j * np.diag(_STEP * np.where(b == 0.0, 1.0, np.abs(b)))
            columns = [formula(row, problem.x).imag / row[k].imag / spread for k, row in enumerate(ahead)]
        if not np.isfinite(columns).all():
            return Refused("the formula has no finite derivative")
        return [Block(residual, np.column_stack(columns), np.empty((residual.size, 0)))]

    unknowns = [Unknown(f"b{k + 1}", float(value)) for k, value in enumerate(problem.starts[start])]
    began = time.perf_counter()
    try:
        found = least_squares(evaluate, unknowns, [()], options=_OPTIONS)
    except RigctlError:
        return Fitted(problem.name, start + 1, 0.0, 0, 1e3 * (time.perf_counter() - began))
    taken = 1e3 * (time.perf_counter() - began)
    error = np.abs(found.values / problem.certified - 1.0).max()
    digits = float(np.clip(-np.log10(max(error, 1e-16)), 0.0, _DIGITS))
    return Fitted(problem.name, start + 1, digits, found.iterations, taken)


def fits(folder: Path) -> list[Fitted]:
    """Every problem from both starts, in the order of their names."""
    paths = sorted(folder.glob("*.dat"))
    missing = sorted(set(FORMULAS) - {path.stem for path in paths})
    if missing:
        raise SystemExit(f"{folder}: there is no {missing[0]}.dat; see benchmarks/real/README.md")
    return [fit(read_problem(path), start) for path in paths if path.stem in FORMULAS for start in (0, 1)]
