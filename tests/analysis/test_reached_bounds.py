"""A parameter that ended at a bound is named before anything else, and is no missing effect."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import answer, told
from oven import CONDUCTANCE, HEAT_CAPACITY, oven_project
from rigctl.analysis.comparison import compare
from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Verdict
from rigctl.errors import RigctlError
from rigctl.model.fit import reached_bounds
from rigctl.model.fit.fit import FitResult

FREE = {"heat_capacity": "100 J/K", "conductance": "1.5 W/K", "room": "20 degC"}
FIRST = "heat_capacity ended at its upper bound, 124 J/K: widen it first"


def test_a_bound_of_the_user_is_named_first_and_no_effect_is(tmp_path: Path) -> None:
    run, model = oven_project(tmp_path, FREE, heat_capacity_bounds="[10 J/K, 124 J/K]")
    found = diagnose([run], model)
    assert found.first == (FIRST,)
    assert (found.verdict, found.effects) == (Verdict.UNDECIDED, ())
    assert found.title == "Not decided"
    assert "heat_capacity at 129" in found.statement
    assert found.before.adequacy.verdict is False
    (bound,) = found.document()["bounds"]
    assert bound == {
        "parameter": "heat_capacity",
        "bound": 124.0,
        "value": 124.0,
        "unit": "J/K",
        "side": "upper",
        "widened": False,
        "statement": FIRST,
    }


def test_an_effect_is_not_certain_beside_a_bound_of_the_user(tmp_path: Path) -> None:
    bounds = "[10 J/K, 124 J/K]"
    run, model = oven_project(tmp_path, FREE, heat_capacity_bounds=bounds, radiation=0.01)
    found = diagnose([run], model, most=1)
    assert found.first == (FIRST,)
    assert found.verdict is not Verdict.MISSING_EFFECT
    assert not any(one.law_sure or one.place_sure for one in found.levels)


@pytest.mark.parametrize(
    ("start", "bounds", "side"),
    [("40 W/K", "[0 W/K, 100 W/K]", "lower"), ("2 W/K", "[0 W/K, 100 W/K]", "")],
)
def test_a_default_bound_is_widened(tmp_path: Path, start: str, bounds: str, side: str) -> None:
    """A bound that is a twentieth of the starting value, which nobody wrote."""
    run, model = oven_project(tmp_path, {**FREE, "conductance": start}, conductance_bounds=bounds)
    (found,) = compare([run], [model]).models
    value = dict(zip([one.name for one in found.fit.problem.shared], found.fit.values, strict=True))
    assert value["conductance"] == pytest.approx(CONDUCTANCE, rel=0.01)
    assert value["heat_capacity"] == pytest.approx(HEAT_CAPACITY, rel=0.01)
    assert found.adequate and not found.bounded
    assert [(one.side, one.widened, one.held) for one in found.bounds] == (
        [(side, True, False)] if side else []
    )


def test_no_fit_that_ends_inside_its_bounds_is_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.analysis import fitting

    run, model = oven_project(tmp_path, FREE)
    problems = []
    really = fitting.fit

    def counted(problem, *given, **named):  # type: ignore[no-untyped-def]
        problems.append([(one.lower, one.upper) for one in problem.shared])
        return really(problem, *given, **named)

    monkeypatch.setattr(fitting, "fit", counted)
    compare([run], [model])
    assert len({str(bounds) for bounds in problems}) == 1


def test_commands_print_it_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    oven_project(tmp_path, FREE, heat_capacity_bounds="[10 J/K, 124 J/K]")
    monkeypatch.chdir(tmp_path)
    for command in (["compare"], ["compare", "-v"], ["diagnose"], ["diagnose", "-v"]):
        assert told(command[0], "latest", "--model", "models/oven.yaml", *command[1:]).startswith(FIRST)
    page = tmp_path / "page.html"
    told("diagnose", "latest", "--model", "models/oven.yaml", "-o", str(page))
    assert "ended at its upper bound, 124 J/K: widen it first" in page.read_text(encoding="utf-8")
    fitted = answer("model", "fit", "models/oven.yaml", "latest")
    assert [one["parameter"] for one in fitted["bounds"]] == ["heat_capacity"]
    assert answer("compare", "latest", "--model", "models/oven.yaml")["bounds"] == fitted["bounds"]
    assert FIRST in told("model", "fit", "models/oven.yaml", "latest")


def test_bounds_beyond_which_the_model_cannot_be_simulated_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, model = oven_project(tmp_path, FREE)
    (found,) = compare([run], [model]).models
    monkeypatch.setattr(reached_bounds, "beyond_defaults", lambda fitted: fitted.problem.shared)

    def impossible(*_: object) -> FitResult:
        raise RigctlError("the model has no value at the start of the fit")

    assert reached_bounds.with_wider_bounds(found.fit, impossible) is found.fit
