"""By how much the band of a measured curve, used as an effect, moves the model's outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import qualified
from rigctl.effects.measured_curve import SHIFT
from rigctl.model.fit.fit import FitResult
from rigctl.units import parse_unit, show, significant

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CurveBand:
    """The change of one channel due to the band of one curve.

    Attributes
    ----------
    effect, channel: the curve, and the reading.
    unit: the channel's display unit.
    widths: (n) for each record, half the width, SI: the change with the whole curve at an edge of its band.
    record, time: where that is largest, `time` in s from the record's first sample; `noise` of that channel.
    """

    effect: str
    channel: str
    unit: str
    widths: tuple[Floats, ...] = field(repr=False)
    record: str
    time: float
    noise: float
    row: bool = False

    @property
    def largest(self) -> float:
        """SI."""
        return max((float(one.max()) for one in self.widths if one.size), default=0.0)

    @property
    def rms(self) -> float:
        """Over all samples, SI."""
        return float(np.sqrt(np.mean(np.square(np.concatenate(self.widths)))))

    @property
    def statement(self) -> str:
        """In words, with its location."""
        largest, rms = (show(size, self.unit, difference=True) for size in (self.largest, self.rms))
        when = "" if self.row else f" at {self.time:.3g} s"
        return (
            f"the band of the curve {self.effect} leaves {self.channel} uncertain by up to ±{largest} (in "
            f"{self.record}{when}; root mean square {rms}), "
            f"{significant(self.largest / self.noise, 2)} times its noise"
        )

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in the channel's unit."""
        unit = parse_unit(self.unit)
        return {
            "effect": self.effect,
            "channel": self.channel,
            "unit": "K" if unit.offset else self.unit,
            "largest": self.largest / unit.factor,
            "rms": self.rms / unit.factor,
            "record": self.record,
            "time": None if self.row else self.time,
            "statement": self.statement,
        }


def curve_bands(fit: FitResult) -> tuple[CurveBand, ...]:
    """The changes due to the bands of a model's measured curves, channel by channel.

    The fitted values are kept. Nothing for a model without such a curve, or one that cannot be simulated at
    the edges.
    """
    model = fit.problem.model
    names = [name for name in model.effects if (curve := model.effect(name).curve) and curve.half]
    return tuple(one for name in names for one in _of_effect(fit, name))


def combined(bands: Sequence[CurveBand], channel: str, k: int) -> Floats | None:
    """(n) half the width of all bands together in the record at `k`, SI; None if there is none."""
    widths = [one.widths[k] for one in bands if one.channel == channel]
    return np.sqrt(np.sum(np.square(widths), axis=0)) if widths else None


def _of_effect(fit: FitResult, effect: str) -> list[CurveBand]:
    problem = fit.problem
    # the whole curve at the upper and then at the lower edge of its band, by the parameter that moves it
    at = problem.compiled.system.parameter_names.index(qualified(effect, SHIFT.name))
    if qualified(effect, SHIFT.name) in {one.name for one in problem.shared}:
        return []  # a fitted curve has no band
    edges = []
    for shift in (1.0, -1.0):
        base = problem.base.copy()
        base[at] += shift
        simulated = problem.with_shared(problem.shared, base).simulate(fit.values, fit.local)
        if not simulated.ok:
            return []
        edges.append([np.take(array, problem.channels, axis=1) for array in simulated.outputs])
    half = [0.5 * np.abs(up - down) for up, down in zip(*edges, strict=True)]
    bands = []
    for c, (name, unit) in enumerate(
        zip(problem.measurements.outputs, problem.measurements.units, strict=True)
    ):
        widths = tuple(one[:, c] for one in half)
        k = max(range(len(widths)), key=lambda index: float(widths[index].max(initial=0.0)))
        record, row = problem.records[k], int(np.argmax(widths[k]))
        if widths[k][row] > 0.0:
            noise = float(np.nanmedian(problem.sigma[k][:, c]))
            bands.append(
                CurveBand(
                    effect, name, unit, widths, record.label, float(record.times[row]), noise, record.row
                )
            )
    return bands
