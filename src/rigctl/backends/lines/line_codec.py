"""Translates between the rig's SI values and the numbers and words in a device's lines."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.rig import LineActuator, Lines, Rig
from rigctl.rig.protocols.line_pattern import is_whole, read_number, resolution
from rigctl.rig.setting import POSITIONS
from rigctl.units import parse_unit

#: SCPI writes infinity as 9.9e37 and NaN as 9.91e37 (SCPI-99, volume 1, 7.2.1.4 and 7.2.1.5)
_NO_NUMBER = 9.9e37


class LineCodec:
    """Conversion of the rig's channels and actuators to and from the lines of a device."""

    def __init__(self, rig: Rig, lines: Lines) -> None:
        self._rig = rig
        self._lines = lines

    def channel(self, name: str, text: str) -> float:
        """Return the SI value of a channel from an answer; NaN if it is not a number."""
        raw = read_number(text)
        return math.nan if raw is None else self.of_number(name, raw)

    def of_number(self, name: str, raw: float) -> float:
        """Return the SI value of a channel from the number in an answer."""
        return math.nan if abs(raw) >= _NO_NUMBER else self._rig.channels[name].value_from_raw(raw)

    def command(self, name: str, value: float) -> str:
        """Return the command that sets an actuator to an SI value."""
        part = self._lines.actuators[name]
        return part.template.fill(self._written(name, part, value))

    def written(self, name: str, value: float) -> str:
        """Return an SI value as text, as written in the command."""
        part = self._lines.actuators[name]
        return part.template.written(self._written(name, part, value))

    def read_as(self, name: str, value: float) -> str:
        """Return an SI value as text, as the device writes it in the answer to a query."""
        part = self._lines.actuators[name]
        if part.answers is None:
            return self.written(name, value)
        return part.answers[_position(self._rig.actuators[name].kind, value)]

    def setting(self, name: str, text: str, commanded: float) -> float | None:
        """Return the SI value of an actuator from an answer; `commanded` if the answer repeats its text.

        None if it is not a value.
        """
        part = self._lines.actuators[name]
        expected = self._written(name, part, commanded)
        if isinstance(expected, str):
            return self._of_word(name, part, text)
        number = read_number(text)
        if number is None or math.isnan(number):
            return None
        sent = part.template.written(expected)
        if is_whole(sent) and float(sent) == 0.0:  # no device rounds 0 to 1
            near = abs(number) < max(resolution(text), 1.0)
        else:
            near = abs(number - expected) <= resolution(text) + resolution(sent)
        if near:
            return commanded
        return self._of_number(name, part, number)

    def _written(self, name: str, part: LineActuator, value: float) -> float | str:
        """Return the number or the word for an SI value."""
        actuator = self._rig.actuators[name]
        positions = POSITIONS.get(actuator.kind)
        if positions is not None:
            if value not in positions.values():
                raise RigctlError(
                    f"{name} has no such position", value=f"{value:g}", expected=", ".join(positions)
                )
            return (part.words or {})[_position(actuator.kind, value)]
        if part.scale is None:
            return parse_unit(actuator.display_unit).from_si(value)
        low, high = float(actuator.low or 0.0), float(actuator.high or 0.0)
        first, last = part.scale
        return first + (value - low) / (high - low) * (last - first)

    def _of_word(self, name: str, part: LineActuator, text: str) -> float | None:
        positions = POSITIONS[self._rig.actuators[name].kind]
        for words in (part.answers or {}, part.words or {}):
            for word, written in words.items():
                same_number = read_number(text) is not None and read_number(text) == read_number(written)
                if same_number or text.casefold() == written.casefold():
                    return positions[word]
        return None

    def _of_number(self, name: str, part: LineActuator, number: float) -> float:
        actuator = self._rig.actuators[name]
        if part.scale is None:
            return parse_unit(actuator.display_unit).to_si(number)
        low, high = float(actuator.low or 0.0), float(actuator.high or 0.0)
        first, last = part.scale
        return low + (number - first) / (last - first) * (high - low)


def _position(kind: str, value: float) -> str:
    """Return the name of the position of an actuator that has positions."""
    return {number: word for word, number in POSITIONS[kind].items()}[value]
