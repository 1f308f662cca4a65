"""Checks across the fields of a line device's protocol: names exist, nothing is missing."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig.problem import Problem
from rigctl.rig.protocols.line_pattern import VALUE
from rigctl.rig.protocols.lines import Exchange, LineActuator, Lines
from rigctl.rig.protocols.positions import position_problems
from rigctl.rig.rig import Rig
from rigctl.rig.setting import POSITIONS

_AT = ("backend", "lines")


def line_problems(rig: Rig, lines: Lines) -> Iterator[Problem]:
    """Yield all inconsistencies between the protocol and the rest of the rig file."""
    yield from _queries(rig, lines)
    driven = [name for name, actuator in rig.actuators.items() if actuator.by == "driven"]
    for name in driven:
        if name not in lines.actuators:
            error = RigctlError(
                f"actuators: nothing says how '{name}' is set", expected="every driven actuator"
            )
            yield Problem((*_AT, "actuators") if lines.actuators else _AT, error)
    for name, part in lines.actuators.items():
        keys = (*_AT, "actuators", name)
        if name not in driven:
            yield Problem(keys, unknown_name("driven actuator", name, driven), of_key=True)
        else:
            yield from _actuator(rig, name, part, keys)
    yield from _fixed(lines)


def _queries(rig: Rig, lines: Lines) -> Iterator[Problem]:
    """Check that each channel is read exactly once, and that no unknown name is read."""
    known = {*rig.channels, *(name for name in lines.actuators if name in rig.actuators)}
    read: set[str] = set()
    for index, query in enumerate(lines.queries):
        keys = (*_AT, "queries", index, "reply")
        if not query.reply:
            error = RigctlError("a query without an answer", value=query.send, expected="'reply: …'")
            yield Problem((*_AT, "queries", index), error)
        for place in query.places:
            if place not in known:
                yield Problem(keys, unknown_name("channel or actuator in braces", place, known))
            elif place in read:
                yield Problem(keys, RigctlError("this is read twice", value=f"{{{place}}}"))
            read.add(place)
    misspelt = bool(read - known)  # it explains a channel that is not read
    for name in rig.channels:
        if name not in read and not misspelt:
            error = RigctlError(
                f"queries: no answer holds channel '{name}'", expected=f"{{{name}}} in a reply"
            )
            yield Problem((*_AT, "queries"), error)


def _actuator(rig: Rig, name: str, part: LineActuator, keys: tuple[str | int, ...]) -> Iterator[Problem]:
    """Check that an actuator's kind and the words for its values agree."""
    actuator = rig.actuators[name]
    if part.template.form is None:
        error = RigctlError("no place for the value", value=part.send, expected="{value} in 'send'")
        yield Problem((*keys, "send"), error)
    for place in part.places:
        if place != VALUE:
            yield Problem((*keys, "reply"), unknown_name("place in the answer", place, (VALUE, "_")))
    positions = POSITIONS.get(actuator.kind)
    if positions is None:
        for field in ("words", "answers"):
            if getattr(part, field) is not None:
                error = RigctlError("a level has no words", expected="'scale'")
                yield Problem((*keys, field), error, of_key=True)
        yield from _scale(rig, name, part, keys)
        return
    if part.scale is not None:
        error = RigctlError(f"a {actuator.kind} has no scale", expected="'words'")
        yield Problem((*keys, "scale"), error, of_key=True)
    yield from position_problems("words", positions, part.words or {}, (*keys, "words"))
    if part.answers is not None:
        yield from position_problems("answers", positions, part.answers, (*keys, "answers"))


def _scale(rig: Rig, name: str, part: LineActuator, keys: tuple[str | int, ...]) -> Iterator[Problem]:
    actuator = rig.actuators[name]
    if part.scale is None:
        return
    if actuator.low is None or actuator.high is None:
        error = RigctlError("scale: the actuator has no range", value=name, expected="its low and high")
        yield Problem((*keys, "scale"), error)
    elif part.scale[0] == part.scale[1]:
        yield Problem((*keys, "scale"), RigctlError("scale: both ends are the same"))


def _fixed(lines: Lines) -> Iterator[Problem]:
    """Check the exchanges whose command contains no value: all except settings."""
    named: list[tuple[tuple[str | int, ...], Exchange | None]] = [
        (("identify",), lines.identify),
        (("confirm",), lines.confirm),
        (("keep_alive",), lines.keep_alive),
    ]
    lists = (("begin", lines.begin), ("safe", lines.safe), ("queries", lines.queries))
    several = (((name, index), one) for name, all_of in lists for index, one in enumerate(all_of))
    for keys, exchange in chain(named, several):
        if exchange is None:
            continue
        if exchange.template.form is not None:
            error = RigctlError("there is no value to be sent here", value=exchange.send)
            yield Problem((*_AT, *keys, "send"), error)
        if keys[0] in ("confirm", "identify") and not exchange.reply:
            yield Problem(
                (*_AT, *keys), RigctlError(f"{keys[0]}: the answer is missing", expected="'reply: …'")
            )
        if keys[0] not in ("queries", "identify") and exchange.places:
            error = RigctlError("nothing is read here", value=exchange.places[0], expected="{_}")
            yield Problem((*_AT, *keys, "reply"), error)
