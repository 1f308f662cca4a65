"""What a table shows about a model, in sentences: how far off it is, where, and what to measure next.

In: findings on single values (`rigctl.analysis.single_values`). Out: sentences. A table has few values and
often no replicates, so its answer says more than a test: the worst row, the ends, what refitting the
constants changes, and how large an effect would have to be in order to be seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import assert_never

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.agreement.trends import Trend
from rigctl.analysis.diagnosis_result import Diagnosis, Exclusion
from rigctl.analysis.single_values.exclusions import TURNS, main_trend
from rigctl.analysis.single_values.findings import (
    EndLeftOut,
    Ends,
    Finding,
    HeldOut,
    NearChance,
    OfTheConstants,
    Sensitivity,
    SettingOffsets,
)
from rigctl.analysis.single_values.next_values import (
    ChannelOverTime,
    FurtherPoint,
    MoreValues,
    NextStep,
    RepeatedConditions,
    Repeats,
    SecondMeasurement,
)
from rigctl.analysis.single_values.rows import TableRow
from rigctl.answers.trends import ends_text
from rigctl.units import show
from rigctl.wording import chance_text, listed, number_of, strength


def table_statement(name: str, adequacy: Adequacy, rows: Sequence[TableRow], direction: str) -> str:
    """The verdict of a comparison with a table, with the largest misfit by its operating point."""
    fitted = [row for row in rows if row.fitted]
    worst = max(fitted, key=lambda row: abs(row.z))
    quantities = " and ".join(dict.fromkeys(row.quantity for row in fitted))
    count = f"the {len(fitted)} values of {quantities}"
    chance = chance_text(adequacy.p_value)
    largest = f"the largest misfit is at {worst.condition}: {_off(worst, worst.predicted)}"
    if adequacy.adequate:
        return f"{name} agrees with {count} within their noise ({chance}); {largest}"
    text = f"{name} does not agree with {count} ({chance}); {largest}"
    return f"{text}. {direction}" if direction else text


def findings(found: Iterable[Finding]) -> list[str]:
    """A sentence for each."""
    return list(map(_text, found))


def _text(found: Finding) -> str:
    match found:
        case Ends(low, high, fitted):
            model = "the fitted model" if fitted else "the model"
            first, second = (f"at {row.condition} {_off(row, row.predicted, model)}" for row in (high, low))
            text = f"At the ends of the table: {first}; {second}"
        case OfTheConstants():
            text = _constants_text(found)
        case EndLeftOut():
            text = _end_text(found)
        case HeldOut(count, worst):
            text = f"Of the {count} values held out, at {worst.condition} {_off(worst, worst.predicted)}"
        case SettingOffsets(variable, unit, offsets):
            shares = ", ".join(f"{show(point, unit)} {100 * share:+.1f} %" for point, share in offsets)
            text = (
                f"The rows of each {variable} share an offset, as if it had been set differently from what "
                f"was written down, by so much relative to their mean: {shares}. What is judged is what "
                "changes at one setting"
            )
        case Sensitivity():
            text = _sensitivity_text(found)
        case NearChance(scores):
            named = ", ".join(
                f"{one.effect} ({one.z:.1f} sigma, {chance_text(one.p_value)})" for one in scores
            )
            text = f"Effects that would improve the fit, but not significantly: {named}"
        case _:
            assert_never(found)
    return text


def _off(row: TableRow, predicted: float, model: str = "the model") -> str:
    """``the model is 3.0 % (0.29 cSt) below the measured value, 4.2 times its noise``."""
    z = (predicted - row.measured) / row.noise
    side = "above" if predicted > row.measured else "below"
    return f"{model} is {_how_much(row, predicted)} {side} the measured value, {abs(z):.1f} times its noise"


def _how_much(row: TableRow, predicted: float) -> str:
    """A deviation without its sign: ``3.0 % (0.29 cSt)``."""
    share = row.share(predicted)
    absolute = f"{abs(predicted - row.measured):.2g} {row.unit}"
    return f"{100 * abs(share):.1f} % ({absolute})" if abs(share) < 10.0 else absolute


def _constants_text(found: OfTheConstants) -> str:
    row = found.row
    assert row.unfitted is not None  # noqa: S101 - it was chosen by it
    text = f"With the constants of its file, at {row.condition} {_off(row, row.unfitted)}"
    if found.left:
        return f"{text}, and refitting its constants does not remove that"
    return (
        f"{text}. Fitted to this table it is {abs(row.z):.1f} times the noise off there: that misfit "
        "is one of the constants, and no evidence against the law"
    )


def _end_text(found: EndLeftOut) -> str:
    row, side = found.worst, "more" if found.predicted > found.worst.measured else "less"
    quantity = "" if found.alone else f" for {row.quantity}"
    return (
        f"Fitted without the {len(found.rows)} values from {found.rows[0].condition} to "
        f"{found.rows[-1].condition}, the model predicts {_how_much(row, found.predicted)} {side} than "
        f"measured{quantity} at {row.condition}, {found.deviations:.1f} standard deviations of noise and "
        f"extrapolation combined ({chance_text(found.p_value)})"
    )


def _sensitivity_text(found: Sensitivity) -> str:
    many = f"{found.values} values for {number_of(found.constants, 'fitted constant')}"
    if found.settings:
        many += f" and a level for each of {found.settings} settings"
    if not found.degrees:
        return f"{many}, and the noise is only guessed: no verdict is more certain than that guess"
    one = (
        "an effect" if found.effects == 1 else f"whatever the correlation of the {found.effects} effects, one"
    )
    return (
        f"{many} leave {found.freedom} degrees of freedom; the noise is itself known only to about "
        f"{100 / math.sqrt(2 * found.degrees):.0f} %: {one} is significant above {found.needed:.1f} sigma, "
        f"{found.if_known:.1f} if the noise were known"
    )


def exclusions(diagnosis: Diagnosis) -> list[str]:
    """Which effects change nothing or in the wrong direction, which act in places, and which fit worse."""
    trend = main_trend(diagnosis.before)
    return [] if trend is None else exclusion_text(diagnosis.excluded, trend)


def exclusion_text(excluded: Sequence[Exclusion], trend: Trend) -> list[str]:
    """Those over the trend that the model misses most."""
    # Strongest first: what could not do it at any usual size, what does not at its best size, what explains
    # only some of the quantities, and what merely fits less well.
    never = [one.effect for one in excluded if not one.only and one.at_most < TURNS]
    unfit = [one.effect for one in excluded if not one.only and one.reached < TURNS <= one.at_most]
    want = "rise" if trend.measured > 0.0 else "fall"
    change = f"make the {trend.quantity} {want} {ends_text(trend)} as it does"
    sentences = []
    if never:
        sentences.append(
            f"excluded, because alone and at any usual size they cannot {change}: {', '.join(never)}"
        )
    if unfit:
        sentences.append(
            f"excluded, because alone and at the size that fits best they do not {change}: {', '.join(unfit)}"
        )
    sentences += [
        f"excluded, because alone it explains {' and '.join(one.only)} only: {one.effect}"
        for one in excluded
        if one.only
    ]
    less = [one for one in excluded if not one.only and one.reached >= TURNS]
    if less:
        named = ", ".join(f"{one.effect} (by {one.worse:.1f} sigma)" for one in less)
        sentences.append(f"excluded, because alone they fit less well than the best: {named}")
    return sentences


def next_steps(steps: Iterable[NextStep]) -> list[str]:
    """A sentence for each measurement that would help."""
    return list(map(_step_text, steps))


def _step_text(step: NextStep) -> str:
    match step:
        case ChannelOverTime():
            text = _channel_text(step)
        case SecondMeasurement(quantity, effects):
            text = (
                f"measure the {quantity} a second time, independently of the bench's sensor: "
                f"{listed(effects)} cannot be distinguished by any channel of the bench"
            )
        case FurtherPoint(quantity, condition, effect, change, times):
            text = (
                f"read {quantity} at {condition} too: {effect} changes it there by {100.0 * change:+.0f} %, "
                f"{times:.0f} times the noise of a reading"
            )
        case Repeats(readings, effect, size):
            text = (
                f"read each condition {readings} times: {effect}, if it is as large as it seems, would "
                f"then be {strength(size)}"
            )
        case MoreValues(variable, values, unit):
            shown = [show(value, unit, digits=3) for value in values]
            text = f"vary {variable}: every row is at {shown[0]}"
            if len(shown) == 2:
                text = f"take more values of {variable} than {listed(shown)}: any curve passes through two"
        case RepeatedConditions():
            text = "repeat each condition three times: so far the noise is only guessed"
        case _:
            assert_never(step)
    return text


def _channel_text(step: ChannelOverTime) -> str:
    single = [group[0] for group in step.groups if len(group) == 1]
    rest = [group for group in step.groups if len(group) > 1]
    distance = show(step.apart, step.unit, difference=True, digits=2)
    what = f"record {step.channel} over time{' instead of one number' if step.once else ''}"
    if not rest:
        return f"{what}: it distinguishes all of them, by up to {distance}"
    if not single:
        return f"{what}: it distinguishes {' from '.join(map(listed, rest))}, by up to {distance}"
    return f"{what}: it distinguishes {listed(single)} from the others, by up to {distance}"
