"""Parameters of which the data determine only combinations: which act, and which to fix."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from commands import answer, told
from oven import CONDUCTANCE, HEAT_CAPACITY, oven_project
from rigctl.analysis.comparison import compare
from rigctl.analysis.diagnosis import diagnose
from rigctl.engine.least_squares.identifiability import Combination, weak_combinations
from rigctl.model.fit import undetermined as module
from rigctl.model.load import load_model

T = TypeVar("T")
FREE = {"gain": "1", "heat_capacity": "100 J/K", "conductance": "1.5 W/K", "room": "20 degC"}
FIRST = (
    "only gain/conductance and heat_capacity/conductance act: "
    "fix or measure one of gain, heat_capacity, conductance"
)


def test_ratios_that_act_are_named_first(tmp_path: Path) -> None:
    run, model = oven_project(tmp_path, FREE)
    found = diagnose([run], model)
    assert found.first == found.before.first == (FIRST,)
    (group,) = found.document()["undetermined"]
    assert group["parameters"] == ["gain", "heat_capacity", "conductance"]
    assert (group["to_fix"], group["acting"]) == (1, ["gain/conductance", "heat_capacity/conductance"])
    parameters = found.before.document()["parameters"]
    assert parameters["gain"]["std"] is None and parameters["room"]["std"] > 0.0
    ratio = parameters["heat_capacity"]["value"] / parameters["conductance"]["value"]
    assert ratio == pytest.approx(HEAT_CAPACITY / CONDUCTANCE, rel=0.01)


def test_nothing_is_said_once_one_of_them_is_fixed(tmp_path: Path) -> None:
    run, model = oven_project(tmp_path, {name: FREE[name] for name in ("heat_capacity", "conductance")})
    (found,) = compare([run], [model]).models
    assert found.first == () and found.document()["undetermined"] == []


def test_their_numbers_have_no_six_digits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    oven_project(tmp_path, FREE)
    monkeypatch.chdir(tmp_path)
    printed = told("model", "fit", "models/oven.yaml", "latest", "-v")
    assert printed.startswith(FIRST)
    assert "gain 0.95 not determined" in printed
    shown = told("model", "show", "models/oven.yaml")
    assert re.search(r"heat_capacity +\d{2,3} +not determined", shown)
    assert load_model(tmp_path / "models/oven.yaml").parameters["gain"].undetermined
    told("model", "set", "models/oven.yaml", "gain=1")
    assert not load_model(tmp_path / "models/oven.yaml").parameters["gain"].undetermined
    assert answer("compare", "latest", "--model", "models/oven.yaml", "--no-fit")["undetermined"] == []


@pytest.mark.parametrize(
    ("directions", "units", "acting"),
    [
        ([[1, 1, 0]], "1 J/K W/K", ("p/q", "r")),
        ([[1, -1, 0]], "1 J/K W/K", ("p*q", "r")),
        ([[2, 0, 1]], "1 J/K W/K", ("p/r^2", "q")),
        ([[0, 1, 2]], "1 J/K W/K", ("p", "q^2/r")),
        ([[1, 1, 1], [1, 0, -1]], "1 J/K W/K", ("p*r/q^2",)),
        ([[1, 0.37, 0]], "1 J/K W/K", ()),
    ],
)
def test_products_are_read_from_the_directions_without_effect(
    directions: list[list[float]], units: str, acting: tuple[str, ...]
) -> None:
    names, values = ["p", "q", "r"], np.array([2.0, -30.0, 0.4])
    weak = _weak(np.array(directions) * values, names)
    found = module._acting(
        names, weak, dict(zip(names, values, strict=True)), dict(zip(names, units.split(), strict=True))
    )
    assert found == acting


def test_sums_act_where_products_do_not() -> None:
    names, values = ["room", "zero"], np.array([293.0, 0.2])
    weak = _weak(np.array([[1.0, -1.0]]), names)
    units = {"room": "degC", "zero": "K"}
    assert module._acting(names, weak, _by(names, values), units) == ("room + zero",)


def _by(names: Sequence[str], values: Iterable[T]) -> dict[str, T]:
    return dict(zip(names, values, strict=True))


def _weak(null: np.ndarray, names: list[str]) -> list[Combination]:
    """The combinations found in a linear problem whose columns vanish along the rows of `null`."""
    rows = np.random.default_rng(2).standard_normal((40, len(names)))
    basis = np.linalg.qr(null.T)[0]
    matrix = rows - rows @ basis @ basis.T
    _, weak = weak_combinations(matrix, np.linalg.norm(matrix, axis=0), names)
    return list(weak)
