"""The mapping that a rig file names for the logs of its bench, and how far it may decide on units.

A log format is written for one log and read for all later ones, so what a later heading states must agree
with it: a unit that silently beats the heading's is wrong by a factor that nobody sees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rigctl.dataset.importing.cells.headings import counts_turns, split_ending
from rigctl.dataset.importing.formats.table import Heading
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.project import find_project
from rigctl.units import find_unit, is_speed_of_rotation, parse_unit

if TYPE_CHECKING:
    from rigctl.rig import Rig


def with_log_format(options: Options, rig: Rig | None) -> Options:
    """Return the options with those of the rig's log format where they are not set.

    Its path is searched like any path in a rig file: beside it, then in the project of the rig file.

    Raises
    ------
    RigctlError
        the log format does not exist, or an entry is wrong.
    """
    from rigctl.dataset.importing.mapping import load_mapping

    if rig is None or rig.log_format is None:
        return options
    project = find_project(None if rig.path is None else rig.path.parent)
    try:
        path = project.resolve(rig.log_format, rig.path)
    except RigctlError as problem:
        raise problem.at(Location(rig.path)) from None
    return options.over(replace(load_mapping(path), log_format=rig.log_format))


def require_same_unit(heading: Heading, options: Options) -> None:
    """Refuse a column to which the log format gives a unit, if its heading states another one.

    The format holds for the heading that it was written for, ``speed [gizmo]: speed [rpm]``, and for one
    with the same unit or none, unless it was written for another.

    Raises
    ------
    RigctlError
        the heading states another unit, or not the one that the format was written for.
    """
    given = options.unit_of(heading.name)
    if options.log_format is None or heading.seconds or heading.name not in options.written_for:
        return
    written, known = heading.unit or "", options.written_for[heading.name]
    if given is None or written == known or _is_same(heading.name, written, given):
        return
    if not known and not _is_unit(written):
        return
    ours = options.ours(heading.name)
    raise RigctlError(
        f"{heading.name}: its heading states {f'[{written}]' if written else 'no unit'}, but "
        f"{options.log_format} was written for {f'[{known}]' if known else 'a heading without a unit'} "
        f"and reads it in {given}",
        value=f"{heading.name} [{written}]" if written else heading.name,
        expected=f"one unit: --columns '{heading.name}={ours} [UNIT]' says which it is in this file",
        where=heading.where,
    )


def log_format_remark(headings: Sequence[Heading], options: Options) -> Iterator[str]:
    """Return a remark on what was read by the log format, and not by the file itself."""
    if options.log_format is None:
        return
    said = [text for heading in headings if heading.name and (text := _said(heading, options))]
    if said:
        yield f"read as {options.log_format} says: {', '.join(dict.fromkeys(said))}"


def _said(heading: Heading, options: Options) -> str:
    name = heading.name
    if heading.seconds or heading.spent or name not in options.written_for:
        return ""
    given = options.unit_of(name)
    if options.ours(name) == "-":
        return f"{name} left out"
    if given is None or _is_same(name, heading.unit or split_ending(name)[1] or "", given):
        return ""
    if given == "1":
        return f"{name} as a plain number"
    return f"{name} {given} from row to row" if given[:1].isdigit() else f"{name} in {given}"


def _is_same(name: str, written: str, given: str) -> bool:
    """Return whether two units are the same, also as speeds of rotation."""
    if not (_is_unit(written) and _is_unit(given)):
        return False
    meant = "rpm" if counts_turns(name, written) else written
    one, other = parse_unit(meant), parse_unit(given)
    same = (one.dimension, one.factor, one.offset) == (other.dimension, other.factor, other.offset)
    return same and is_speed_of_rotation(meant) == is_speed_of_rotation(given)


def _is_unit(text: str) -> bool:
    return bool(text.strip()) and find_unit(text) is not None
