"""Writes a calibration into a rig file, without changing the rest of its text, and keeps the old file.

In: a rig as it was read, a channel and a fitted polynomial. Out: the changed file, and a copy of the
previous one in `calibrations/` beside it. Only the text of the entries is replaced: users write comments,
order and columns with care, and a round trip through a YAML library would reformat all of it.

Three things are checked before anything is written: that only this calibration would change (an anchor
may share it), that the result is a valid rig file, and that the file is still the one that was read.
`rigctl doctor --align` writes clocks by the same function.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, datetime
from pathlib import Path
from typing import Any

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.edit import set_entries
from rigctl.files.regular import read_bytes
from rigctl.files.shipped import shipped
from rigctl.files.write import write_bytes
from rigctl.files.yaml import parse_document
from rigctl.rig.calibration_fit import CalibrationFit, interval
from rigctl.rig.channel import Channel
from rigctl.rig.load import parse_rig
from rigctl.rig.rig import Rig

#: folder beside the rig file for previous rig files, and for the points and figures of calibrations
FOLDER = "calibrations"
_BOM = b"\xef\xbb\xbf"
_DIGITS = 10  # significant digits of a coefficient


@dataclass(frozen=True)
class Written:
    """The files that were written."""

    rig: Path
    backup: Path


def calibration_entries(
    channel: Channel,
    fit: CalibrationFit,
    day: date,
    reference: str | None = None,
    valid_for: str | None = None,
) -> dict[str, str]:
    """Return the fields of a calibration, each as one line of YAML; optional fields that are not given remain
    unchanged in the file."""
    entries = {
        "coefficients": f"[{', '.join(_number(value) for value in fit.coefficients)}]",
        "date": day.isoformat(),
    }
    if reference:
        entries["reference"] = json.dumps(reference, ensure_ascii=False)
    entries["uncertainty"] = _difference(channel, fit.uncertainty)
    straight = len(fit.coefficients) == 2
    entries["kind"] = "line" if straight else "data_sheet"  # of a curve, the curvature is uncertain too
    if valid_for:
        entries["valid_for"] = valid_for
    return entries


def with_calibration(rig: Rig, channel: str, entries: Mapping[str, str]) -> str:
    """Return the rig file's text with a new calibration of one channel.

    Raises
    ------
    RigctlError
        the calibration cannot be changed without changing other parts of the file, or the result would not be
        a valid rig file.
    """
    try:
        text = set_entries(rig.text, ("channels", channel, "calibration"), entries)
    except RigctlError as error:
        raise error.at(Location(rig.path)) from None
    # The same text may be used elsewhere by a YAML anchor: then more than this calibration would change.
    if not _alone(rig.text, text, channel):
        raise RigctlError(
            f"the calibration of '{channel}' is shared with another part of the file",
            hint="Write it out in its place first",
            where=Location(rig.path),
        )
    # What is written must be readable: a rig file that is refused would stop the bench.
    parse_rig(text, rig.path)
    return text


def write_calibration(rig: Rig, text: str, now: datetime) -> Written:
    """Replace the rig file by `text`, and keep the previous one in a folder beside it.

    Raises
    ------
    RigctlError
        the file has changed since it was read, or cannot be written; it is then untouched.
    """
    path = rig.path
    if path is None:
        raise RigctlError("this rig has no file to write to")
    root = shipped().resolve()
    if root.name == "shipped" and path.resolve().is_relative_to(root):
        raise RigctlError(
            "this rig file comes with rigctl, and is not yours to change",
            where=Location(path),
            hint="'rigctl init' makes a project with a copy",
        )
    try:
        content = read_bytes(path)
    except OSError as problem:
        raise RigctlError(f"cannot read the file: {problem.strerror}", where=Location(path)) from problem
    # Compared with what was read: an edit made meanwhile, in an editor that is still open, is not
    # overwritten.
    if content.removeprefix(_BOM) != rig.text.encode("utf-8"):
        raise RigctlError(
            "the file was changed meanwhile; nothing was written",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        )
    backup = _free(path.parent / FOLDER / f"{path.stem}.{now:%Y%m%d-%H%M%S}{path.suffix}")
    # The copy first, and of the bytes, not of the text.
    write_bytes(backup, content)
    write_bytes(path, (_BOM if content.startswith(_BOM) else b"") + text.encode("utf-8"))
    return Written(path, backup)


def _free(path: Path) -> Path:
    """Return the path, or the first similar one at which there is no file yet."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_stem(f"{path.stem}-{number}")
    return candidate


def _alone(before: str, after: str, channel: str) -> bool:
    """Return whether two texts differ at most in the calibration of one channel."""
    try:
        documents: list[Any] = [parse_document(text).data for text in (before, after)]
    except RigctlError:  # the change has removed an anchor to which another part of the file refers
        return False
    for document in documents:
        document["channels"][channel].pop("calibration", None)
    return bool(documents[0] == documents[1])


def _number(value: float) -> str:
    """Return a number as text that YAML reads as a number, whatever its magnitude."""
    text = format(value, f".{_DIGITS}g")
    return text if any(mark in text for mark in ".en") else f"{text}.0"


def _difference(channel: Channel, value: float) -> str:
    """Return a difference of values of the channel as text, with its unit."""
    shown = format(interval(channel, value), ".3g")
    return f"{shown} {channel.interval_unit}" if channel.interval_unit not in ("", "1") else shown
