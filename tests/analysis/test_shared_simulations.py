"""A fit and its linearisation integrate each point once, and the shapes of an effect together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.linear import slopes as module
from rigctl.analysis.linear.candidates import Candidate, candidates
from rigctl.analysis.linear.slopes import slopes_at
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache.cached import switched_off
from rigctl.model.fit import problem as fit_problem
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem, make_problem
from rigctl.model.fit.slopes import simulate_soundly
from rigctl.model.measured.noise import noise_of
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario
from rigctl_validation.work import bench_model

SMALL = Scenario("nothing", repeated=1, temperatures=(20.0, 60.0), pressures=(20.0, 50.0))


@pytest.fixture(scope="module")
def problem() -> Problem:
    model, rig = bench_model(False)
    measurements = measure(SMALL.plain, model, rig)
    noise = noise_of(measurements)
    return make_problem(model, measurements, noise.model, noise.ok, grown=noise.grown)


@pytest.fixture(scope="module")
def fitted(problem: Problem) -> FitResult:
    with one_thread():
        return fit(problem)


def test_a_fit_integrates_no_point_twice(
    problem: Problem, fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither to find parameters without influence, nor for the final outputs."""
    points: list[tuple[object, ...]] = []

    def counted(compiled: Any, excitations: Sequence[Any], columns: Sequence[str], *more: Any) -> Any:
        where = (one.parameters.tobytes() + one.initial.tobytes() for one in excitations)
        points.append((bool(columns), *where))
        return simulate_soundly(compiled, excitations, columns, *more)

    local = [np.array([one.start for one in unknowns]) for unknowns in problem.local_unknowns()]
    monkeypatch.setattr(fit_problem, "simulate_soundly", counted)
    with one_thread(), switched_off():
        again = fit(problem, local=local)
    assert len(points) > 3
    assert len(set(points)) == len(points)
    assert again.solution is not None
    monkeypatch.undo()
    for found, wanted in zip(again.outputs, problem.simulate(again.values, again.local).outputs, strict=True):
        np.testing.assert_array_equal(found, wanted[:, problem.channels])


def test_effects_with_one_shape_each_share_the_simulation_of_all_columns(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {one.name: one for one in candidates(fitted.model) if one.shapes and not one.secants}
    chosen = [found["coulomb_friction"], found["pressure_friction"], _plain(fitted, "piston_leakage")]
    whole = fitted.problem.rebuilt(fitted.model, library=True)
    shaped: list[int] = []
    monkeypatch.setattr(module, "_shaped", lambda _, __, further, ___: shaped.append(len(further)) or {})
    together = slopes_at(whole, fitted, (), chosen, fitted.local)
    assert shaped == [0]
    names = whole.compiled.system.parameter_names
    for k, one in enumerate(chosen):
        base = module.base_at(whole, fitted)
        for name, value in one.shapes.items():
            base[names.index(name)] = value
        alone = whole.with_shared((), base).simulate(np.empty(0), fitted.local, one.columns)
        for record, slopes in zip(together.signatures, alone.sensitivities, strict=True):
            column, right = record[:, :, k], slopes[:, whole.channels, 0]
            assert np.linalg.norm(column - right) < 0.05 * np.linalg.norm(right)


def _plain(fitted: FitResult, name: str) -> Candidate:
    return next(one for one in candidates(fitted.model) if one.name == name)
