"""Refits with one effect each: an effect is excluded at every size, not only at that of one fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.diagnosis_result import Exclusion
from rigctl.analysis.fitting import fit_model
from rigctl.analysis.search.refit_alone import Alone, alone, at_amplitudes
from rigctl.analysis.single_values.exclusions import exclusions, main_trend
from rigctl.answers.findings.tables import exclusion_text
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.measured.noise import noise_of
from rigctl.model.measured.read import read_measurements
from rigctl.rig.load import load_rig

#: χ² of the best effect of the library on the published strokes
BEST = 5.5
NEVER, UNFIT = "at any usual size", "at the size that fits best"


@pytest.fixture(scope="module")
def strokes(tmp_path_factory: pytest.TempPathFactory) -> ModelComparison:
    """The published strokes and the textbook model, whose trend has the wrong sign."""
    folder = Path(tmp_path_factory.mktemp("strokes"))
    run = import_file(
        shipped("data", "hl32-strokes.csv"), load_rig(shipped("rigs", "hl32-bench.yaml")), folder
    )
    model = load_model(shipped("models", "hl32-textbook.yaml"))
    measured = read_measurements(model, [open_run(str(run.path))])
    return judge(fit_model(model, measured, noise_of(measured)), "textbook")


def fitted(before: ModelComparison, effect: str) -> Alone:
    score = next(one for one in before.screening.scores if one.effect == effect)
    candidate = before.linearisation.candidates[score.candidate]
    found = alone(before, candidate, from_null=score.gain > 0.0)
    assert found is not None
    return found


def test_a_leak_that_reverses_the_trend_only_far_above_its_typical_size_is_found(
    strokes: ModelComparison,
) -> None:
    """Fitted from its typical size a leaking valve ends at none, χ² 291; a worn one leaves 174."""
    found = fitted(strokes, "valve_leakage")
    assert found.chi2 < 200.0
    (out,) = exclusions(strokes, (), BEST, {"valve_leakage": found})
    assert out.reached > 0.25
    trend = main_trend(strokes)
    assert trend is not None
    assert not any(NEVER in sentence for sentence in exclusion_text([out], trend))


def test_an_effect_that_does_not_reverse_the_trend_is_tried_up_to_its_bound(strokes: ModelComparison) -> None:
    found = fitted(strokes, "rod_leakage")
    assert len(at_amplitudes(strokes, found)) == 3
    (out,) = exclusions(strokes, (), BEST, {"rod_leakage": found})
    assert out.reached <= out.at_most < 0.25
    trend = main_trend(strokes)
    assert trend is not None
    assert NEVER in exclusion_text([out], trend)[0]


def test_an_effect_whose_fit_explains_most_is_not_tried_at_other_sizes(strokes: ModelComparison) -> None:
    found = fitted(strokes, "flow_area_thermal_drift")
    assert found.chi2 < 10.0
    assert found.at_amplitudes == ()


def test_an_effect_that_reverses_the_trend_elsewhere_is_excluded_only_at_its_best_size(
    strokes: ModelComparison,
) -> None:
    trend = main_trend(strokes)
    assert trend is not None
    said = exclusion_text([Exclusion("valve_leakage", 0.0, (), 2.0, 0.6)], trend)
    assert len(said) == 1
    assert UNFIT in said[0]
