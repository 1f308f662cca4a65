"""What would decide what these data cannot tell: slow noise or a missing effect, a sensor or an effect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rigctl.analysis.agreement.sensors import Recalibration
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.groups import SAME_START
from rigctl.noise import ChannelNoise, correlation_time, even_pieces

#: a floor below this many times the error of rounding to a converter's steps is mostly that error
_BY_STEPS = 1.1
#: a rest shows a slow noise if it lasts this many times as long as the errors stay alike, ...
_TIMES = 30.0
#: ... and at least this many samples: several windows of the noise estimate
_SAMPLES = 160


@dataclass(frozen=True)
class FinerSteps:
    """Channels read in finer steps."""

    channels: tuple[str, ...]


@dataclass(frozen=True)
class Rest:
    """A record with every input constant, of this many seconds: it shows the slow part of the noise."""

    seconds: float


@dataclass(frozen=True)
class RepeatedRecord:
    """A record with the same commands: what differs between the two is noise."""


@dataclass(frozen=True)
class StatedNoise:
    """The noise of channels, stated in the rig file."""

    channels: tuple[str, ...]


@dataclass(frozen=True)
class WiderBounds:
    """Wider bounds of parameters, in the file of their model."""

    parameters: tuple[str, ...]


#: what would decide an open question
Decision: TypeAlias = FinerSteps | Rest | RepeatedRecord | StatedNoise | Recalibration | WiderBounds


def what_decides(fit: FitResult, channels: Sequence[str]) -> tuple[Decision, ...]:
    """What would tell slow noise from a missing effect, the cheapest first."""
    if not channels:
        return ()
    spacing = fit.problem.noise.spacing
    longest = max(_alike(fit, name) for name in channels)
    rest = max(_TIMES * longest, _SAMPLES) * spacing
    noise = {channel.name: channel for channel in fit.problem.noise.channels}
    unstated = tuple(name for name in channels if not noise[name].allowed)
    coarse = tuple(one.name for one in fit.problem.noise.channels if one.name in channels and from_steps(one))
    return (
        *([FinerSteps(coarse)] if coarse else []),
        Rest(_rounded(rest)),
        *([RepeatedRecord()] if _repeatable(fit, channels) else []),
        *([StatedNoise(unstated)] if unstated else []),
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


def from_steps(channel: ChannelNoise) -> bool:
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
