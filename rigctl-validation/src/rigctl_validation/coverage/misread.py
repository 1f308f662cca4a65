"""What is wrong with a user's sensors and guesses, drawn from what the files state of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Literal, TypeAlias

import numpy as np

from rigctl.units import parse_unit
from rigctl_validation.benches.bench import Floats
from rigctl_validation.moving_benches.campaign import MovingCampaign

Kind: TypeAlias = Literal["point", "line", "data_sheet"]
KINDS: Final[tuple[Kind, ...]] = ("point", "line", "data_sheet")
#: what a user writes: each part, or the uncertainty of a reading with its kind or alone
Written: TypeAlias = Literal["parts", "kind", "uncertainty"]
WRITTEN: Final[tuple[Written, ...]] = ("parts", "kind", "uncertainty")

#: least and greatest uncertainty of a calibration, 95 %, as a share of the span of the readings
_LEAST, _GREATEST = 0.002, 0.02
#: the range of a guess, in multiples of how far the value of a bench may be from its nominal one
_WIDE = 1.2


@dataclass(frozen=True)
class Misread:
    """The errors of a campaign's sensors, and the number of its model that is a guess.

    Each is normal with half of what is stated, 95 %: a constant, for a line also one that grows with the
    reading, and for a data sheet also a parabola.

    Attributes
    ----------
    campaign: the record with right sensors.
    kind: which of these errors there are.
    written: what is stated of them. Unless it is the parts, the errors together are as large as that.
    assumed: one number of the model is a guess.
    """

    campaign: MovingCampaign
    kind: Kind
    written: Written
    assumed: bool

    @cached_property
    def stated(self) -> Mapping[str, float]:
        """The uncertainty of each channel, 95 %, in the unit of its column."""
        readings = self.campaign.readings(0.0)
        shares = np.exp(self.campaign.rng(11).uniform(math.log(_LEAST), math.log(_GREATEST), len(readings)))
        return {
            name: float(f"{share * np.ptp(values):.3g}")
            for share, (name, values) in zip(shares.tolist(), readings.items(), strict=True)
        }

    @cached_property
    def guess(self) -> str:
        """The parameter that is a guess; "" for none."""
        drawn = self.campaign.twin.drawn
        if not self.assumed or len(drawn) < 2:  # without another number there would be nothing to fit
            return ""
        return drawn[int(self.campaign.rng(13).integers(len(drawn)))].parameter

    @cached_property
    def _count(self) -> int:
        return 1 + KINDS.index(self.kind)

    def read(self, table: Mapping[str, Floats]) -> dict[str, Floats]:
        """The columns of a log as these sensors read them."""
        truth = self.campaign.readings(0.0)
        rng = self.campaign.rng(12)
        together = 1.0 if self.written == "parts" else 1.0 / math.sqrt(self._count)
        errors = {}
        for name, stated in self.stated.items():
            low, high = float(truth[name].min()), float(truth[name].max())
            values = np.asarray(table[name])
            x = (2.0 * values - low - high) / (high - low)
            most = max(abs(low), abs(high))
            gain = values / most if self.written == "parts" else x
            shapes = (np.ones_like(x), gain, 1.5 * x * x - 0.5)
            sizes = 0.5 * together * stated * rng.standard_normal(3)
            errors[name] = sum(s * b for s, b in zip(sizes[: self._count], shapes, strict=False))
        return {name: values + errors.get(name, 0.0) for name, values in table.items()}

    def state(self, folder: Path) -> None:
        """State it in the user's rig file and model file."""
        rig, model = folder / "rig.yaml", folder / "model.yaml"
        text = rig.read_text(encoding="utf-8")
        for name, stated in self.stated.items():
            known = f"coefficients: [0, 1], date: 2026-01-10, {self._said(name, stated)}"
            text = re.sub(
                rf"^(  {name}: {{.*)}}$", rf"\1, calibration: {{{known}}}}}", text, flags=re.MULTILINE
            )
        rig.write_text(text, encoding="utf-8", newline="\n")
        if self.guess:
            model.write_text(self._with_guess(model.read_text("utf-8")), encoding="utf-8", newline="\n")

    def _said(self, name: str, stated: float) -> str:
        """The uncertainty of a channel as a user writes it."""
        unit = self.campaign.twin.bench.columns[name].replace("degC", "K")
        if self.written != "parts":
            kind = f", kind: {self.kind}" if self.written == "kind" else ""
            return f"uncertainty: {stated:g} {unit}{kind}"
        most = float(np.abs(self.campaign.readings(0.0)[name]).max())
        parts = (
            f"zero: {stated:g} {unit}",
            f"gain: {100.0 * stated / most:.6g} %",
            f"linearity: {stated:g} {unit}",
        )
        return ", ".join(parts[: self._count])

    def _with_guess(self, text: str) -> str:
        drawn = {one.parameter: one for one in self.campaign.twin.drawn}[self.guess]

        def assumed(line: re.Match[str]) -> str:
            value, unit = float(line["value"]), line["unit"]
            nominal = drawn.si * drawn.nominal / parse_unit(unit).factor  # which the file may round
            reach = _WIDE * drawn.spread * nominal + abs(value - nominal)
            ends = ", ".join(f"{value + sign * reach:.6g} {unit}" for sign in (-1.0, 1.0))
            return f"{line['begin']}{line['value']} {unit}, standing: assumed, range: [{ends}]}}"

        form = rf"(?P<begin>  {self.guess}: {{value: )(?P<value>[\d.e+-]+) (?P<unit>[^,]+), fit: true}}"
        return re.sub(form, assumed, text)
