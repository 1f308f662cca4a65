"""Sets the actuators of a line-based device, and makes it safe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from rigctl.backends.lines.meaning import Meaning
from rigctl.backends.lines.talk import Answer, Talk, WrongAnswer
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.rig import Exchange, Lines, Rig
from rigctl.rig.line_pattern import VALUE


@dataclass(frozen=True)
class SafeCommand:
    """One command that makes outputs safe.

    Parameters
    ----------
    exchange, text: the command, and its expected answer.
    require: raises `WrongAnswer` if an answer shows that something else was set.
    """

    exchange: Exchange
    text: str
    require: Callable[[Answer], None]


class Setter:
    """Commands for a rig's actuators."""

    def __init__(self, rig: Rig, lines: Lines) -> None:
        self._rig = rig
        self._lines = lines
        self._meaning = Meaning(rig, lines)

    def setting(self, talk: Talk, actuator: str, value: float) -> Conversation[CommandReceipt]:
        """Set an actuator to an SI value.

        Raises
        ------
        WrongAnswer
            the device refuses, or sets something else.
        PortLost
            the device does not answer.
        """
        part = self._lines.actuators[actuator]
        text = self._meaning.command(actuator, value)
        answer = yield from talk.asking(part, text)
        self._require(actuator, value, text, answer)
        if self._lines.confirm is not None:
            try:
                yield from talk.asking(self._lines.confirm, tries=1)
            except WrongAnswer as refused:
                raise WrongAnswer(text, refused.answer) from None
        middle, half = 0.5 * (answer.sent + answer.received), 0.5 * (answer.received - answer.sent)
        return CommandReceipt(middle, actuator, value, half)

    def _require(self, actuator: str, value: float, text: str, answer: Answer) -> None:
        """Require that an answer that contains a value contains the commanded one."""
        echoed = answer.found.get(VALUE)
        if echoed is not None and self._meaning.setting(actuator, echoed, value) != value:
            raise WrongAnswer(text, echoed, self._rig.actuators[actuator].show(value))

    def orders(self) -> tuple[SafeOrder, ...]:
        """Return the safe commands for the guard, which does not know the rig: bytes and expected answers."""
        ends = self._lines.send_ends.encode("utf-8")
        found = [
            SafeOrder(exchange.send.encode("utf-8") + ends, tuple(exchange.reply))
            for exchange in self._lines.safe
        ]
        for name, value in self._rig.safe_state.items():
            if self._rig.actuators[name].by == "driven":
                part, text = self._lines.actuators[name], self._meaning.command(name, float(value))
                written = self._meaning.written(name, float(value))
                found.append(SafeOrder(text.encode("utf-8") + ends, tuple(part.reply), written))
        return tuple(found)

    def identify_order(self) -> SafeOrder | None:
        """Return the identity query, for the guard."""
        who = self._lines.identify
        if who is None:
            return None
        return SafeOrder(who.send.encode("utf-8") + self._lines.send_ends.encode("utf-8"), tuple(who.reply))

    def safe_commands(self) -> Iterator[SafeCommand]:
        """Return the commands that make outputs safe: those of the file, then each actuator's safe value."""
        for exchange in self._lines.safe:
            yield SafeCommand(exchange, exchange.send, lambda _answer: None)
        for name, value in self._rig.safe_state.items():
            if self._rig.actuators[name].by == "driven":
                text = self._meaning.command(name, float(value))
                require = partial(self._require, name, float(value), text)
                yield SafeCommand(self._lines.actuators[name], text, require)
