"""Data that do not fit into memory are processed in parts, with the same result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigctl.analysis.agreement import slot_evidence as module
from rigctl.analysis.agreement.slot_evidence import slot_evidence
from rigctl.analysis.linear.candidates import candidates
from rigctl.analysis.linear.linearisation import Linearisation, linearise
from rigctl.analysis.linear.slopes import KnownSlopes, Slopes
from rigctl.engine.least_squares import Refused, started
from rigctl.engine.one_thread import one_thread
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import make_problem
from rigctl.noise import ChannelNoise, NoiseModel
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.hidden_effect import hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.in_memory import measure
from rigctl_validation.work import bench_model

#: of the derivatives of three records of these strokes by eight parameters
_FEW = 3 * 376 * 7 * 9


@pytest.fixture(scope="module")
def fitted() -> FitResult:
    """Eight strokes of the separate bench with a leaking valve, fitted by the textbook model."""
    leak = find_hidden("valve_leakage")
    campaign = hide(
        Campaign(temperatures=(20.0, 80.0), chamber_pressures=True), [(leak, leak.typical)], "other"
    )
    model, rig = bench_model(True)
    measurements = measure(campaign, model, rig)
    sigma = [campaign.noise.sigma[name] for name in measurements.outputs]
    channels = (ChannelNoise(name, size) for name, size in zip(measurements.outputs, sigma, strict=True))
    noise = NoiseModel(tuple(channels), 0.01)
    with one_thread():
        return fit(make_problem(model, measurements, noise, [r.here for r in measurements.records]), (2,))


def linearised(fitted: FitResult) -> Linearisation:
    whole = fitted.problem.rebuilt(fitted.model, library=True)
    return linearise(fitted, whole, candidates(fitted.model)[:6])


def test_every_record_is_in_exactly_one_part_of_limited_size(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert fitted.problem.parts(8) == [list(range(8))]
    monkeypatch.setattr("rigctl.model.fit.problem.ROOM", _FEW)
    parts = fitted.problem.parts(8)
    assert [place for part in parts for place in part] == list(range(8))
    assert 1 < max(len(part) for part in parts) < 5
    assert fitted.problem.parts(10**6) == [[place] for place in range(8)]


def test_the_result_does_not_depend_on_the_division_into_parts(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, whole = fitted.problem, linearised(fitted)
    blocks = problem.evaluate(fitted.values, fitted.local, True)
    monkeypatch.setattr("rigctl.model.fit.problem.ROOM", _FEW)
    some, again = linearised(fitted), replace(problem).evaluate(fitted.values, fitted.local, True)
    assert not isinstance(blocks, Refused)
    assert not isinstance(again, Refused)
    for one, other in zip(blocks, again, strict=True):
        assert np.array_equal(one.residual, other.residual)
        assert one.shared is not None
        assert np.array_equal(one.shared, other.shared)
    for a, b in zip(whole.records, some.records, strict=True):
        assert a.signatures == pytest.approx(b.signatures, rel=1e-9, abs=1e-9)
        assert a.count == b.count
    assert whole.full_lengths == pytest.approx(some.full_lengths)


def test_recent_points_are_cached_and_derivatives_do_not_change_the_residuals(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, afresh = replace(fitted.problem), replace(fitted.problem)
    whole = problem.evaluate(fitted.values, fitted.local, True)
    alone = afresh.evaluate(fitted.values, fitted.local, False)
    assert not isinstance(whole, Refused)
    assert not isinstance(alone, Refused)
    for one, other in zip(whole, alone, strict=True):
        assert np.array_equal(one.residual, other.residual)
    assert problem.evaluate(fitted.values.copy(), fitted.local, False) is whole
    assert afresh.evaluate(fitted.values, fitted.local, True) is not alone  # it has no derivatives
    moved = problem.evaluate(1.001 * fitted.values, fitted.local, True)
    assert moved is not whole
    assert problem.evaluate(fitted.values, fitted.local, True) is whole
    for more in (1.002, 1.003):
        problem.evaluate(more * fitted.values, fitted.local, False)
    again = problem.evaluate(fitted.values, fitted.local, True)
    assert again is not whole  # not more than the last few are held
    monkeypatch.setattr("rigctl.model.fit.recent.ROOM", _FEW)
    large = replace(problem)
    assert large.evaluate(fitted.values, fitted.local, True) is not large.evaluate(
        fitted.values, fitted.local, True
    )


def test_a_subset_of_records_and_samples_locates_the_same_slot(
    fitted: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = slot_evidence(fitted)[0]
    monkeypatch.setattr(module, "_MOST_RECORDS", 4)
    monkeypatch.setattr(module, "_MOST_SAMPLES", 200)
    some = slot_evidence(fitted)[0]
    assert some.slot == whole.slot
    assert 5.0 < some.log_evidence < whole.log_evidence


def test_a_point_evaluated_before_another_start_is_not_evaluated_again(fitted: FitResult) -> None:
    problem = fitted.problem.fresh()
    known = problem.evaluate(fitted.values, fitted.local, True)
    elsewhere = problem.with_shared(started(problem.shared, 1.001 * fitted.values))
    assert elsewhere.only(range(len(problem.records))).evaluate(fitted.values, fitted.local, True) is known
    assert (
        problem.with_shared(problem.shared[1:]).evaluate(fitted.values[1:], fitted.local, True) is not known
    )
    other = problem.with_shared(problem.shared, problem.base.copy())
    assert other.evaluate(fitted.values, fitted.local, True) is not known
    assert fitted.problem.fresh().evaluate(fitted.values, fitted.local, True) is not known


def test_a_linearisation_from_known_slopes_is_identical(fitted: FitResult) -> None:
    whole, known = fitted.problem.rebuilt(fitted.model, library=True), KnownSlopes()
    tried = candidates(fitted.model)[:3]
    first = linearise(fitted, whole, tried, known=known)
    again = linearise(fitted, whole, tried, known=known)
    assert known.take(()) is None  # used once, and forgotten
    for one, other in zip(first.records, again.records, strict=True):
        assert np.array_equal(one.signatures, other.signatures)
        assert np.array_equal(one.nuisance, other.nuisance)
    known.keep("here", Slopes([], [], []))
    assert known.take("there") is None
