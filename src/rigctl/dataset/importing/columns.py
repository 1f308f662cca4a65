"""Assigns a file's columns to the bench: time, record, channels and commands.

In: headings as written, the rig, and what the user has mapped. Out: for each column its meaning, unit and
range. Names are looked for in this order: what the user says (`--columns`); a name of the bench, in any
spelling; that name followed by a unit; a name with the same meaning on every bench. An unknown column of
numbers is refused with the most likely name, not guessed: a channel under a wrong name would be believed.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from rigctl.dataset.importing.cells.headings import (
    counts_turns,
    folded,
    identifier,
    split_ending,
    split_heading,
    time_unit,
)
from rigctl.dataset.importing.cells.time_column import is_other_time
from rigctl.dataset.importing.formats.table import Heading
from rigctl.dataset.importing.log_format import require_same_unit
from rigctl.dataset.importing.options import Options
from rigctl.errors import RigctlError, nearest_name, unknown_name
from rigctl.rig.common_names import on_rig
from rigctl.rig.layout import Layout
from rigctl.rig.setting import POSITIONS
from rigctl.units import Unit, describe, find_unit, is_speed_of_rotation, parse_quantity, parse_unit

if TYPE_CHECKING:
    from rigctl.rig import Rig
    from rigctl.rig.actuator import Actuator

Kind = Literal["time", "record", "clock", "channel", "command", "other"]

#: names with the same meaning on every bench, and a unit of their dimension; used if the rig has none
_COMMON: Final[Mapping[str, tuple[Kind, str]]] = {
    "valve": ("command", "1"),
    "heater": ("command", "1"),
    "pressure_setpoint": ("command", "Pa"),
    "oil_temperature": ("channel", "K"),
    "ambient_temperature": ("channel", "K"),
    "supply_pressure": ("channel", "Pa"),
    "pressure_a": ("channel", "Pa"),
    "pressure_b": ("channel", "Pa"),
    "position": ("channel", "m"),
}
#: of a converter or an encoder
_COUNT: Final = ("count", "counts")
#: unknown columns that are named
_LISTED: Final = 20
_UNKNOWN: Final = "unknown column"
#: name of the times of a channel with its own clock: ``time of temperature_2 [s]``
CLOCK: Final = "time of "
#: as our name: omit the column
LEAVE_OUT: Final = "-"


@dataclass(frozen=True)
class Assigned:
    """One column of the file and its meaning on the bench.

    Parameters
    ----------
    index: of the column in the file, from 0.
    unit: the unit in the file; None for a record number.
    shown: the unit in which it is stored.
    positions: the allowed values of a switch or a valve.
    difference: it is a temperature difference.
    possible: the range of a channel, or the limits of a level, SI, infinite where there is none; None if
        neither is stated.
    """

    name: str
    kind: Kind
    index: int
    heading: Heading
    unit: Unit | None = None
    shown: str = "1"
    positions: frozenset[float] | None = None
    difference: bool = False
    possible: tuple[float, float] | None = None


def read_mapping(texts: Iterable[str]) -> dict[str, str]:
    """Read ``theirs=ours`` pairs, several in one text separated by commas.

    Raises
    ------
    RigctlError
        there is no equals sign, or a column of the file is mapped twice.
    """
    mapping: dict[str, str] = {}
    for pair in (pair for text in texts for pair in _pairs(text)):
        theirs, equals, ours = (part.strip() for part in pair.partition("="))
        if not (theirs and equals and ours):
            raise RigctlError(
                "--columns: not a pair",
                value=pair,
                expected="theirs=ours, e.g. 'Druck=supply_pressure [bar]'",
            )
        name = split_heading(theirs)[0] or theirs  # 'Druck (bar)', as in the file
        if name in mapping:
            raise RigctlError("--columns: the column is named twice", value=theirs)
        mapping[name] = ours
    return mapping


def _pairs(text: str) -> Iterator[str]:
    """Split a text into pairs; a comma may be part of a column's name."""
    waiting: list[str] = []
    for piece in text.split(","):
        waiting.append(piece)
        if "=" in piece:
            yield ",".join(waiting)
            waiting = []
    if any(piece.strip() for piece in waiting):
        yield ",".join(waiting)


def assign(
    headings: Sequence[Heading],
    rig: Rig | None,
    options: Options,
    has_numbers: Callable[[int], bool] = lambda _: True,
) -> list[Assigned]:
    """Assign each column; one that is mapped to ``-`` is omitted, and so is one of samples that is not known
    and has no numbers, such as remarks.

    Without a rig, only the names common to all benches are known. A table with ``time`` has samples, and
    every name must be known. A table without it has observations, which may have any names.

    Parameters
    ----------
    has_numbers: whether there are numbers in the column with this index.

    Raises
    ------
    RigctlError
        a name is unknown or used twice, or a unit is missing or has the wrong dimension.
    """
    renamed = [_rename(heading, rig, options) for heading in headings]
    for theirs in options.columns:
        if theirs in options.may_lack or options.ours(theirs) in ("channel", "value"):
            continue  # a mapping for many files, or a file with one value per row
        if theirs not in {heading.name for heading in headings}:
            raise unknown_name("column", theirs, (heading.name for heading in headings if heading.name))
    samples = any(heading.name == "time" for heading in renamed)
    assigned: dict[str, Assigned] = {}
    unknown: list[UnknownColumn] = []
    for index, heading in enumerate(renamed):
        if heading.spent or heading.name in ("", LEAVE_OUT):
            continue
        try:
            given = options.unit_of(headings[index].name) is not None
            column = _assign(index, heading, rig, samples=samples, given=given)
        except UnknownColumn as error:
            if not samples or has_numbers(index):
                unknown.append(error)
            continue
        key = heading.name if column.kind == "clock" else column.name
        if key in assigned:
            raise RigctlError("the column is there twice", value=heading.name, where=heading.where)
        assigned[key] = column
    # All of them in one message, so that the user needs one more attempt and not one for each.
    if unknown:
        _suggest(unknown, rig, assigned)
        raise unknown[0] if len(unknown) == 1 else _several_unknown(unknown, rig, samples=samples)
    return list(assigned.values())


class UnknownColumn(RigctlError):
    """A column's name is unknown or insufficient."""

    unit: str | None = None  #: in the file


def _suggest(errors: Sequence[UnknownColumn], rig: Rig | None, assigned: Mapping[str, Assigned]) -> None:
    """Suggest the most likely name for each unknown column, or none if that would be a guess.

    A likely name is spelt similarly, or is the bench's only remaining name with the column's dimension.
    """
    free = [name for name in _names(rig) if name not in assigned]
    units = Counter(error.unit for error in errors if error.unit)
    for error in errors:
        name, unit = error.value or "", error.unit
        fitting = [known for known in free if unit is None or _fits(known, unit, rig)]
        near = "time" if time_unit(name, unit)[0] and "time" in free else None
        if near is None and rig is not None:  # without a rig, any name would be a guess
            near = nearest_name(name, fitting)
        if near is None and unit is not None and rig is not None:
            rivals = sum(count for other, count in units.items() if _alike(other, unit))
            near = fitting[0] if len(fitting) == rivals == 1 else None
        if near in free:
            free.remove(near)
        error.nearest = near
        if error.what != _UNKNOWN:  # a table of observations, whose columns may have any name
            continue
        error.expected = None if near or not free else f"one of {', '.join(sorted(free))}"
        means = (
            f"Map it, --columns '{name}={_with_unit(near, unit, rig)}'"
            if near
            else f"Say what it is, --columns '{name}=OURS'"
        )
        error.hint = f"{means}, or leave it out, --columns '{name}={LEAVE_OUT}'"


def _with_unit(name: str, unit: str | None, rig: Rig | None) -> str:
    """Return a name as it must be given to a column without a unit."""
    usual = {"time": "s"}.get(name)
    if rig is not None and name in (*rig.channels, *rig.actuators):
        usual = rig.channels[name].unit if name in rig.channels else rig.actuators[name].display_unit
    return name if unit or usual in (None, "1") else f"{name} [{usual}]"


def _fits(name: str, unit: str, rig: Rig | None) -> bool:
    """Return whether a column with this unit can have this name on the bench."""
    if rig is not None and name in rig.channels:
        return _alike(rig.channels[name].unit, unit)
    if rig is not None and name in rig.actuators:
        return _alike(rig.actuators[name].display_unit, unit)
    if name == "time":
        return _alike("s", unit)
    return name in _COMMON and _alike(_COMMON[name][1], unit)


def _alike(one: str, other: str) -> bool:
    first, second = find_unit(one), find_unit(other)
    if first is None or second is None:
        return False
    return not first.dimension.dimensionless and first.dimension == second.dimension


def _several_unknown(errors: Sequence[UnknownColumn], rig: Rig | None, *, samples: bool) -> RigctlError:
    """Make the error for several unknown columns: their names, and how to map them."""
    names = [f"{one.value} ({one.nearest}?)" if one.nearest else f"{one.value}" for one in errors[:_LISTED]]
    names += ["\N{HORIZONTAL ELLIPSIS}"] if len(errors) > _LISTED else []
    near = [_with_unit(one.nearest, one.unit, rig) if one.nearest else LEAVE_OUT for one in errors[:4]]
    if not samples and not any(name.startswith("time") for name in near):
        near[0] = "time [s]"
    pairs = [f"{one.value}={ours}" for one, ours in zip(errors, near, strict=False)]
    listed = ",".join(pairs) + (",…" if len(errors) > 4 else "")
    return RigctlError(
        f"{len(errors)} columns are unknown: {', '.join(names)}",
        expected=f"some of {', '.join(sorted(_names(rig)))}",
        hint=f"Say what each of them is: --columns '{listed}', where '{LEAVE_OUT}' leaves one out",
        where=errors[0].where,
    )


def _rename(heading: Heading, rig: Rig | None, options: Options) -> Heading:
    """Return the heading with our name, and with our unit if one is given."""
    if not heading.name:
        return heading
    given = None if heading.seconds else options.unit_of(heading.name)
    if heading.name in options.columns:
        require_same_unit(heading, options)
        return replace(heading, name=options.ours(heading.name), unit=given or heading.unit)
    name, unit = _known_name(heading, rig)
    only_labels = options.split == f"column:{heading.name}"  # a record number and nothing else
    if name not in _names(rig) and (only_labels or is_other_time(heading.name, heading.unit, options)):
        name = LEAVE_OUT
    return replace(heading, name=name, unit=unit)


def _known_name(heading: Heading, rig: Rig | None) -> tuple[str, str | None]:
    """Return the name on the bench of a column that the user has not mapped, and its unit.

    ``Motor Speed`` and ``motor_speed_rpm`` are `motor_speed`; a name of the bench is never taken apart.
    """
    known = _names(rig)
    plain, ending = split_ending(heading.name) if heading.unit is None else (heading.name, None)
    own = ending if heading.unit is None and plain == heading.name else heading.unit  # 'rpm' is both
    placed = split_ending(heading.name, is_current=True)[0] if heading.unit is None else plain
    # From the whole name to the name without its ending: `speed_rpm` of the bench is not taken apart.
    for name, unit in ((heading.name, own), (plain, ending), (placed, "A")):
        match = next((ours for ours in known if folded(ours) == folded(name)), None)
        # names that a formula cannot use are written differently in a rig file drafted from this log
        key = identifier(name)
        match = match or next(
            (ours for ours in (key, f"{key}_value", f"channel_{key}") if ours in known), None
        )
        if name not in (heading.name, plain) and not _alike(_unit_on(match or "", rig), "A"):
            continue  # 'battery_A' is a current if the bench's 'battery' is one
        if match is not None:
            turns = unit is not None and counts_turns(heading.name, unit)
            return match, "rpm" if turns and is_speed_of_rotation(_unit_on(match, rig)) else unit
    return (plain, ending) if ending is not None and rig is None else (heading.name, heading.unit)


def _unit_on(name: str, rig: Rig | None) -> str:
    """Return the unit of a channel or an actuator of the bench; 1 without one."""
    if rig is not None and name in rig.channels:
        return rig.channels[name].unit
    return rig.actuators[name].display_unit if rig is not None and name in rig.actuators else "1"


def places_of(assigned: Sequence[Assigned]) -> tuple[list[int], int | None]:
    """Return the indices of the columns with numbers, and of the one with the records."""
    record = next((column.index for column in assigned if column.kind == "record"), None)
    return [column.index for column in assigned if column.kind != "record"], record


def _assign(index: int, heading: Heading, rig: Rig | None, *, samples: bool, given: bool) -> Assigned:
    name = heading.name
    if name == "record":
        return Assigned(name, "record", index, heading)
    if name == "time" or name.startswith(CLOCK):
        return _clock(index, heading, rig, given=given)
    name = on_rig(name, rig) if rig is not None else name
    if rig is not None and name in rig.channels:
        channel = rig.channels[name]
        unit = _unit(heading, channel.unit)
        return Assigned(
            name,
            "channel",
            index,
            heading,
            unit,
            channel.unit,
            difference=channel.difference,
            possible=None if channel.range is None else channel.band,
        )
    if rig is not None and name in rig.actuators:
        actuator = rig.actuators[name]
        unit = _unit(heading, actuator.display_unit)
        words = POSITIONS.get(actuator.kind)
        positions = frozenset(words.values()) if words else None
        return Assigned(
            name,
            "command",
            index,
            heading,
            unit,
            actuator.display_unit,
            positions,
            possible=_limits(actuator),
        )
    if name in _COMMON:
        kind, dimension = _COMMON[name]
        unit = _unit(heading, dimension)
        positions = frozenset((-1.0, 0.0, 1.0)) if name == "valve" else None
        return Assigned(name, kind, index, heading, unit, unit.text or "1", positions)
    if samples:
        raise _unknown(heading)
    if heading.unit is None:
        raise UnknownColumn(
            f"{name}: no unit, in a table without a column 'time'",
            value=name,
            expected=f"'time', or the unit of something that was observed: '{name} [1]'",
            hint=f"Say what it is: --columns '{name}=time [s]', or '{name}={LEAVE_OUT}' to leave it out",
            where=heading.where,
        )
    return Assigned(name, "other", index, heading, parse_unit(heading.unit), heading.unit or "1")


def _limits(actuator: Actuator) -> tuple[float, float] | None:
    """Return the limits of a level, infinite where there is none; None without any."""
    low, high = actuator.low, actuator.high
    if low is None and high is None:
        return None
    return float("-inf") if low is None else low, float("inf") if high is None else high


def _clock(index: int, heading: Heading, rig: Rig | None, *, given: bool) -> Assigned:
    """Assign the times of all channels, or of one with its own clock, named after that channel.

    Only a caller can give the time from row to row: in the file's own heading, ``10 min`` is no unit.
    """
    if heading.unit is None:
        heading = replace(heading, unit="s")  # which is reported
    if heading.name == "time":
        unit = (interval(heading) if given else None) or _unit(heading, "s")
        return Assigned("time", "time", index, heading, unit, "s")
    name = heading.name.removeprefix(CLOCK).strip()
    if rig is not None:
        name = on_rig(name, rig)
        if name not in (*rig.channels, *rig.actuators, *_COMMON):
            raise unknown_name("channel with a clock of its own", name, [*rig.channels, *rig.actuators])
    return Assigned(name, "clock", index, heading, _unit(heading, "s"), "s")


def interval(heading: Heading) -> Unit | None:
    """Return the time from row to row as the unit of a column that counts them: ``time [50 ms]``."""
    text = heading.unit or ""
    if not re.match(r"[\d.]", text) or text.isdigit():
        return None
    try:
        amount = parse_quantity(text)
    except RigctlError as problem:
        raise problem.at(heading.where) from None
    if amount.unit.dimension != parse_unit("s").dimension or amount.value <= 0.0:
        raise RigctlError(
            "not a time from row to row", value=text, expected="a time, e.g. 50 ms", where=heading.where
        )
    return replace(parse_unit("s"), text=text, factor=amount.si)


def _unit(heading: Heading, expected: str) -> Unit:
    """Return the heading's unit, which must have the dimension of `expected`; plain numbers need none."""
    wanted = parse_unit(expected)
    if heading.unit is None and not wanted.dimension.dimensionless:
        raise _unit_missing(heading, expected)
    try:
        unit = parse_unit(_meant(heading.unit or "1", wanted))
    except RigctlError as problem:
        raise problem.at(heading.where) from None
    if unit.dimension != wanted.dimension:
        raise RigctlError(
            f"{heading.name}: wrong dimension",
            value=heading.unit,
            expected=describe(expected),
            where=heading.where,
        )
    _require_same_rotation(heading, unit, expected)
    _require_same_count(heading, unit, expected)
    return unit


def _require_same_count(heading: Heading, unit: Unit, expected: str) -> None:
    """Refuse a count for an angle or a share, and the reverse: equal in dimension, and no unit of it."""
    if (unit.text in _COUNT) == (expected in _COUNT) or unit.text == "1":
        return
    raise RigctlError(
        f"{heading.name}: a count is no {expected}"
        if unit.text in _COUNT
        else f"{heading.name}: the rig has counts, and this is no count",
        value=unit.text,
        expected=f"its unit, e.g. --columns '{heading.name}={heading.name} [{expected}]' for {expected}",
        where=heading.where,
    )


def _require_same_rotation(heading: Heading, unit: Unit, expected: str) -> None:
    """Refuse ``1/min`` for ``rpm``: a count per minute may be revolutions or radians, a factor of 2π."""
    turns, wanted = is_speed_of_rotation(unit.text), is_speed_of_rotation(expected)
    if turns == wanted:
        return
    name = heading.name
    if wanted:
        raise RigctlError(
            f"{name}: this counts something per time, and may be turns or radians",
            value=unit.text,
            expected=f"a speed of rotation: {expected}, rpm, rad/s or deg/s",
            hint=f"Say what it is, e.g. --columns '{name}={name} [rpm]'",
            where=heading.where,
        )
    raise RigctlError(
        f"{name}: a speed of rotation, where the rig has a count per time",
        value=unit.text,
        expected=expected,
        hint="Give it the unit rpm or rad/s in the rig file",
        where=heading.where,
    )


def _meant(written: str, wanted: Unit) -> str:
    """``C`` and ``F`` beside a temperature are degrees, not coulomb and farad."""
    if wanted.dimension == parse_unit("K").dimension and written in ("C", "F"):
        return f"deg{written}"
    return written


def _unit_missing(heading: Heading, unit: str) -> RigctlError:
    return RigctlError(
        f"{heading.name}: the unit is missing",
        value=heading.name,
        expected=f"'{heading.name} [{unit}]'",
        hint=f"Write it into the heading, or give it: --columns '{heading.name}={heading.name} [{unit}]'",
        where=heading.where,
    )


def _names(rig: Rig | None) -> list[str]:
    """Return the possible names of a column: those of a hydraulic bench only for a hydraulic bench."""
    if rig is None:
        return ["time", "record", *_COMMON]
    roles = rig.roles
    hydraulic = (
        roles.set_pressure is not None or "position" in rig.channels or "supply_pressure" in rig.channels
    )
    return list(
        dict.fromkeys(["time", "record", *rig.channels, *rig.actuators, *(_COMMON if hydraulic else ())])
    )


def _unknown(heading: Heading) -> UnknownColumn:
    error = UnknownColumn(_UNKNOWN, value=heading.name, where=heading.where)
    error.unit = heading.unit
    return error


def layout_of(assigned: Sequence[Assigned], rig: Rig) -> Layout:
    """Return the layout of the file's columns, those of the rig in the rig's order."""
    order = [*rig.channels, *rig.actuators]

    def of(kind: str) -> list[Assigned]:
        columns = [column for column in assigned if column.kind == kind]
        return sorted(columns, key=lambda c: order.index(c.name) if c.name in order else len(order))

    channels, commands = of("channel"), of("command")
    return Layout(
        channels=tuple(column.name for column in channels),
        commands=tuple(column.name for column in commands),
        units=("s", "1", *(column.shown for column in (*channels, *commands))),
        differences=frozenset(column.name for column in channels if column.difference),
    )
