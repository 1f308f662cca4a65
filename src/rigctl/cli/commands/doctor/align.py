"""`rigctl doctor --align`: the offsets of the devices' clocks, measured by an edge that they see.

In: a rig with several devices, whose file says which output moves and which channels see it. Out: an
entry under `clocks:` for each of these channels, shown and, if wanted, written into the rig file. The
measurement is `rigctl.runner.align`; here people are asked and told.

They are asked twice, since two different things are at stake: an output moves (`--yes`), and a file
changes (`--write`). The uncertainty is rounded up, and the offset has as many decimals: what analyses
take from the file must not claim more than was measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.cli.echo import echo, print_json
from rigctl.cli.question import confirm
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.rig import Rig
    from rigctl.rig.align import Align
    from rigctl.runner.edge_offset import Offset

#: shown digits of an uncertainty; the offset has as many decimals
_DIGITS = 2


@dataclass(frozen=True)
class _Entry:
    """What the rig file should say of one clock: its name, and its fields as lines of YAML."""

    clock: str
    known: bool
    fields: Mapping[str, str]

    def __str__(self) -> str:
        return f"{{{', '.join(f'{name}: {text}' for name, text in self.fields.items())}}}"


def align_devices(
    path: Path | None, port: Sequence[str] | None, *, yes: bool, write: bool, as_json: bool
) -> None:
    """Move the output with the user's agreement, show each device's offset, and write them if that is wanted.

    Raises
    ------
    RigctlError
        the user does not agree, nothing is stated, or a device does not show the edge.
    """
    from rigctl.cli.attended_run import report_end, typing_possible
    from rigctl.cli.commands.manual import access_of, open_rig, say_guards
    from rigctl.runner.align import align, stated_edge
    from rigctl.runner.launch import operated
    from rigctl.runner.operators.automatic_operator import AutomaticOperator
    from rigctl.runner.operators.console import Console

    rig = open_rig(path)
    stated = stated_edge(rig)
    access = access_of(rig, None, port, "1x")
    say_guards()
    _require_agreement(rig, stated, yes=yes)
    with Console("operator") as console:
        measured = align(rig, operated(access, AutomaticOperator(), console))
    if not measured.offsets:
        report_end(measured.result, as_json=as_json)
    entries = _entries(rig, measured.offsets)
    document = _as_document(rig, stated, measured.offsets, entries)
    if not as_json:
        _show(rig, stated, measured.offsets, entries)
    if write or (not as_json and typing_possible() and confirm("Write this to the rig file?")):
        document |= _write(rig, entries)
    if as_json:
        print_json(document)
    elif document["written"]:
        echo(f"written to {document['rig']}; before it: {document['backup']}")


def _require_agreement(rig: Rig, stated: Align, *, yes: bool) -> None:
    """Outputs move only if somebody has said so, here or by `--yes`."""
    from rigctl.cli.attended_run import typing_possible

    if yes:
        return
    what = (
        f"{stated.actuator} is set to {stated.to.text} and back to {rig.safe_state[stated.actuator].text}, "
        f"{stated.repeats} times in {2.0 * stated.hold * stated.repeats:.0f} s"
    )
    if not typing_possible():
        raise RigctlError(f"this moves an output: {what}", expected="--yes, or a terminal that can be asked")
    if not confirm(f"{what}. Is the bench ready for it?"):
        raise RigctlError("nothing was moved")


def _entries(rig: Rig, offsets: Mapping[str, Offset]) -> list[_Entry]:
    """What the rig file should say, in the order of the channels."""
    dated = {channel: name for name, clock in rig.clocks.items() for channel in clock.channels}
    entries: list[_Entry] = []
    for channel, offset in offsets.items():
        size = _rounded(offset)
        if channel in dated:
            entries.append(_Entry(dated[channel], known=True, fields=size))
            continue
        device = rig.device_of(channel)
        own = [one for one in rig.parts[device].channels if one not in dated]
        name = device if device not in rig.clocks else f"{device}_clock"
        entries.append(_Entry(name, known=False, fields={"channels": f"[{', '.join(own)}]", **size}))
    names = [one.clock for one in entries]
    for name in names:
        if names.count(name) > 1:
            raise RigctlError(
                f"the clock '{name}' dates channels of several devices",
                expected="one clock for each device",
                where=Location(rig.path),
            )
    return entries


def _rounded(offset: Offset) -> dict[str, str]:
    """Offset and uncertainty as the rig file has them, the latter rounded up."""
    size = 1e3 * offset.uncertainty
    decimals = max(0, _DIGITS - 1 - math.floor(math.log10(size)))
    above = math.ceil(size * 10.0**decimals) / 10.0**decimals
    behind = round(1e3 * offset.behind, decimals) + 0.0  # without it, -0.0 would be written
    return {"offset": f"{behind:.{decimals}f} ms", "uncertainty": f"{above:.{decimals}f} ms"}


def _show(rig: Rig, stated: Align, offsets: Mapping[str, Offset], entries: Sequence[_Entry]) -> None:
    for (channel, offset), entry in zip(offsets.items(), entries, strict=True):
        size = entry.fields["offset"].removeprefix("-")
        direction = "ahead of" if offset.behind < 0.0 else "behind"
        echo(
            f"{rig.device_of(channel)}: {size} {direction} the commands, ±{entry.fields['uncertainty']} "
            f"(95 %, {offset.edges} edges of {stated.actuator} on {channel})"
        )
    for device in _unmeasured(rig, stated):
        echo(f"{device}: not measured, none of its channels is in 'align'")
    echo("in the rig file:\nclocks:")
    for entry in entries:
        echo(f"  {entry.clock}: {entry}")


def _unmeasured(rig: Rig, stated: Align) -> list[str]:
    """The devices that have channels, none of which sees the edge."""
    seen = {rig.device_of(channel) for channel in stated.channels}
    return [name for name, part in rig.parts.items() if name not in seen and part.channels]


def _as_document(
    rig: Rig, stated: Align, offsets: Mapping[str, Offset], entries: Sequence[_Entry]
) -> dict[str, Any]:
    """The result for programs; field names are part of the interface."""
    return {
        "rig": rig.path.as_posix() if rig.path is not None else None,
        "actuator": stated.actuator,
        "aligned": [
            {
                "device": rig.device_of(channel),
                "channel": channel,
                "clock": entry.clock,
                "behind": offset.behind,
                "uncertainty": offset.uncertainty,
                "unit": "s",
                "edges": offset.edges,
                "entry": str(entry),
            }
            for (channel, offset), entry in zip(offsets.items(), entries, strict=True)
        ],
        "not_aligned": _unmeasured(rig, stated),
        "written": False,
    }


def _write(rig: Rig, entries: Sequence[_Entry]) -> dict[str, Any]:
    """Write the clocks into the rig file, and keep the previous file."""
    from rigctl.files.edit import set_entries
    from rigctl.rig.calibration_file import write_calibration
    from rigctl.rig.load import parse_rig

    text = rig.text
    try:
        for entry in entries:
            if entry.known:
                text = set_entries(text, ("clocks", entry.clock), entry.fields)
            else:
                text = set_entries(text, ("clocks",), {entry.clock: str(entry)})
    except RigctlError as error:
        raise error.at(Location(rig.path)) from None
    parse_rig(text, rig.path)
    written = write_calibration(rig, text, datetime.now(UTC))
    return {"written": True, "rig": written.rig.as_posix(), "backup": written.backup.as_posix()}
