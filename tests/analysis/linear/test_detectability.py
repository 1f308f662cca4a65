"""The size of a change of the readings relative to a fitted model, and the effects that it resembles."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.fitting import fit_model
from rigctl.analysis.linear.detectability import Unexplained, unexplained
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.noise import noise_of
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario
from rigctl_validation.work import bench_model

SMALL = Scenario("nothing", repeated=1, temperatures=(20.0, 60.0), pressures=(20.0, 50.0))


@pytest.fixture(scope="module")
def made() -> tuple[Unexplained, Problem, object]:
    model, rig = bench_model(False)
    measurements = measure(SMALL.plain, model, rig)
    fitted = fit_model(model, measurements, noise_of(measurements))
    whole = fitted.problem.rebuilt(fitted.model, library=True)
    linearisation = linearise(fitted, whole)
    return unexplained(linearisation, whole), whole, linearisation


def slopes(whole: Problem, linearisation, name: str) -> list[np.ndarray]:
    fit = linearisation.fit
    base = whole.base.copy()
    names = whole.compiled.system.parameter_names
    for unknown, value in zip(fit.problem.shared, fit.values, strict=True):
        base[names.index(unknown.name)] = value
    found = whole.with_shared((), base).simulate(np.empty(0), fit.local, [name]).require()
    return [np.take(array, whole.channels, axis=1)[:, :, 0] for array in found.sensitivities]


def test_a_change_that_the_fitted_parameters_can_make_has_zero_size(made) -> None:
    seen, whole, linearisation = made
    change = slopes(whole, linearisation, "flow_area")
    assert seen.size([1e-8 * each for each in change]) < 1e-6


def test_a_signature_has_its_projected_length_and_a_cosine_of_one_with_itself(made) -> None:
    seen, whole, linearisation = made
    change = slopes(whole, linearisation, "piston_leakage.conductance")
    place = next(k for k, one in enumerate(linearisation.candidates) if one.name == "piston_leakage")
    length = project(linearisation).lengths[linearisation.starts[place]]
    assert seen.size([4e-15 * each for each in change]) == pytest.approx(4e-15 * length, rel=1e-6)
    cosines = seen.cosines(seen.of([4e-15 * each for each in change]))
    assert cosines["piston_leakage"] == pytest.approx(1.0, abs=1e-6)
    assert all(0.0 <= cosine <= 1.0 for cosine in cosines.values())


def test_a_one_sided_effect_does_not_resemble_a_change_of_opposite_sign(made) -> None:
    seen, whole, linearisation = made
    change = slopes(whole, linearisation, "piston_leakage.conductance")
    assert seen.cosines(seen.of([-4e-15 * each for each in change]))["piston_leakage"] == 0.0


def test_an_effect_explains_the_whole_of_its_own_change(made) -> None:
    seen, whole, linearisation = made
    left = seen.of([4e-15 * each for each in slopes(whole, linearisation, "piston_leakage.conductance")])
    own = seen.share_of("piston_leakage", left)
    assert own is not None and own[0].name == "piston_leakage"
    np.testing.assert_allclose(own[1], left, atol=1e-6 * float(np.linalg.norm(left)))
    assert seen.share_of("piston_leakage", -left) is None
    cosines = seen.cosines(left)
    nearest = max((name for name in cosines if name != "piston_leakage"), key=lambda name: cosines[name])
    other = seen.share_of(nearest, left)
    assert other is not None
    assert float(np.linalg.norm(other[1])) == pytest.approx(
        cosines[nearest] * float(np.linalg.norm(left)), rel=1e-6
    )
