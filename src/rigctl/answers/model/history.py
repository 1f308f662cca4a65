"""The versions of a model in words: what made each, and how the error fell.

In: the versions of one model file. Out: an `Answer` for the present one, and tables of all. Errors of
versions are comparable only on the same runs with the same records held out; where these differ, the answer
says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rigctl.answers.blocks import Answer, Block, Column, Points, Table, counted, nonempty
from rigctl.answers.model.errors import error_bars
from rigctl.answers.numbers import number, symbol
from rigctl.model import Version, VersionError, version_errors
from rigctl.model.history.change import Change, ModelError
from rigctl.units import significant

#: versions that the answer names, the last ones
_NAMED = 6
#: share of the noise: a smaller excess over it is not stated
_SLIGHT = 0.05


def history_answer(versions: Sequence[Version], current: Version) -> Answer:
    """The version of the file and its origin, the earlier changes, and the change of the error."""
    remark = "" if current.kept or current.parent is None else ", not kept yet"
    errors = version_errors(versions)
    facts = [("note", current.done.note), ("done", _done(versions)), *_fall(errors)]
    if len({_basis(each) for each in errors}) > 1:
        facts.append(("beware", "not all errors were computed on the same runs and held-out records"))
    return Answer(
        "good",
        current.head.as_posix(),
        f"version {current.number} of {len(versions)}, {current.done}{remark}",
        nonempty(facts),
        more=(
            *counted(len(versions), "version with its date", "versions with their dates"),
            *(["all errors as bars"] if any(each.error.rmse for each in errors) else []),
        ),
    )


def _done(versions: Sequence[Version]) -> str:
    """What made each version, the first ones left out where there are many."""
    if len(versions) == 1:
        return ""
    shown = [f"{one.number} {one.done}" for one in versions[-_NAMED:]]
    count = len(versions) - len(shown)
    return ", ".join([*([f"{count} before"] if count else []), *shown])


def _basis(each: VersionError) -> tuple[object, ...]:
    """The data of an error; two errors are compared only on the same data."""
    return each.runs, each.hold_out, each.only, each.assume


def _fall(errors: Sequence[VersionError]) -> list[tuple[str, str]]:
    """The error of the last version that has one, beside the first on the same records."""
    if not errors:
        return []
    last = errors[-1]
    first = next((each for each in errors if _basis(each) == _basis(last)), last)
    if first is last:
        head = f"of version {last.version.number}"
        return [("error", f"{head}: {_errors(last.error)}{_misfit(last.error)}")]
    head = f"from version {first.version.number} to {last.version.number}"
    return [
        ("error", f"{head}, {error_change(first.error, last.error)}"),
        ("held out", held_out_change(first.error, last.error)),
    ]


def _beyond(error: ModelError, channel: str) -> str:
    """A channel's error without the noise; the whole error if the noise is not known."""
    rmse, noise = error.rmse[channel], error.noise.get(channel, 0.0)
    remainder = math.sqrt(max(rmse**2 - noise**2, 0.0))
    if noise and remainder < _SLIGHT * noise:
        return "none"
    return f"{number(remainder, 2)} {symbol(error.units.get(channel, ''))}".strip()


def _errors(error: ModelError) -> str:
    known = all(error.noise.get(channel) for channel in error.rmse)
    sizes = ", ".join(f"{channel} {_beyond(error, channel)}" for channel in error.rmse)
    return f"{sizes}{' beyond the noise' if known else ''}"


def error_change(before: ModelError, after: ModelError) -> str:
    """The common channels that changed, and the whole misfit, √(χ²/dof), in units of the noise.

    A change that is small relative to the noise of one reading is not visible in a root mean square, but may
    be significant over all readings: the whole misfit shows it.
    """
    both = {
        channel: (_beyond(before, channel), _beyond(after, channel))
        for channel in after.rmse
        if channel in before.rmse
    }
    changed = [f"{channel} {old} to {new}" for channel, (old, new) in both.items() if old != new]
    known = all(after.noise.get(channel) for channel in both)
    changes = f"{'beyond the noise: ' if known else ''}{', '.join(changed)}" if changed else ""
    slight = "no channel's error changes noticeably relative to the noise of one reading"
    if before.chi2_reduced is None or after.chi2_reduced is None:
        return changes or slight
    first, last = (math.sqrt(one) for one in (before.chi2_reduced, after.chi2_reduced))
    return f"{significant(first, 3)} to {significant(last, 3)} times the noise; {changes or slight}"


def held_out_change(before: ModelError, after: ModelError) -> str:
    """Change of the error on held-out records; "" if none were held out."""
    if not before.heldout_rmse or not after.heldout_rmse:
        return ""
    errors = (replace(one, rmse=one.heldout_rmse, chi2_reduced=None) for one in (before, after))
    return error_change(*errors)


def _misfit(error: ModelError) -> str:
    if error.chi2_reduced is None:
        return ""
    return f"; {significant(math.sqrt(error.chi2_reduced), 3)} times the noise in all"


def history_evidence(versions: Sequence[Version], current: Version) -> list[Block]:
    """A table of the versions, their notes, and the errors as bars."""
    columns = (
        Column("version", "version"),
        Column("parent", "from"),
        Column("when", "when (UTC)", words=True),
        Column("done", "what was done", words=True),
        Column("fitted", "fitted to", words=True),
        Column("held_out", "held out", words=True),
        Column("chi2", "χ²", significant),
    )
    rows = tuple(
        {
            "version": f"{one.number}{' (head)' if one.number == current.number else ''}",
            "parent": one.parent,
            "when": f"{one.time:%Y-%m-%d %H:%M}",
            "done": f"{one.done}{'' if one.kept or one.parent is None else ', not kept yet'}",
            "fitted": _fitted_to(one.done),
            "held_out": one.done.hold_out,
            "chi2": None if one.done.after is None else one.done.after.chi2_reduced,
        }
        for one in versions
    )
    notes = [f"{one.number}: {one.done.note}" for one in versions if one.done.note]
    steps = [(_label(each), each.error) for each in version_errors(versions)]
    return [
        Table(columns, rows),
        *([Points.of("", notes)] if notes else []),
        *error_bars(steps),
    ]


def _fitted_to(done: Change) -> str:
    """The runs, the selected records, and the assumed inputs."""
    runs = ", ".join(done.runs)
    only = f", only {done.only}" if done.only else ""
    return runs + only + "".join(f", {text} assumed" for text in done.assume)


def _label(error: VersionError) -> str:
    return f"{error.version.number} {error.version.done}"
