"""What would decide an open question, in words: noise or an effect, a sensor or an effect, a bound."""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from rigctl.analysis.agreement.sensors import Recalibration
from rigctl.analysis.agreement.undecided import (
    Decision,
    FinerSteps,
    RepeatedRecord,
    Rest,
    StatedNoise,
    WiderBounds,
)
from rigctl.answers.findings.sensor_errors import remedy_text
from rigctl.units import show


def decisions(found: Iterable[Decision]) -> list[str]:
    """A sentence for each."""
    return list(map(decision, found))


def decision(one: Decision) -> str:
    """``repeat one record with the same commands: …``."""
    match one:
        case FinerSteps(channels):
            text = (
                f"read {' and '.join(channels)} in finer steps: with a smaller range, or a converter with "
                "more bits"
            )
        case Rest(seconds):
            text = (
                f"record {show(seconds, 's')} with every input constant, after the bench has come to rest, "
                "at the same sampling rate: it shows the slow part of the noise"
            )
        case RepeatedRecord():
            text = "repeat one record with the same commands: what differs between the two is noise"
        case StatedNoise(channels):
            text = (
                f"state the noise of {', '.join(channels)} in the rig file, if you know it: "
                "'noise: {white: …, slow: …, over: …}'"
            )
        case Recalibration(error, share):
            text = remedy_text(error, share)
        case WiderBounds(parameters):
            text = (
                f"wider bounds of {' and '.join(parameters)} in its file; or, if they are right, a model "
                "with another effect"
            )
        case _:
            assert_never(one)
    return text
