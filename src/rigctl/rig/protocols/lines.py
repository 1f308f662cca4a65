"""A line-based device: its commands, the meaning of its answers, and the commands that make it safe.

In: the section `lines` of a rig file. Out: `Lines`, with templates and patterns parsed, which
`rigctl.backends.lines` operates. Modbus, OPC UA and Python drivers are operated in the same form: their
sections become the lines of a client (`client_lines`), so that polling, reconnection, guard and safe
ending exist once.

How an output is known to be safe follows from what is written here. A query that has its name in the
answer reads its state back; `confirm` and `reply` only acknowledge a command; without either, a run that
has set the output to another value than its safe one ends as failed, with outputs not confirmed safe.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field, FiniteFloat, model_validator

from rigctl.errors import RigctlError
from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.files.refusal import refusal
from rigctl.rig.base import RigFilePart
from rigctl.rig.protocols.line_pattern import (
    ReplyLines,
    ReplyPattern,
    ReplyText,
    SendTemplate,
    SendText,
    reply_pattern,
    send_template,
)

_Seconds = Annotated[float, Q("s", positive=True)]

Watchdog = Annotated[
    float,
    Q("s", low="0.5 s", high="60 s"),
    Field(description="if rigctl hangs for this long, or is killed, its guard makes the outputs safe"),
]
#: default watchdog time-out, s; for a slow server the rig file states a longer one
WATCHDOG: Final = 2.0


_EXCHANGE: Final = '{send: "H 0", reply: OK}'


def _known_exchanges(written: Any) -> Any:
    """Say what a list of commands looks like, where it is something else."""
    if isinstance(written, list | tuple):
        return written
    raise refusal(
        RigctlError(
            "this is not a list of commands",
            value=None if written is None else str(written),
            expected=f"a list such as [{_EXCHANGE}]",
        )
    )


class Exchange(RigFilePart):
    """A command and the lines of the device's answer."""

    @model_validator(mode="before")
    @classmethod
    def _known_form(cls, written: Any) -> Any:
        if isinstance(written, dict | Exchange):
            return written
        raise refusal(
            RigctlError(
                "this is not a command with its answer",
                value=None if written is None else str(written),
                expected=f"for example {_EXCHANGE}",
            )
        )

    send: SendText = Field(description="the command, without its line end")
    reply: ReplyLines = Field(
        default=(),
        description="the answer: one pattern, or a list with one for each line; none if left out",
    )

    @cached_property
    def patterns(self) -> tuple[ReplyPattern, ...]:
        """The parsed patterns of the answer's lines."""
        return tuple(reply_pattern(text) for text in self.reply)

    @cached_property
    def template(self) -> SendTemplate:
        """The parsed command."""
        return send_template(self.send)

    @property
    def places(self) -> tuple[str, ...]:
        """The names in the answer's patterns."""
        return tuple(place for pattern in self.patterns for place in pattern.places if place != "_")


class Query(Exchange):
    """A query whose answer contains channels, or the state of actuators, by their names in braces."""

    every: _Seconds | None = Field(
        default=None,
        description="shortest interval between queries, with the last answer used in between; by "
        "default for each sample",
    )


class KeepAlive(Exchange):
    """A command that a device needs when nothing else is sent."""

    every: _Seconds = Field(default=0.5, description="longest time without a command")


class LineActuator(Exchange):
    """The command for an actuator: ``{value}`` in `send` is replaced by the number or the word."""

    words: dict[str, str] | None = Field(
        default=None,
        description="for a switch or a directional valve: the words for its positions: {off: '0', on: '1'}",
    )
    answers: dict[str, str] | None = Field(
        default=None,
        description="the words for its positions in the answers to queries, if they are others than those "
        "of the command: {off: '0', on: '1'}",
    )
    scale: tuple[FiniteFloat, FiniteFloat] | None = Field(
        default=None,
        description="for a level: the numbers for its low and high; by default the value in its unit",
    )


_Exchanges = Annotated[tuple[Exchange, ...], BeforeValidator(_known_exchanges)]


class Lines(RigFilePart):
    """The protocol of a line-based device."""

    send_ends: str = Field(default="\n", min_length=1, max_length=4, description="terminator of a command")
    reply_ends: str = Field(
        default="\n", min_length=1, max_length=4, description="terminator of a line of an answer"
    )
    frame: str = Field(
        default="8N1", pattern="^[78][NEO][12]$", description="data bits, parity and stop bits of the line"
    )
    timeout: _Seconds = Field(default=0.5, description="how long an answer may take")
    tries: int = Field(default=2, ge=1, le=5, description="number of attempts before a query counts as lost")
    wake: _Seconds = Field(
        default=3.0,
        description="how long it may be silent after its port was opened; an Arduino restarts then",
    )
    fastest: Annotated[float, Q("Hz", positive=True)] | None = Field(
        default=None, description="the highest possible sampling rate"
    )
    identify: Exchange | None = Field(
        default=None,
        description="sent first; a different answer means a different device. Names in braces are "
        "stored with each run",
    )
    begin: _Exchanges = Field(default=(), description="sent once after that, e.g. for configuration")
    queries: tuple[Query, ...] = Field(min_length=1, description="the queries for a sample, in this order")
    actuators: dict[Name, LineActuator] = Field(
        default_factory=dict, description="the command for each driven actuator"
    )
    confirm: Exchange | None = Field(
        default=None,
        description="sent after each setting; any other answer is a refusal, e.g. SYST:ERR? and 0,{_}",
    )
    errors: tuple[ReplyText, ...] = Field(
        default=(), description="answers that refuse a command or a query, e.g. 'ERR {_}'"
    )
    keep_alive: KeepAlive | None = Field(default=None, description="sent when nothing else is sent")
    safe: _Exchanges = Field(
        default=(),
        description="sent first when outputs are made safe, each a `send` with its `reply`; each actuator's "
        "safe_state always follows",
    )
    watchdog: Watchdog = WATCHDOG

    @cached_property
    def error_patterns(self) -> tuple[ReplyPattern, ...]:
        """The parsed patterns of `errors`."""
        return tuple(reply_pattern(text) for text in self.errors)

    @cached_property
    def of_a_client(self) -> Lines:
        """Return these lines for a `Client`, which handles message terminators itself."""
        return self.model_copy(update={"send_ends": "\n", "reply_ends": "\n"})
