"""Slow noise or a missing effect: what these data cannot tell, and what would decide it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigctl.analysis.agreement.adequacy import beyond_statement
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.groups import SAME_START
from rigctl.noise import ChannelNoise, correlation_time, even_pieces
from rigctl.units import show

#: a floor below this many times the error of rounding to a converter's steps is mostly that error
_BY_STEPS = 1.1
#: a rest shows a slow noise if it lasts this many times as long as the errors stay alike, ...
_TIMES = 30.0
#: ... and at least this many samples: several windows of the noise estimate
_SAMPLES = 160


def undecided_text(fit: FitResult, name: str, channels: Sequence[str]) -> str:
    """Why the errors of some channels do not tell whether a model agrees, in one sentence."""
    parts = [
        _channel_text(fit, channel) for channel in fit.problem.noise.channels if channel.name in channels
    ]
    return (
        f"Not decided for {name}: {'; '.join(parts)}. It is slow noise or a missing effect, and these data "
        "cannot tell which"
    )


def unproven_text(fit: FitResult, nearest: FitResult | None, effects: Sequence[str]) -> str:
    """Something is missing, whatever the noise is, and no effect proves itself; the nearest one, if any."""
    opening = (
        "Something is missing, whatever the noise is: a test that needs no noise level rejects the model. No "
        "effect of the library removes so much of the error, or predicts so well what it was not fitted to, "
        "that it could be named"
    )
    if nearest is None:
        return opening
    falls = [_fall(fit, nearest, channel) for channel in fit.problem.noise.channels if channel.own_scale]
    return f"{opening}. The nearest is {' and '.join(effects)}: with it {'; '.join(falls)}"


def _fall(fit: FitResult, nearest: FitResult, channel: ChannelNoise) -> str:
    unit = _unit(fit, channel)
    before, after = (
        show(one.errors[channel.name].rmse, unit, difference=True, digits=2) for one in (fit, nearest)
    )
    return f"the error of {channel.name} falls from {before} to {after}"


def _unit(fit: FitResult, channel: ChannelNoise) -> str:
    measurements = fit.problem.measurements
    return dict(zip(measurements.outputs, measurements.units, strict=True))[channel.name]


def unusable_text(fit: FitResult, name: str) -> str:
    """Which stated noise is far from the data, so that no verdict rests on either."""
    remarks = [f"of {one.name} {one.remark}" for one in fit.problem.noise.channels if one.unusable]
    return (
        f"Not decided for {name}: {'; '.join(remarks)}. Correct the number, or its unit, in the rig file, or "
        "leave it out"
    )


def what_decides(fit: FitResult, channels: Sequence[str]) -> tuple[str, ...]:
    """What would tell slow noise from a missing effect, the cheapest first; one sentence each."""
    if not channels:
        return ()
    spacing = fit.problem.noise.spacing
    longest = max(_alike(fit, name) for name in channels)
    rest = max(_TIMES * longest, _SAMPLES) * spacing
    noise = {channel.name: channel for channel in fit.problem.noise.channels}
    unstated = ", ".join(name for name in channels if not noise[name].allowed)
    coarse = [one.name for one in fit.problem.noise.channels if one.name in channels and _from_steps(one)]
    finer = "in finer steps: with a smaller range, or a converter with more bits"
    return (
        *([f"read {' and '.join(coarse)} {finer}"] if coarse else []),
        f"record {show(_rounded(rest), 's')} with every input constant, after the bench has come to rest, at "
        "the same sampling rate: it shows the slow part of the noise",
        *(
            ["repeat one record with the same commands: what differs between the two is noise"]
            if _repeatable(fit, channels)
            else []
        ),
        *(
            [
                f"state the noise of {unstated} in the rig file, if you know it: "
                "'noise: {white: …, slow: …, over: …}'"
            ]
            if unstated
            else []
        ),
    )


def _repeatable(fit: FitResult, channels: Sequence[str]) -> bool:
    """Whether a second record with the same commands would count as a repeat of one.

    A measured input never takes the same course twice, and errors that are slow make records start apart, by
    about √2 of them: where that exceeds what counts as the same start, two records are no replicates.
    """
    measurements = fit.problem.measurements
    if any(record.along for record in measurements.records):
        return False
    for name in channels:
        column = measurements.outputs.index(name)
        values = np.concatenate([record.values[:, column] for record in measurements.records])
        if math.sqrt(2.0) * fit.errors[name].rmse > SAME_START * float(np.nanmax(values) - np.nanmin(values)):
            return False
    return True


def _channel_text(fit: FitResult, channel: ChannelNoise) -> str:
    error, unit = fit.errors[channel.name], _unit(fit, channel)
    left = f"of {channel.name} an error of {show(error.rmse, unit, difference=True, digits=2)} is left"
    if channel.allowed:
        return f"{left}; {_beyond_statement(fit, channel, unit)}"
    if not channel.floor:
        return f"{left}, and too few readings show its noise"
    floor = show(channel.floor, unit, difference=True, digits=2)
    bound = "" if channel.plateau else "at most "
    times = error.rmse / channel.floor
    if times > 1.2:
        return f"{left}, {times:.2g} times its white noise of {bound}{floor}"
    if _from_steps(channel):
        step = show(channel.step, unit, difference=True, digits=2)
        return (
            f"{left}, as large as the steps of {step} make it in which it is read, and as slow as the signal"
        )
    return f"{left}, as large as its white noise of {bound}{floor}, but not white"


def _beyond_statement(fit: FitResult, channel: ChannelNoise, unit: str) -> str:
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


def _from_steps(channel: ChannelNoise) -> bool:
    """Whether the floor of a channel is hardly more than the error of its converter, step/√12."""
    return channel.step > 0.0 and channel.floor < _BY_STEPS * channel.step / math.sqrt(12.0)


def _alike(fit: FitResult, name: str) -> float:
    """Correlation time of a channel's errors, in samples."""
    problem = fit.problem
    column = problem.measurements.outputs.index(name)
    pieces = [
        piece
        for k in fit.fitted
        for piece in even_pieces(
            problem.records[k].times, fit.normalised_error(k)[:, column], problem.noise.spacing
        )
    ]
    return correlation_time(pieces) if pieces else 1.0


def _rounded(seconds: float) -> float:
    """A duration rounded up to one significant digit: no measurement is planned to the second."""
    scale = 10.0 ** math.floor(math.log10(seconds))
    return math.ceil(seconds / scale) * scale
