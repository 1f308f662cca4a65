"""A measured quantity of the bench.

In: the entry of a sensor in the rig file. Out: a `Channel`, which converts raw readings to SI and back,
and knows what is possible and how certain it is. Users write and read display units; readings become SI
here, with the calibration polynomial converted once.

`range` says what the sensor can measure at all. A value outside is no value for steps, conditions and
measures; without it, what a broken wire gives counts as a reading. `difference` marks a temperature
difference, which has no offset: 5 K are not 278.15 K.
"""

from __future__ import annotations

import sys
from functools import cached_property
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from rigctl.errors import RigctlError
from rigctl.files.amount import AnyAmount, AnyDifference
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart
from rigctl.rig.calibration import Calibration, Raw, inverse_polynomial, polynomial
from rigctl.rig.stated_noise import StatedNoise
from rigctl.units import Unit, interval_unit, parse_unit, show

#: measurable quantities, each with a unit of its dimension; for "other" the unit determines the dimension
QUANTITIES: dict[str, str | None] = {
    "temperature": "K",
    "pressure": "Pa",
    "position": "m",
    "speed": "m/s",
    "acceleration": "m/s^2",
    "flow": "m^3/s",
    "volume": "m^3",
    "mass": "kg",
    "force": "N",
    "torque": "N*m",
    "angle": "rad",
    "angular_speed": "rad/s",
    "frequency": "Hz",
    "time": "s",
    "voltage": "V",
    "current": "A",
    "resistance": "ohm",
    "inductance": "H",
    "charge": "C",
    "power": "W",
    "energy": "J",
    "mass_flow": "kg/s",
    "density": "kg/m^3",
    "viscosity": "m^2/s",
    "fraction": "1",
    "other": None,
}
QuantityName: TypeAlias = Literal[
    "temperature",
    "pressure",
    "position",
    "speed",
    "acceleration",
    "flow",
    "volume",
    "mass",
    "force",
    "torque",
    "angle",
    "angular_speed",
    "frequency",
    "time",
    "voltage",
    "current",
    "resistance",
    "inductance",
    "charge",
    "power",
    "energy",
    "mass_flow",
    "density",
    "viscosity",
    "fraction",
    "other",
]


class Channel(RigFilePart):
    """One sensor: the quantity, its display unit, and the conversion from raw to physical values."""

    unit: str = Field(description="unit for display and storage, e.g. bar")
    quantity: QuantityName = Field(description="the measured quantity")
    description: str = Field(default="", description="for reports: location and type of the sensor")
    device: str | None = Field(
        default=None, description="the device that reads it, by name; not needed where there is only one"
    )
    raw: Raw | None = Field(
        default=None,
        description="the converter behind it; without one readings are neither rounded nor clipped",
    )
    calibration: Calibration = Field(
        default=Calibration(), description="conversion from raw values to the unit"
    )
    noise: StatedNoise | AnyDifference | None = Field(
        default=None,
        description="standard deviation of a reading, or its parts: {white: 0.1 K, slow: 0.3 K, over: 60 s}",
    )
    range: tuple[AnyAmount, AnyAmount] | None = Field(
        default=None,
        description="the physically possible range: a reading outside is no value, and a sensor that gives "
        "none for `stale_after`, or in a fifth of its readings, is broken",
    )
    stale_after: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None,
        description="a reading older than this is no value, and no value for this time is a fault; by "
        "default `stale_after` of its device, or of the rig",
    )
    counts_up: bool = Field(
        default=False,
        description="a clock or counter of the device that only grows: a smaller reading means that the "
        "device has restarted, and its outputs with it",
    )
    difference: bool = Field(
        default=False, description="a temperature difference, converted without an offset"
    )

    @cached_property
    def display(self) -> Unit:
        """The display unit, parsed."""
        return parse_unit(self.unit)

    @property
    def noise_level(self) -> float:
        """SI, the stated standard deviation of one reading; 0 if none is stated."""
        return self.noise.total if isinstance(self.noise, StatedNoise) else float(self.noise or 0.0)

    def reading_uncertainty(self, middle: float, half: float) -> dict[str, float]:
        """Return the uncertainty of its calibration, 95 %, SI, for readings within `half` of `middle`.

        Of `zero`, `gain` and `linearity`, each by its largest error; 0 where the rig file states none.
        """
        origin = self.display.to_si(0.0, difference=self.difference)
        return self.calibration.parts(origin, middle, half, self.uncertainty)

    @property
    def uncertainty(self) -> float:
        """Of a calibrated reading, 95 %, SI; 0 where the rig file states none."""
        stated = float(self.calibration.uncertainty or 0.0)
        return stated * self.width if self.states_share_of_range else stated

    @property
    def width(self) -> float:
        """Of its range, SI; 0 without one."""
        return 0.0 if self.range is None else float(self.range[1]) - float(self.range[0])

    @property
    def states_share_of_range(self) -> bool:
        """Whether the uncertainty of its calibration is a percentage, which is one of its range."""
        stated = self.calibration.uncertainty
        return stated is not None and stated.unit.text == "%" and not self.display.dimension.dimensionless

    @property
    def interval_unit(self) -> str:
        """The display unit of differences of its values: kelvin for a temperature."""
        return interval_unit(self.unit)

    @cached_property
    def si_coefficients(self) -> tuple[float, ...]:
        """The calibration polynomial from raw values to SI, lowest power first."""
        first, *rest = self.calibration.coefficients
        return (
            self.display.to_si(first, difference=self.difference),
            *(coefficient * self.display.factor for coefficient in rest),
        )

    @property
    def converter(self) -> Raw:
        """The channel's converter, for a device that always has one.

        Raises
        ------
        RigctlError
            the rig file describes none.
        """
        if self.raw is None:
            raise RigctlError(
                "the channel has no converter in the rig file",
                expected="'raw: {bits: 10, low: 0, high: 1023}', say, with the channel",
            )
        return self.raw

    @property
    def raw_unit(self) -> str:
        """The unit of raw values; without a converter a device reports the channel's unit."""
        return self.unit if self.raw is None else self.raw.unit

    def value_from_raw(self, raw: float) -> float:
        """Return the SI value of a raw reading."""
        return polynomial(self.si_coefficients, raw)

    def raw_from_value(self, value: float) -> float:
        """Return the raw reading of an SI value, before quantisation."""
        if self.raw is None:  # the calibration is then a straight line, see `rig.checks`
            return inverse_polynomial(self.si_coefficients, value, 0.0, 1.0)
        return inverse_polynomial(self.si_coefficients, value, self.raw.low, self.raw.high)

    @property
    def resolution(self) -> float:
        """The size of one step of the converter in the middle of its range, SI; 0 without a converter."""
        if self.raw is None:
            return 0.0
        middle = 0.5 * (self.raw.low + self.raw.high)
        half = 0.5 * self.raw.step
        return abs(self.value_from_raw(middle + half) - self.value_from_raw(middle - half))

    def too_fine(self, within: float) -> str | None:
        """Return why readings cannot be held within ± `within`, SI; None if they can."""
        reasons = [
            f"its {what} of {show(size, self.unit, difference=True)}"
            for what, size in (("noise", self.noise_level), ("converter step", self.resolution))
            if within < size
        ]
        return "the tolerance is smaller than " + " and ".join(reasons) if reasons else None

    @property
    def band(self) -> tuple[float, float]:
        """The physically possible range, SI, both ends included; without one, every finite number."""
        if self.range is None:
            return -sys.float_info.max, sys.float_info.max
        return float(self.range[0]), float(self.range[1])

    def possible(self, value: float) -> bool:
        """Return whether an SI value is in the physically possible range; False for NaN and infinity."""
        low, high = self.band
        return low <= value <= high
