"""Actuators: outputs that the bench, or its operator, switches or sets."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.amount import AmountField, AnyAmount, AnyRate
from rigctl.files.quantity import Q
from rigctl.rig.base import RigFilePart
from rigctl.rig.setting import POSITIONS
from rigctl.units import read_si, show


class Actuator(RigFilePart):
    """An output of the bench.

    A *switch* is off (0) or on (1); a *directional_valve* retracts (-1), rests (0) or extends (+1); a
    *level* is continuous from `low` to `high` in its unit.
    """

    kind: Literal["switch", "directional_valve", "level"] = Field(description="kind of command")
    by: Literal["driven", "operator"] = Field(
        default="driven", description="driven by the board, or set by hand when the operator is prompted"
    )
    description: str = Field(default="", description="for reports")
    device: str | None = Field(
        default=None, description="the device that switches it, by name; not needed where there is only one"
    )
    prompt: str | None = Field(default=None, description="instruction for the operator")
    unit: str | None = Field(default=None, description="of a level, e.g. bar")
    low: AnyAmount | None = Field(default=None, description="lowest level")
    high: AnyAmount | None = Field(default=None, description="highest level")
    power: Annotated[float, Q("W", low="0 W")] | None = Field(
        default=None, description="heating power while on"
    )
    repeatability: Annotated[float, Q("1", low="0 %")] | None = Field(
        default=None, description="relative standard deviation of a repeated setting of a level"
    )
    jitter: Annotated[float, Q("s", low="0 s")] = Field(
        default=0.0,
        description="standard deviation of the time from a command to its action, e.g. '5 ms'",
    )
    max_rate: AnyRate | None = Field(
        default=None,
        description="fastest change of a level that a step may command: 'set' then takes its time; the safe "
        "state is still commanded at once",
    )
    min_interval: Annotated[float, Q("s", low="0 s")] = Field(
        default=0.0, description="shortest time between two switching operations"
    )

    @property
    def display_unit(self) -> str:
        """The unit in which its values are shown; "1" for an actuator with positions."""
        return self.unit or "1"

    def read(self, written: object) -> float:
        """Return the SI value of a command given as text: the name of a position, or a level with its unit.

        Raises
        ------
        RigctlError
            there is no such position, the unit is wrong, or the level is out of range.
        """
        positions = POSITIONS.get(self.kind)
        if positions is None:
            value = read_si(AmountField().read(written).text, self.display_unit)
            self._check_level(value)
            return value
        if isinstance(written, str) and written in positions:
            return positions[written]
        try:
            number = float(str(written))
        except ValueError:
            raise unknown_name("position", str(written), positions) from None
        self.check(number)
        return number

    def check(self, value: float) -> None:
        """Refuse an SI value that is invalid for the actuator.

        Raises
        ------
        RigctlError
            the value is not one of its positions, or a level out of range.
        """
        positions = POSITIONS.get(self.kind)
        if positions is None:
            self._check_level(value)
        elif value not in positions.values():
            words = ", ".join(f"{word} ({number:g})" for word, number in positions.items())
            raise RigctlError("no position of this actuator", value=f"{value:g}", expected=words)

    def _check_level(self, value: float) -> None:
        low, high = self.low, self.high
        if (low is not None and value < low) or (high is not None and value > high):
            shown = " to ".join(show(end, self.display_unit) for end in (low, high) if end is not None)
            raise RigctlError("out of range", value=show(value, self.display_unit), expected=shown)

    def show(self, value: float) -> str:
        """Return an SI value as text: the name of the position, or the level with its unit."""
        for word, number in POSITIONS.get(self.kind, {}).items():
            if number == value:
                return word
        return show(value, self.display_unit)
