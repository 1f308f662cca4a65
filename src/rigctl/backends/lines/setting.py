"""Sets the actuators of a line-based device, and makes it safe."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

from rigctl.backends.lines.error_queue import errors_in_queue
from rigctl.backends.lines.line_client import LineClient, LineReply, WrongAnswer
from rigctl.backends.lines.line_codec import LineCodec
from rigctl.backends.protocol import CommandReceipt
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.rig import Exchange, Lines, Query, Rig
from rigctl.rig.protocols.line_pattern import VALUE


@dataclass(frozen=True)
class SafeCommand:
    """One command that makes outputs safe.

    Parameters
    ----------
    exchange, text: the command, and its expected answer.
    require: raises `WrongAnswer` if an answer shows that something else was set.
    actuators: the outputs that it makes safe.
    """

    exchange: Exchange
    text: str
    require: Callable[[LineReply], None]
    actuators: tuple[str, ...]


class Setter:
    """Commands for a rig's actuators."""

    def __init__(self, rig: Rig, lines: Lines) -> None:
        self._rig = rig
        self._lines = lines
        self._meaning = LineCodec(rig, lines)

    def setting(self, client: LineClient, actuator: str, value: float) -> Conversation[CommandReceipt]:
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
        answer = yield from client.asking(part, text)
        self._require(actuator, value, text, answer)
        errors = yield from errors_in_queue(client, self._lines)
        if errors:
            raise WrongAnswer(text, errors[0])
        middle, half = 0.5 * (answer.sent + answer.received), 0.5 * (answer.received - answer.sent)
        return CommandReceipt(middle, actuator, value, half)

    def _require(self, actuator: str, value: float, text: str, answer: LineReply) -> None:
        """Require that an answer that contains a value contains the commanded one."""
        echoed = answer.found.get(VALUE)
        if echoed is not None and self._meaning.setting(actuator, echoed, value) != value:
            raise WrongAnswer(text, echoed, self._rig.actuators[actuator].show(value))

    @cached_property
    def safe_values(self) -> Mapping[str, float]:
        """The safe values of the driven outputs, SI."""
        return {
            name: float(value)
            for name, value in self._rig.safe_state.items()
            if self._rig.actuators[name].by == "driven"
        }

    @cached_property
    def read_back(self) -> tuple[tuple[Query, tuple[str, ...]], ...]:
        """The queries whose answers contain the states of such outputs, with the names of these."""
        found = (
            (query, tuple(place for place in query.places if place in self.safe_values))
            for query in self._lines.queries
        )
        return tuple((query, names) for query, names in found if names)

    def is_read(self, actuator: str) -> bool:
        """Return whether a query reads the state of an output."""
        return any(actuator in names for _, names in self.read_back)

    def states(self, answer: LineReply, names: tuple[str, ...]) -> Mapping[str, float | None]:
        """Return the SI values of outputs in the answer to such a query; None for what is no value."""
        return {
            name: self._meaning.setting(name, answer.found[name], self.safe_values[name]) for name in names
        }

    def orders(self) -> tuple[SafeOrder, ...]:
        """Return the safe commands for the guard, which does not know the rig: bytes and expected answers."""
        found = [self._order(exchange) for exchange in self._lines.safe]
        for name, value in self.safe_values.items():
            text = self._meaning.command(name, value)
            said = (self._meaning.written(name, value), self._meaning.read_as(name, value))
            found.append(self._order(self._lines.actuators[name], text, {VALUE: said}))
        return tuple(found)

    def read_back_orders(self) -> tuple[SafeOrder, ...]:
        """Return the queries of `read_back` for the guard, with the answers of outputs that are safe."""
        return tuple(
            self._order(
                query,
                values={name: (self._meaning.read_as(name, self.safe_values[name]),) for name in names},
            )
            for query, names in self.read_back
        )

    def identify_order(self) -> SafeOrder | None:
        """Return the identity query, for the guard."""
        return None if self._lines.identify is None else self._order(self._lines.identify)

    def confirm_order(self) -> SafeOrder | None:
        """Return the query after each setting, for the guard."""
        return None if self._lines.confirm is None else self._order(self._lines.confirm)

    def _order(
        self, exchange: Exchange, text: str = "", values: Mapping[str, tuple[str, ...]] | None = None
    ) -> SafeOrder:
        command = (text or exchange.send).encode("utf-8") + self._lines.send_ends.encode("utf-8")
        return SafeOrder(command, tuple(exchange.reply), values or {})

    def safe_commands(self) -> Iterator[SafeCommand]:
        """Return the commands that make outputs safe: those of the file, then each actuator's safe value."""
        for exchange in self._lines.safe:
            yield SafeCommand(exchange, exchange.send, lambda _answer: None, tuple(self.safe_values))
        for name, value in self.safe_values.items():
            text = self._meaning.command(name, value)
            require = partial(self._require, name, value, text)
            yield SafeCommand(self._lines.actuators[name], text, require, (name,))
