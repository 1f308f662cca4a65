"""Refits of sets: from the fit of a limiting case, and out of a compensating parameter's local minimum."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from rigctl.analysis.agreement.parameter_bounds import value_of
from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import SHAPE_TOLERANCE
from rigctl.analysis.fitting import fit_model
from rigctl.analysis.linear.candidates import Candidate, candidates
from rigctl.analysis.search.linearised_set import LinearisedSet
from rigctl.analysis.search.refit import at_limiting_case, chi2_of, refit
from rigctl.analysis.search.search import Search
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import fit
from rigctl.model.load import load_model
from rigctl.model.measured.noise import noise_of
from rigctl.rig.load import load_rig
from rigctl_validation.hidden_effect import hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario

DRIFT, DRY, VOLUME = "flow_area_thermal_drift", "coulomb_friction", "dead_volume_a"
MODEL = load_model(shipped("models", "hl32-textbook.yaml"))


def compared(scenario: Scenario) -> ModelComparison:
    """The textbook model on a bench with a drifting and leaking valve and dry friction."""
    hidden = [(find_hidden(name), find_hidden(name).typical) for name in (DRIFT, DRY, "valve_leakage")]
    campaign = hide(scenario.plain, hidden, "other")
    measurements = measure(campaign, MODEL, load_rig(shipped("rigs", "hl32-bench.yaml")))
    fitted = fit_model(MODEL, measurements, noise_of(measurements))
    return judge(fitted, MODEL.name)


@pytest.fixture(scope="module")
def before() -> ModelComparison:
    """Five strokes."""
    return compared(
        Scenario("nothing", repeated=1, temperatures=(20.0, 80.0), pressures=(20.0, 50.0), seed=2)
    )


def candidate(name: str, **shapes: float) -> Candidate:
    """An effect at these values of its shape parameters, SI."""
    wanted = {f"{name}.{parameter}": value for parameter, value in shapes.items()}
    return next(one for one in candidates(MODEL) if one.name == name and one.shapes == wanted)


def test_a_limiting_case_is_an_effect_with_the_same_shape_parameters() -> None:
    coulomb, fine = candidate(DRY, presliding=5e-6), candidate(DRY, presliding=100e-6)
    stribeck = candidate("stribeck_friction", presliding=5e-6)
    assert at_limiting_case(stribeck, coulomb) == {
        "stribeck_friction.force": "coulomb_friction.force",
        "stribeck_friction.static_force": "coulomb_friction.force",
    }
    assert at_limiting_case(stribeck, fine) is None
    assert at_limiting_case(coulomb, stribeck) is None
    assert at_limiting_case(stribeck, candidate("viscous_friction")) is None


def test_parameters_that_had_compensated_for_an_effect_do_not_trap_its_refit() -> None:
    """Without the drift a dead volume is far too large, with it alone at its lower bound, 5 cm³. A plain fit
    with friction that starts there stays, with a χ² larger by 20; one that does not is near 66 cm³."""
    before = compared(
        Scenario("nothing", repeated=1, temperatures=(20.0, 50.0, 80.0), pressures=(20.0, 50.0), seed=2)
    )
    single = refit(before.fit, [candidate(DRIFT)])
    assert single is not None
    both = refit(before.fit, [candidate(DRIFT), candidate(DRY, presliding=100e-6)], single.fit)
    assert both is not None
    lowest = next(one.lower for one in both.fit.problem.shared if one.name == VOLUME)
    # where in their flat valleys depends on the processor, and on the C library: 30 cm³ with that of Windows
    assert value_of(single.fit, VOLUME) < 3.0 * lowest
    assert value_of(both.fit, VOLUME) > 4.0 * lowest
    trapped = [
        replace(one, start=lowest if one.name == VOLUME else one.start) for one in both.fit.problem.shared
    ]
    plain_fit = fit(both.fit.problem.with_shared(trapped), both.fit.held_out, local=both.fit.local)
    assert value_of(plain_fit, VOLUME) < 2.0 * lowest
    assert both.chi2 < chi2_of(plain_fit) - 10.0


def test_less_of_an_effect_is_beyond_the_others_the_more_their_laws_may_deviate(
    before: ModelComparison,
) -> None:
    drift, dry = candidate(DRIFT), candidate(DRY, presliding=100e-6)
    single, both = refit(before.fit, [drift]), refit(before.fit, [drift, dry])
    assert single is not None
    assert both is not None
    point = LinearisedSet(both, before.whole)
    exact, within, free = (point.size_beyond(dry, tolerance) for tolerance in (0.0, SHAPE_TOLERANCE, 10.0))
    assert 0.0 < free < within < exact
    # the linearised size and that by refits differ by what the fitted parameters move in between
    assert 0.5 < exact / math.sqrt(single.chi2 - both.chi2) < 2.0


def test_a_law_never_fits_worse_than_its_limiting_case(before: ModelComparison) -> None:
    search = Search(before, before.whole)
    drift, stribeck = candidate(DRIFT), candidate("stribeck_friction", presliding=100e-6)
    fitted = search.refitted((drift, stribeck), search.null)
    limiting = search.known((drift, candidate(DRY, presliding=100e-6)))
    assert fitted is not None
    assert limiting is not None
    assert fitted.chi2 <= limiting.chi2 + 1e-6
    assert fitted.value("stribeck_friction.static_force")[0] >= fitted.value("stribeck_friction.force")[0]
