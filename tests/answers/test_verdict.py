"""The text of a diagnosis: what was detected, how large it is, and what it resembles."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.collected_evidence import drift_evidence, evidence_for
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.conclusion import Doubt, NotProven, Outcome, conclude, whether_at_all
from rigctl.analysis.diagnosis_result import Drift, FoundParameter, Ranked
from rigctl.analysis.improve import Improvement, NotImproved
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.search.own_scale import TooLargeForSensor
from rigctl.analysis.search.reasons import NotPredicted, UndeterminedSize, UnusualSize, reasons_against
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.rivals import Differs, Rival, where_they_differ
from rigctl.answers.findings.evidence import rival_text, sentence
from rigctl.answers.findings.reasons import reason_text
from rigctl.answers.findings.verdict import effect_text, worded
from rigctl.answers.findings.verdict import statement as verdict_statement
from rigctl.answers.improvement import refusal_text
from rigctl.effects.registry import library
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.physics.families import find_family

NO_TRIAL = cast("RefittedSet", None)
WHERE = Differs(
    "position", "extend", "oil 80 degC, supply 50 bar", -0.22, "mm", (("retract", 0.96), ("hold", 0.2))
)
RIVAL = Rival("valve_leakage", "position_thermal_drift", NO_TRIAL, 0.94, 20.0, 1600.0, WHERE)


@pytest.mark.parametrize(
    ("value", "unit", "std", "said"),
    [
        (6.837e-15, "m^3", 6.2e-17, "(6.837 ± 0.062)e-15 m^3"),
        (98.13, "N", 4.1, "98.1 ± 4.1 N"),
        (40.7, "N", 212.0, "40 ± 210 N"),
        (0.0669, "1", float("nan"), "0.0669"),
        (5e-14, "m^3", 0.0, "5e-14 m^3 at its bound"),
        (1.0, "1", 0.0, "1 at its bound"),
    ],
)
def test_a_parameter_is_shown_with_its_standard_deviation_and_unit(
    value: float, unit: str, std: float, said: str
) -> None:
    assert str(FoundParameter(value, unit, std)) == said


def test_an_effect_is_described_with_evidence_name_and_size() -> None:
    effect = library(find_family("hydraulic_cylinder"))["valve_leakage"]
    said = effect_text(effect, {"conductance": FoundParameter(4e-15, "m^3", 1e-16)})
    assert said == (
        "In neutral both chambers drift to half of the supply pressure, and a single-rod cylinder creeps "
        "out: oil passes the spool's clearance at every port, in neutral too "
        "(valve_leakage, conductance (4.00 ± 0.10)e-15 m^3)"
    )


def test_a_rival_is_described_with_similarities_and_differences() -> None:
    assert rival_text(RIVAL) == (
        "position_thermal_drift would look like valve_leakage (cos 0.94): in retract (0.96), not in hold "
        "(0.20); the two differ most in position in extend, by up to 0.22 mm at oil 80 degC, supply 50 bar, "
        "and these data tell them apart (d = 20.0)"
    )


@pytest.mark.parametrize(
    ("d", "difference", "why"),
    [
        (0.4, 1600.0, "d = 0.40, at least 2.33 is needed"),
        (5.1, 4.0, "their mBIC differs by 4.0, at least 9.2 is needed"),
        (0.4, 4.0, "d = 0.40, at least 2.33 is needed; their mBIC differs by 4.0, at least 9.2 is needed"),
    ],
)
def test_an_inseparable_rival_is_described_with_the_criteria_it_misses(
    d: float, difference: float, why: str
) -> None:
    said = rival_text(replace(RIVAL, separation=d, difference=difference, differs=None))
    assert said == (
        "position_thermal_drift would look like valve_leakage (cos 0.94), "
        f"and these data do not tell them apart ({why})"
    )


def leaves(share: float) -> Remainder | None:
    return Remainder(share, 3.0, 0.001, "", "", "") if share else None


def statement(outcome: Outcome, left: float, failed: Sequence[str], rivals: Sequence[Rival] = ()) -> str:
    """The statement on two effects; those in `failed` do not pass cross-validation."""
    known = library(find_family("hydraulic_cylinder"))
    names = ("valve_leakage", "coulomb_friction")
    chosen: Any = [(SimpleNamespace(effect=known[name]), SimpleNamespace(parameters={})) for name in names]
    checks = {name: CrossValidation(1.2, 1.1, 1.0, 2.0 if name in failed else 0.1, 5) for name in names}
    best: Any = SimpleNamespace(candidates=[pair[0] for pair in chosen], unusual={}, undetermined=())
    against = reasons_against(best, checks, leaves(left))
    return worded(conclude(outcome, chosen, rivals, leaves(left), checks, against=against)).text


def test_a_failed_check_is_reported_instead_of_an_empty_remainder() -> None:
    said = statement("outside", 0.004, ["valve_leakage"])
    assert "but valve_leakage does not predict data that it was not fitted to: " in said
    assert "% of the misfit" not in said
    assert "but they leave 40 % of the misfit" in statement("outside", 0.4, ["valve_leakage"])


def test_the_shape_of_a_small_effect_cannot_account_for_a_remainder() -> None:
    """A tenth of 30 sigmas is undetectable, so 6 sigmas need another cause; a tenth of 300 sigmas is not."""
    leak = SimpleNamespace(effect=library(find_family("hydraulic_cylinder"))["rod_leakage"])
    best: Any = SimpleNamespace(candidates=[leak], unusual={}, undetermined=())
    left = Remainder(0.04, 6.0, 0.001, "", "", "")
    assert list(map(reason_text, reasons_against(best, {}, left, 30.0**2))) == [
        "what it leaves, 4 % of the misfit, is more than a different shape of so small an effect accounts for"
    ]
    assert not reasons_against(best, {}, left, 300.0**2)
    assert not reasons_against(best, {}, replace(left, size=4.0), 30.0**2)
    assert not reasons_against(best, {}, None, 30.0**2)


def test_several_effects_that_leave_something_may_imitate_another() -> None:
    known = library(find_family("hydraulic_cylinder"))
    chosen = [SimpleNamespace(effect=known[name]) for name in ("valve_leakage", "viscous_friction")]
    pair: Any = SimpleNamespace(candidates=chosen, unusual={}, undetermined=())
    left = Remainder(0.004, 30.0, 0.001, "", "", "")
    (reason,) = reasons_against(pair, {}, left, 500.0**2)
    assert reason_text(reason).startswith("together they leave 0.4 % of the misfit that no other shape")
    (reason,) = reasons_against(pair, {}, replace(left, slot="pump_flow"), 500.0**2)
    assert reason_text(reason) == "what they leave points to a term at pump_flow, where none of them acts"
    assert not reasons_against(pair, {}, None, 500.0**2)


def test_a_detected_effect_without_mbic_gain_is_called_too_weak() -> None:
    seen = cast("Ranked", SimpleNamespace(effect="position_gain", size=3.91, delta_bic=2.43))
    said = worded(conclude("outside", [], [], None, {}, seen)).text
    assert said == (
        "Something is missing, but the data show too little of it to identify it: position_gain explains "
        "more of it than any other effect, but 3.9 times as strong as chance is not enough to name it"
    )
    unseen = worded(conclude("outside", [], [], None, {})).text
    assert unseen == "Something is missing that no effect of the library explains"


def test_with_guessed_noise_no_missing_effect_is_claimed() -> None:
    said = worded(conclude("outside", [], [], None, {}), "the noise of flow is a guess").text
    assert "Something is missing" not in said
    assert "but the noise of flow is a guess: these data cannot tell whether something is missing" in said
    channels = (SimpleNamespace(name="flow", guessed=True), SimpleNamespace(name="level", guessed=False))

    def compared(guessed: int, nrmse: float) -> ModelComparison:
        problem = SimpleNamespace(noise=SimpleNamespace(channels=channels[1 - guessed :]))
        errors = {"level": SimpleNamespace(nrmse=nrmse)}
        return cast("ModelComparison", SimpleNamespace(fit=SimpleNamespace(problem=problem, errors=errors)))

    assert whether_at_all(compared(1, 3.0)) == Doubt("guessed_noise", ("flow",))
    assert whether_at_all(compared(0, 0.8)) == Doubt("below_noise")
    assert whether_at_all(compared(0, 0.95)) == Doubt("within_noise")
    assert whether_at_all(compared(0, 1.1)) is None


@pytest.mark.parametrize(
    ("after", "change"),
    [(0.21, "falls from 0.26 A to 0.21 A"), (0.31, "rises from 0.26 A to 0.31 A")],
)
def test_the_error_with_an_effect_that_is_not_proven_falls_or_rises(after: float, change: str) -> None:
    """It used to fall from 0.26 to 0.31 A."""

    def fit(current: float) -> Any:
        channels = [SimpleNamespace(name=name, own_scale=name == "current") for name in ("current", "speed")]
        problem = SimpleNamespace(
            model=SimpleNamespace(family=SimpleNamespace(program=None)),
            noise=SimpleNamespace(channels=channels),
            measurements=SimpleNamespace(unit_of={"current": "A"}.__getitem__),
        )
        return SimpleNamespace(problem=problem, errors={"current": SimpleNamespace(rmse=current)})

    best = SimpleNamespace(fit=fit(after), candidates=["offset"], effects=["offset_of_current"])
    diagnosis: Any = SimpleNamespace(conclusion=NotProven(), before=SimpleNamespace(fit=fit(0.26)), best=best)
    said = verdict_statement(diagnosis)
    assert said.endswith(f"The nearest is offset_of_current: with it the error of current {change}")


def test_ambiguity_from_a_check_names_no_other_effects() -> None:
    said = statement("ambiguous", 0.0, ["valve_leakage", "coulomb_friction"])
    assert "valve_leakage and coulomb_friction do not predict data that they were not fitted to" in said
    assert "cannot tell which" not in said
    close = [replace(RIVAL, separation=0.4)]
    words = statement("ambiguous", 0.0, [], close)
    assert not re.search(r"\bcos\b|d = |mBIC|sigma|χ²", words)  # those are evidence, not the answer
    assert "cannot tell which" in statement("ambiguous", 0.0, [], close)
    both = statement("ambiguous", 0.0, ["valve_leakage"], close)
    assert "cannot tell which" in both
    assert both.endswith("valve_leakage does not predict data that it was not fitted to")


@pytest.mark.parametrize(
    ("before", "after", "unit", "stds", "said"),
    [
        (20.62, 25.02, "ms", (0.5, 8.0), False),
        (20.62, 25.02, "ms", (0.5, 0.6), True),
        (20.62, 25.02, "ms", (5.0, 5.0), False),  # both standard deviations exceed the change
        (20.62, 20.7, "ms", (0.001, 0.001), False),  # significant, but too small to report
        (20.0, 20.3, "degC", (0.01, 0.01), True),
        (0.0, 3.0, "mm", (0.1, 0.1), True),
        (20.0, 50.0, "ms", (0.1, 0.0), True),  # to its bound
    ],
)
def test_a_parameter_has_changed_if_the_change_exceeds_its_uncertainty(
    before: float, after: float, unit: str, stds: tuple[float, float], said: bool
) -> None:
    assert bool(drift_evidence([Drift("spool_time", before, after, unit, *stds)])) is said


@pytest.mark.parametrize(
    ("d", "difference", "share", "told"),
    [
        (20.0, 1600.0, 0.2, True),
        (2.0, 1600.0, 0.2, False),
        (20.0, 9.0, 0.2, False),
        (20.0, 1600.0, 1e-4, False),  # beyond the noise, but within the shape tolerance
    ],
)
def test_separating_two_effects_needs_all_three_criteria(
    d: float, difference: float, share: float, told: bool
) -> None:
    rival = replace(RIVAL, separation=d, difference=difference, share=share)
    assert rival.separable is told
    assert ("the shape of either may account for that" in rival_text(rival)) is (share < 0.01)


def test_a_law_is_not_distinguished_from_its_limit() -> None:
    rival = replace(RIVAL, member="hysteresis", name="coulomb", nested="distance 0")
    assert not rival.separable
    assert "hysteresis with distance 0 is coulomb, and its fit is not significantly different" in rival_text(
        rival
    )


def test_values_beyond_the_usual_range_are_reported() -> None:
    beyond = "coefficient beyond its usual range (0 m to 20000 m)"
    assert f"(cos 0.94) with its {beyond}" in rival_text(replace(RIVAL, unusual=beyond))
    known = library(find_family("hydraulic_cylinder"))["viscous_friction"]
    chosen: Any = [(SimpleNamespace(effect=known), SimpleNamespace(parameters={}))]
    against = [UnusualSize(known.name, beyond)]
    said = worded(conclude("ambiguous", chosen, [], leaves(0.02), {}, against=against)).text
    assert f"as well as this, but viscous_friction fits only with its {beyond}: " in said
    assert said.endswith("That is not all: 2 % of the misfit is left (p = 0.001)")


def fitted(outputs: np.ndarray) -> FitResult:
    """A fit of two equal records: extend and hold of ten samples each, one channel in mm, noise of 0.1 mm."""
    records = tuple(
        MeasuredRecord(
            run="r",
            index=index,
            label=f"r/{index + 1}",
            times=np.arange(20.0),
            switch_times=np.array([0.0, 10.0]),
            switch_half=np.zeros(2),
            inputs=np.zeros((2, 1)),
            values=np.zeros((20, 1)),
            condition={"oil": oil},
            group=index,
            phase=np.repeat([0, 1], 10),
            phases=("extend", "hold"),
        )
        for index, oil in enumerate((353.15, 293.15))
    )
    problem: Any = SimpleNamespace(
        records=records,
        ok=(np.ones((20, 1), bool),) * 2,
        sigma=(np.full((20, 1), 1e-4),) * 2,
        noise=SimpleNamespace(sigma=np.array([1e-4])),
        measurements=Measurements(("position",), ("mm",), ("valve",), records, None, ("r",)),
    )
    both = (outputs[:, None], outputs[:, None])
    return cast("FitResult", SimpleNamespace(problem=problem, fitted=(0, 1), outputs=both))


def test_the_phase_in_which_two_effects_differ_is_reported() -> None:
    ramp, still = np.linspace(0.0, 1e-3, 10), np.zeros(10)
    none, one = fitted(np.zeros(20)), fitted(np.concatenate([ramp, ramp]))
    other = fitted(np.concatenate([0.9 * ramp, still + 1e-5]))
    found = where_they_differ(none, one, other)
    assert found is not None
    assert (found.channel, found.phase, found.condition, found.unit) == (
        "position",
        "hold",
        "oil 80 degC",
        "mm",
    )
    assert found.largest == pytest.approx(-0.99)
    alike = dict(found.alike)
    assert alike["extend"] == pytest.approx(1.0)
    assert alike["hold"] < 0.9


def test_effects_with_equal_predictions_differ_nowhere() -> None:
    same = fitted(np.linspace(0.0, 1e-3, 20))
    assert where_they_differ(fitted(np.zeros(20)), same, same) is None


@pytest.mark.parametrize(
    ("hidden_in", "said"),
    [
        ("viscous_damping", "the fitted viscous_damping imitates it to within 15 % of its size; "),
        (
            "record",
            "variation from record to record (of settings, zeros, times and initial states) imitates it ",
        ),
    ],
)
def test_the_evidence_for_an_absorbed_effect_names_what_absorbs_it(hidden_in: str, said: str) -> None:
    ranked = Ranked("line_loss", 1.0, 1e-9, -20.0, 0.15, hidden_in, float("nan"), float("nan"), 0.1, 9.0, {})
    found = [sentence(one) for one in evidence_for("line_loss", ranked, None, [], several=False)]
    assert sum(said in one for one in found) == 1
    assert not any("85 %" in one for one in found), "lengths add in squares"


@pytest.mark.parametrize(
    ("several", "said"), [(True, "only together with the others"), (False, "only at a finite size")]
)
def test_an_effect_found_without_a_significant_score_is_described_as_it_was_found(
    several: bool, said: str
) -> None:
    """A single effect was said to stand out "only together with the others"."""
    ranked = Ranked("line_loss", 1.0, 1.0, -20.0, 1.0, "", float("nan"), float("nan"), 0.1, 9.0, {})
    first = sentence(evidence_for("line_loss", ranked, None, [], several=several)[0])
    assert said in first
    assert ("others" in first) is several


def test_what_a_test_detects_without_any_size_is_not_stated_as_none() -> None:
    """ "Together they leave 0 sigma that no other shape of their laws explains"."""
    known = library(find_family("hydraulic_cylinder"))
    chosen = [SimpleNamespace(effect=known[name]) for name in ("valve_leakage", "viscous_friction")]
    pair: Any = SimpleNamespace(candidates=chosen, unusual={}, undetermined=())
    left = Remainder(0.0, 0.0, 0.003, "", "", "")
    (reason,) = reasons_against(pair, {}, left, 500.0**2)
    assert reason_text(reason).startswith(
        "together they leave a detectable pattern that no other shape of their laws"
    )


def test_the_opening_of_a_statement_has_all_reasons_and_the_effects_by_name() -> None:
    """It used to be the statement up to its first colon, which a reason may contain."""
    known = library(find_family("hydraulic_cylinder"))["viscous_friction"]
    chosen: Any = [(SimpleNamespace(effect=known), SimpleNamespace(parameters={}))]
    against = [UndeterminedSize("viscous_friction"), NotPredicted(("viscous_friction",))]
    reasons = list(map(reason_text, against))
    said = worded(conclude("ambiguous", chosen, [], None, {}, against=against))
    assert said.opening == (
        "Something is missing. No other effect of the library explains it as well as viscous_friction, but "
        f"{reasons[0]}, and {reasons[1]}"
    )
    assert said.text.startswith(said.opening.replace("viscous_friction, but", "this, but"))
    said = worded(conclude("outside", chosen, [], leaves(0.4), {}))
    assert said.opening.startswith(
        "Something is missing. The nearest in the library is viscous_friction, but it leaves 40 % of"
    )


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        (
            NotImproved(("a", "b"), "held_out", 4),
            "a and b does not improve the prediction of the 4 records held out",
        ),
        (
            NotImproved(("a",), "conditions"),
            "a does not improve the prediction of conditions left out of the fit",
        ),
        (
            NotImproved(("a",), "blocks"),
            "a does not improve the prediction of blocks of time left out of the fit",
        ),
        (
            TooLargeForSensor("lag_of_p", 4e3),
            "lag_of_p would be 4000 times the noise of a reading, as no sensor's",
        ),
        (None, ""),
    ],
)
def test_an_effect_that_is_not_added_is_refused_with_its_reason(refused: Any, said: str) -> None:
    found = refusal_text(cast("Improvement", SimpleNamespace(refused=refused)))
    assert found.startswith(said)
    assert bool(found) is (refused is not None)
