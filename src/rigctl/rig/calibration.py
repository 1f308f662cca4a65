"""The conversion between raw values of the converter and values of the channel.

In: what a rig file says of a channel's converter and calibration. Out: values for raw readings, raw
readings for values (for the benches without hardware, and a new calibration), and how large each kind of
error of a calibration may be.

The kind matters, as its errors have different shapes: a calibration at one point leaves the zero
uncertain, a line zero and gain, a data sheet the curvature too. Noise averages out over readings, these
do not; a fit has an unknown for each, so that a thermometer that is wrong within what is stated is not
taken for a missing effect of the model.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from rigctl.files.amount import AnyDifference
from rigctl.files.quantity import Q
from rigctl.rig.base import IsoDate, RigFilePart

_BISECTIONS = 60
#: how many of zero, gain and curvature a calibration of each kind leaves uncertain
_PARTS = {"point": 1, "line": 2, "data_sheet": 3}


class Raw(RigFilePart):
    """The range of the analogue-digital converter behind a channel.

    A converter of `bits` bits gives 2^bits values, evenly from `low` to `high`.
    """

    bits: int = Field(default=10, ge=1, le=32, description="resolution of the converter")
    low: FiniteFloat = Field(default=0.0, description="raw value of the lowest code")
    high: FiniteFloat = Field(default=1023.0, description="raw value of the highest code")
    unit: str = Field(default="count", description="unit of raw values: count or V")

    @property
    def step(self) -> float:
        """The difference between two adjacent codes, in raw units."""
        return (self.high - self.low) / ((1 << self.bits) - 1)

    def quantise(self, raw: float) -> float:
        """Return the raw value of the nearest code, limited to the range, as by a converter."""
        clipped = min(max(raw, self.low), self.high)
        return self.low + round((clipped - self.low) / self.step) * self.step


class Calibration(RigFilePart):
    """A polynomial from raw values to the channel's display unit: ``sum(c[k] * raw**k)``."""

    coefficients: tuple[FiniteFloat, ...] = Field(
        default=(0.0, 1.0),
        min_length=2,
        max_length=8,
        description="coefficients in the display unit, lowest power first",
    )
    date: IsoDate | None = Field(default=None, description="date of calibration")
    reference: str | None = Field(default=None, description="reference instrument")
    uncertainty: AnyDifference | None = Field(
        default=None,
        description="uncertainty of the calibrated value, 95 %; a percentage is one of the channel's range",
    )
    kind: Literal["point", "line", "data_sheet"] | None = Field(
        default=None,
        description="what `uncertainty` comes from: one `point` leaves the zero uncertain, a `line` zero and "
        "gain, a `data_sheet` the curvature too; without it, a comparison tries all three where exact "
        "sensors would show an error of the model",
    )
    zero: AnyDifference | None = Field(
        default=None, description="uncertainty of its zero, 95 %, instead of that by `uncertainty`"
    )
    gain: AnyDifference | None = Field(
        default=None, description="relative uncertainty of its gain, 95 %, e.g. '1 %'"
    )
    linearity: AnyDifference | None = Field(default=None, description="largest deviation from a line, 95 %")
    valid_for: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None, description="period of validity, e.g. '365 day'"
    )

    def expires(self) -> dt.date | None:
        """Return the first day on which it is out of date; None if it does not expire, or has no date."""
        if self.date is None or self.valid_for is None:
            return None
        try:
            return self.date + dt.timedelta(seconds=self.valid_for)
        except OverflowError:
            return None

    @property
    def states_parts(self) -> bool:
        """Whether the file states the uncertainty of its zero, gain or linearity."""
        return any(one is not None for one in (self.zero, self.gain, self.linearity))

    @property
    def known_parts(self) -> bool:
        """Whether the file says in what the calibration may be wrong: its kind, or its parts."""
        return self.kind is not None or self.states_parts

    def parts(self, origin: float, middle: float, half: float, whole: float) -> dict[str, float]:
        """Return the uncertainty, 95 %, SI, of zero, gain and curvature, each by its largest error.

        A calibration of no stated kind may be wrong in any of the three, unless its parts are stated.

        Parameters
        ----------
        origin: where the display unit is zero, SI; a relative uncertainty of the gain counts from there.
        middle, half: of the readings, SI: the gain is wrong about `middle`, by its largest error at the ends.
        whole: the uncertainty of a reading, 95 %, SI.
        """
        every = ("zero", "gain", "linearity")
        usual = every[: _PARTS[self.kind] if self.kind else 0 if self.known_parts else len(every)]
        parts = {part: whole if part in usual else 0.0 for part in every}
        if self.zero is not None:
            parts["zero"] = float(self.zero)
        if self.gain is not None:
            parts["gain"] = float(self.gain) * half
            parts["zero"] = math.hypot(parts["zero"], float(self.gain) * abs(middle - origin))
        if self.linearity is not None:
            parts["linearity"] = float(self.linearity)
        return parts


def polynomial(coefficients: Sequence[float], x: float) -> float:
    """Return ``sum(coefficients[k] * x**k)``, by Horner's scheme."""
    value = 0.0
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value


def monotonic(coefficients: Sequence[float], low: float, high: float, *, points: int = 257) -> bool:
    """Return whether the polynomial is strictly monotonic at `points` equidistant values, `low` to `high`."""
    grid = [low + (high - low) * i / (points - 1) for i in range(points)]
    values = [polynomial(coefficients, x) for x in grid]
    steps = [b - a for a, b in pairwise(values)]
    return all(step > 0.0 for step in steps) or all(step < 0.0 for step in steps)


def inverse_polynomial(coefficients: Sequence[float], y: float, low: float, high: float) -> float:
    """Return the x with ``polynomial(coefficients, x) = y``, which is monotonic from `low` to `high`.

    Exact for a straight line; by bisection otherwise. Outside the range it is extrapolated along the chord
    through both ends, so that a sensor driven out of range is limited by the converter and not here.
    """
    if not any(coefficients[2:]):
        return (y - coefficients[0]) / coefficients[1]
    at_low, at_high = polynomial(coefficients, low), polynomial(coefficients, high)
    if not min(at_low, at_high) <= y <= max(at_low, at_high):
        return low + (y - at_low) * (high - low) / (at_high - at_low)
    rising = at_high > at_low
    # By bisection, as that needs nothing but monotony, which the rig file's check has made sure of.
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if (polynomial(coefficients, middle) < y) == rising:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
