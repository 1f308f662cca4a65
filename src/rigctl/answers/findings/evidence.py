"""The evidence of a diagnosis in sentences.

In: `Evidence`, each with its quantity, value, threshold and the result behind it. Out: one sentence each, by
a table from quantity to wording, marked for or against. The analysis decides what is evidence and for which
side; only the words are chosen here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Literal, TypeVar

from rigctl.analysis.agreement.record_level import RecordQuantity
from rigctl.analysis.agreement.sensors import SensorBudget
from rigctl.analysis.decision_levels import ALPHA, LEAST_DIFFERENCE, LEAST_SEPARATION, ODDS, TOLERANCE
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked, Verdict
from rigctl.analysis.evidence import Evidence, IfExact, Quantity
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.identity import Levels
from rigctl.analysis.search.rivals import Differs, Rival
from rigctl.answers.blocks import Point
from rigctl.answers.findings.agreement import record_level_text
from rigctl.answers.findings.reasons import scatter_text
from rigctl.answers.findings.sensor_errors import beyond_text, exact_text
from rigctl.answers.findings.verdict import largest_difference
from rigctl.effects.record_level import RECORD
from rigctl.wording import chance_text, share_text

#: least difference of cosines between phases that is stated
_UNLIKE = 0.15


def sentence(one: Evidence) -> str:
    """A piece of evidence in a sentence: ``for valve_leakage: it stands out from the noise by 12 sigma``."""
    text = _WORDS[one.quantity](one)
    return f"{one.side} {' and '.join(one.subject)}: {text}" if one.side else text


def points(evidence: Iterable[Evidence]) -> tuple[Point, ...]:
    """An entry for each, marked by what it speaks for."""
    return tuple(Point(sentence(one), _MARKS[one.side]) for one in evidence)


_MARKS: Mapping[str, Literal["+", "-", ""]] = {"for": "+", "against": "-", "": ""}


_T = TypeVar("_T")


def _found(one: Evidence, kind: type[_T]) -> _T:
    """The result behind a piece of evidence, of the kind that its quantity has."""
    assert isinstance(one.finding, kind)  # noqa: S101 - `Evidence` is made with both
    return one.finding


def _power(one: Evidence) -> str:
    """Effects that an adequate fit to these data does not exclude."""
    if one.value > one.threshold / 2:
        return (
            f"these data are too weak for a verdict: {one.value:.0f} of {one.threshold:.0f} effects of the "
            "library might not be seen in them at their typical size; record at more temperatures, pressures "
            "and with repeats"
        )
    return f"might not be seen in these data at their typical size: {', '.join(_found(one, tuple))}"


def _size(one: Evidence) -> str:
    """Its size relative to the noise, and whether it is significant in the model as given."""
    # The size is that of the fitted effect; the p-value is that of the score test at its null, corrected for
    # the whole library. They differ where an effect shows only together with others, or only at a finite size
    # (a threshold), and the sentence says which.
    p = _found(one, Ranked).score_p_value
    text = f"it stands out from the noise by {one.value:.1f} sigma"
    if one.quantity == "joint_size":
        return (
            f"{text}, but only together with the others: by itself its score is not significant (p = {p:.2g})"
        )
    if p > ALPHA:
        return f"{text}, but only at a finite size: from none, its score is not significant (p = {p:.2g})"
    return f"{text} ({chance_text(p)} for the largest score of the whole library)"


def _mbic(one: Evidence) -> str:
    if one.side == "against":
        return f"mBIC rises by {one.value:.1f} with it"
    return f"mBIC falls by {-one.value:.1f} with it ({LEAST_DIFFERENCE} is odds of {ODDS} to 1)"


def _left_out_error(one: Evidence) -> str:
    check = _found(one, CrossValidation)
    return (
        f"on conditions left out one at a time the normalised error changes from {one.threshold:.4g} to "
        f"{one.value:.4g} ({check.folds} folds, mean gain {check.mean:.1f} ± {check.error:.1f})"
    )


def _absorbed(one: Evidence) -> str:
    what = (
        "variation from record to record (of settings, zeros, times and initial states)"
        if one.finding == RECORD
        else f"the fitted {_found(one, str)}"
    )
    left = f"{100 * one.value:.0f} %"
    return f"{what} imitates it to within {left} of its size; the verdict rests on the remaining {left}"


def rival_text(rival: Rival) -> str:
    """How similar the two are, where they differ, and whether these data distinguish them."""
    other = f"{rival.name} and {rival.beside} together" if rival.beside else rival.name
    text = f"{other} would look like {rival.member} (cos {rival.cos:.2f})"
    if rival.unusual:
        text += f" with its {rival.unusual}"
    if rival.differs is not None:
        text += _alike_text(rival.differs) + largest_difference(rival)
    if rival.separable:
        return f"{text}, and these data tell them apart (d = {rival.separation:.1f})"
    return f"{text}, and these data do not tell them apart ({_lacking(rival)})"


def _lacking(rival: Rival) -> str:
    """Which of the conditions for being distinguishable are not met."""
    # A pair counts as told apart only if all conditions hold; each one that fails is named with its number,
    # since each asks for other data.
    parts = []
    if rival.separation < LEAST_SEPARATION:
        parts.append(f"d = {rival.separation:.2f}, at least {LEAST_SEPARATION} is needed")
    if rival.difference < LEAST_DIFFERENCE:
        parts.append(f"their mBIC differs by {rival.difference:.1f}, at least {LEAST_DIFFERENCE} is needed")
    if rival.nested:
        parts.append(
            f"{rival.member} with {rival.nested} is {rival.name}, and its fit is not significantly different"
        )
    if rival.both_leave:
        parts.append("both leave much more than the white noise, so that neither is excluded")
    if not parts:
        parts.append(
            f"they differ by {share_text(max(rival.share, 0.0))} of what it explains, and the shape of "
            f"either may account for that: at least {share_text(TOLERANCE**2)} is needed"
        )
    return "; ".join(parts)


def _alike_text(where: Differs) -> str:
    """In which phase the two are most similar, and in which least."""
    if len(where.alike) < 2 or where.alike[0][1] - where.alike[-1][1] < _UNLIKE:
        return ""
    (most, largest), (least, smallest) = where.alike[0], where.alike[-1]
    side = "not" if smallest < 0.5 else "less so"
    return f": in {most} ({largest:.2f}), {side} in {least} ({smallest:.2f})"


def _left_alone(one: Evidence) -> str:
    return (
        f"{one.subject[0]} alone leaves {share_text(one.value)} of the misfit, no more than a slightly "
        "different law would leave: what is certain about it does not depend on what else is missing"
    )


def _levels(one: Evidence) -> str:
    """The certain levels if the law is not one."""
    levels = _found(one, Levels)
    if not levels.driver_sure:
        return f"Certain is the location, {_term(levels)}, but not what it depends on"
    if not levels.driver:
        return f"Certain is the location, {_term(levels)}, but not its law"
    return f"Certain are the location and variables: {_term(levels)}"


def certain(levels: Levels) -> str:
    """The certain levels in a few words, ``location and variables, a term at friction over velocity``."""
    if levels.law_sure:
        return "location, variables and law" if levels.driver else "location and law"
    if not levels.place_sure:
        return "nothing"
    both = levels.driver_sure and levels.driver
    return f"location{' and variables' if both else ''}, {_term(levels)}"


def _term(levels: Levels) -> str:
    """The term as far as it is certain."""
    where = " and ".join(levels.place)
    if not levels.driver_sure:
        return f"a term at {where}"
    if not levels.driver:
        return f"a constant term at {where}"
    return f"a term at {where} over {' and '.join(levels.driver)}"


def _sensor_error(one: Evidence) -> str:
    return f"the model would agree without it if {beyond_text(_found(one, SensorBudget))}"


def _exact_sensors(one: Evidence) -> str:
    exact = _found(one, IfExact)
    return f"with exact {exact_text(exact.sensors)}, {would_be_missing(exact.diagnosis)}"


def would_be_missing(exact: Diagnosis) -> str:
    """What is missing according to a diagnosis with exact sensors: ``valve_leakage would be missing``."""
    named = " and ".join(exact.effects)
    if exact.verdict is Verdict.MISSING_EFFECT:
        return f"{named} would be missing"
    if exact.verdict is Verdict.AMBIGUOUS:
        return f"{named} might be missing, or another effect"
    if exact.verdict is Verdict.ADEQUATE:
        return "nothing would be missing within the tolerance of its laws"
    if exact.verdict is Verdict.UNDECIDED:
        return "it is not decided whether anything is missing"
    return "the model would not agree, and nothing in the library would explain it"


def _left_with_exact_sensors(one: Evidence) -> str:
    if not one.subject:
        return "with exact sensors, no effect of the library would explain it"
    names = " and ".join(one.subject)
    return f"with exact sensors, {names} would be nearest, and leave {share_text(one.value)} of the misfit"


def _drift(one: Evidence) -> str:
    drift = _found(one, Drift)
    return (
        f"{drift.parameter} moves from {one.threshold:.4g} to {one.value:.4g} {drift.unit}: "
        "it had absorbed part of what was missing"
    )


_WORDS: Mapping[Quantity, Callable[[Evidence], str]] = {
    "power": _power,
    "record_level": lambda one: record_level_text(_found(one, RecordQuantity)),
    "size": _size,
    "joint_size": _size,
    "mbic": _mbic,
    "left_out_error": _left_out_error,
    "absorbed": _absorbed,
    "rival": lambda one: rival_text(_found(one, Rival)),
    "left_alone": _left_alone,
    "levels": _levels,
    "scatter": lambda one: scatter_text(_found(one, SizeScatter)),
    "sensor_error": _sensor_error,
    "exact_sensors": _exact_sensors,
    "left_with_exact_sensors": _left_with_exact_sensors,
    "drift": _drift,
}
