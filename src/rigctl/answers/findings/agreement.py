"""What a comparison says of one model, in a sentence: whether it agrees, and if not, where and how it
fails.

In: the facts of a `ModelComparison`. Out: text without a full stop; `rigctl.answers.comparison` makes the
answer of blocks around it. Nothing is decided here: the cases follow from the verdict of the tests and from
what is known of the noise, and each states the number on which it rests.
"""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.agreement.adequacy import beyond_statement
from rigctl.analysis.agreement.record_level import RecordQuantity
from rigctl.analysis.agreement.trends import Trend
from rigctl.analysis.agreement.undecided import from_steps
from rigctl.analysis.comparison_result import ModelComparison, offset_of_clock
from rigctl.answers.findings.sensor_errors import beyond_text, exact_text, explanation
from rigctl.answers.findings.tables import table_statement
from rigctl.answers.trends import trend_text
from rigctl.model.fit.fit import FitResult
from rigctl.noise import ChannelNoise
from rigctl.units import show
from rigctl.wording import chance_text

#: least share of an error that is stated: one per cent, rounded
_SAID = 0.005


def statement(model: ModelComparison) -> str:
    """The result in one plain sentence."""
    # The stated errors of sensors come first: where they are a part of the answer, the tests on their own say
    # "adequate" or "not" of something else than the reader asks.
    if model.sensors is not None and model.adequacy.only_misread:
        return (
            f"{beyond_text(model.sensors)}; with that error {model.name} agrees with the measurements "
            "within their noise"
        )
    if model.explained_by and model.sensors is not None and model.exact is not None:
        rejected = model.exact.adequacy.verdict is False
        chance = chance_text(model.exact.adequacy.p_value)
        exact = f"it would not ({chance})" if rejected else "that is not decided"
        return (
            f"{model.name} agrees with the measurements within their noise and the stated "
            f"{offset_of_clock(model.explained_by)}: {explanation(model.sensors)}. "
            f"With exact {exact_text(model.sensors)} {exact}"
        )
    return _of_tests(model)


def _of_tests(model: ModelComparison) -> str:
    """What the tests say, where no error of a sensor is a part of the answer."""
    name, adequacy = model.located.name, model.adequacy
    chance = chance_text(adequacy.p_value)
    if model.rows:
        return table_statement(name, adequacy, model.rows, direction_text(model.trends))
    # From what forbids a verdict to what gives one. An error below the noise, a stated noise that the data
    # contradict and a noise known only by its floor each leave a p-value that looks like any other, but
    # decides nothing.
    if adequacy.below_noise:
        return (
            f"{name} deviates from the measurements by less than their noise: a test detects a pattern "
            f"in the residuals ({chance}), but the noise of these readings differs from its estimate, so "
            "that they cannot decide"
        )
    if adequacy.unusable:
        return _unusable_text(model.fit, name)
    if adequacy.undecided:
        return undecided_text(model.fit, name, adequacy.unproven) + _with_exact(model)
    if adequacy.adequate:
        return _agreement(model)
    text = f"{name} does not agree with the measurements ({chance})"
    worst = next((place for place in model.where if place.by == "cell"), None)
    if worst is not None and worst.share_of_error >= _SAID:
        text += f": {100 * worst.share_of_error:.0f} % of the systematic error is in {worst.label}"
    direction = direction_text(model.trends)
    return f"{text}. {direction}" if direction else text


def _with_exact(model: ModelComparison) -> str:
    if model.rejected_if_exact is None:
        return ""
    exact = chance_text(model.rejected_if_exact)
    return (
        f". Errors of sensors, within what is stated, are a part of it: a test rejects exact ones ({exact})"
    )


def _agreement(model: ModelComparison) -> str:
    name = model.located.name
    text = f"{name} agrees with the measurements within their noise (p = {model.adequacy.p_value:.2g})"
    if model.adequacy.stated:
        channels = ", ".join(model.adequacy.stated)
        text = f"{name} agrees with the measurements within the noise of {channels} that the rig file states"
    suspicious = model.located.suspicious
    if suspicious is not None:
        return f"{text}, but {record_level_text(suspicious)}"
    return text if model.contradicted else f"{text}: these data show nothing that it lacks"


def direction_text(candidates: Sequence[Trend]) -> str:
    """The worst modelled trend in one sentence; "" if none is wrong."""
    notable = [trend for trend in candidates if trend.significant and trend.matters]
    worst = [trend for trend in notable if trend.wrong_sign] or notable
    if not worst:
        return ""
    text = trend_text(worst[0])
    capitalised = text[0].upper() + text[1:]
    return f"{capitalised}: the wrong direction" if worst[0].wrong_sign else capitalised


def record_level_text(quantity: RecordQuantity) -> str:
    """What a quantity of the records is evidence of; "" if it is ordinary variation between them."""
    low, high = (quantity.shown(float(end)) for end in (quantity.values.min(), quantity.values.max()))
    words = []
    if quantity.exceeds:
        chance = chance_text(min(1.0, quantity.p_value * quantity.count))
        words.append(f"more than its prior allows ({chance})")
    if quantity.follows:
        chance = chance_text(min(1.0, quantity.over_p_value * quantity.count))
        words.append(f"{'and it follows' if words else 'following'} {quantity.over} ({chance})")
    if not words:
        return ""
    return (
        f"{quantity.meaning} ranges from {low} to {high} over the records, {', '.join(words)}: it may be "
        "compensating for something that the model lacks, or its "
        f"prior is too narrow ({prior_text(quantity)})"
    )


def prior_text(quantity: RecordQuantity) -> str:
    """What is known of it beforehand: ``23 degC ± 2 K``, ``free``."""
    if quantity.span is not None:
        return " to ".join(show(end, quantity.unit, difference=quantity.difference) for end in quantity.span)
    first = quantity.estimates[0]
    if not quantity.has_prior:
        return "free"
    if len({(one.prior_mean, one.prior_std) for one in quantity.estimates}) > 1:
        return "of each record"
    width = show(first.prior_std, quantity.unit, difference=True, digits=2)
    return f"{quantity.shown(first.prior_mean)} ± {width}"


def undecided_text(fit: FitResult, name: str, channels: Sequence[str]) -> str:
    """Why the errors of some channels do not tell whether a model agrees, in one sentence."""
    parts = [
        _channel_text(fit, channel) for channel in fit.problem.noise.channels if channel.name in channels
    ]
    return (
        f"Not decided for {name}: {'; '.join(parts)}. It is slow noise or a missing effect, and these data "
        "cannot tell which"
    )


def _unusable_text(fit: FitResult, name: str) -> str:
    """Which stated noise is far from the data, so that no verdict rests on either."""
    remarks = [f"of {one.name} {one.remark}" for one in fit.problem.noise.channels if one.unusable]
    return (
        f"Not decided for {name}: {'; '.join(remarks)}. Correct the number, or its unit, in the rig file, or "
        "leave it out"
    )


def _channel_text(fit: FitResult, channel: ChannelNoise) -> str:
    error, unit = fit.errors[channel.name], fit.problem.measurements.unit_of(channel.name)
    left = f"of {channel.name} an error of {show(error.rmse, unit, difference=True, digits=2)} is left"
    # What bounds the noise decides what can be said: what the rig file states, else the white floor; and only
    # if the error is near that floor, whether the rounding of the readings explains it.
    if channel.allowed:
        return f"{left}; {_beyond_what_is_stated(fit, channel, unit)}"
    if not channel.floor:
        return f"{left}, and too few readings show its noise"
    floor = show(channel.floor, unit, difference=True, digits=2)
    bound = "" if channel.plateau else "at most "
    times = error.rmse / channel.floor
    if times > 1.2:
        return f"{left}, {times:.2g} times its white noise of {bound}{floor}"
    if from_steps(channel):
        step = show(channel.step, unit, difference=True, digits=2)
        return (
            f"{left}, as large as the steps of {step} make it in which it is read, and as slow as the signal"
        )
    return f"{left}, as large as its white noise of {bound}{floor}, but not white"


def _beyond_what_is_stated(fit: FitResult, channel: ChannelNoise, unit: str) -> str:
    """Why the noise that the rig file states does not explain the errors of a channel."""
    stated = f"the rig file states a noise of {show(channel.allowed, unit, difference=True, digits=2)}"
    beyond = beyond_statement(fit, channel)
    if beyond == "faster":
        seconds = show(channel.together * fit.problem.noise.spacing, "s", digits=2)
        over = show(channel.over, "s", digits=2)
        return f"{stated} that changes over {over}, but these errors change within {seconds}"
    if beyond == "larger":
        return f"{stated}, but these errors are larger"
    return f"{stated}, but the model hardly follows the readings"
