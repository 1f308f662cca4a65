"""The id of a run: its start and its procedure."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigctl.dataset.day_folders import is_taken
from rigctl.errors import RigctlError, nearest_name
from rigctl.files.reserved_names import is_reserved

#: name of the newest run on the command line
LATEST: Final = "latest"

#: longest slug; keeps paths well below the limit of 260 characters of some systems
_SLUG_LENGTH = 40


def slug(name: str) -> str:
    """Return a procedure's name for a folder's name: lower-case ASCII letters, digits and dashes.

    ``slug("Stroke campaign (40 °C)")`` is ``stroke-campaign-40-c``; a name without any such character is
    ``run``, and one that is a device on Windows begins with it: ``run-aux``.
    """
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii").lower()
    plain = re.sub(r"[^a-z0-9]+", "-", ascii_name)[:_SLUG_LENGTH].strip("-") or "run"
    return f"run-{plain}" if is_reserved(plain) else plain


class SeveralRuns(RigctlError):
    """The start of an id is ambiguous."""


def chosen_id(ref: str, ids: Sequence[str], *, shown: str = "") -> str:
    """Return the id that `ref` is or begins; the last of them for ``latest``.

    Parameters
    ----------
    ids: of runs, oldest first; not empty.
    shown: the searched place of an id, for messages.

    Raises
    ------
    RigctlError
        no id begins like this (names the nearest), or more than one does.
    """
    if ref == LATEST:
        return ids[-1]
    if ref in ids:
        return ref
    matches = [name for name in ids if ref and name.startswith(ref)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        listed = ", ".join(matches[:6]) + (", …" if len(matches) > 6 else "")
        raise SeveralRuns("several runs begin like this", value=ref, expected=f"one of {listed}")
    raise RigctlError(
        "no such run",
        value=shown or ref,
        expected=f"an id such as {ids[-1]}, the start of one, a path, or '{LATEST}'",
        nearest=_nearest_id(ref, ids),
    )


def _nearest_id(ref: str, ids: Sequence[str]) -> str | None:
    """The newest id that is nearest to `ref`: as a whole, by its start or procedure; or ``latest``."""
    meant = {one[: len(ref)]: one for one in ids} | {one.split("-", 2)[-1]: one for one in ids}
    meant |= {one: one for one in (*ids, LATEST)}
    near = nearest_name(ref, meant)
    return None if near is None else meant[near]


def new_run_id(name: str, when: datetime, runs: Path) -> str:
    """Return ``YYYYMMDD-HHMMSS-slug`` in UTC, with ``-2``, ``-3``, … appended if a run has that name.

    Two programs may still get the same name at the same moment, which `RunWriter.create` resolves.
    """
    wanted = f"{when.astimezone(UTC):%Y%m%d-%H%M%S}-{slug(name)}"
    return free_run_id(wanted, runs)


def free_run_id(wanted: str, runs: Path) -> str:
    """Return `wanted`, or the first of ``wanted-2``, ``wanted-3``, … that no run in `runs` has."""
    return _first_free(wanted, lambda name: is_taken(runs, name))


def next_free(wanted: str, folder: Path, suffix: str = "") -> str:
    """Return `wanted`, or the first of ``wanted-2``, … that with `suffix` is not an entry of `folder`."""
    return _first_free(wanted, lambda name: (folder / f"{name}{suffix}").exists())


def _first_free(wanted: str, taken: Callable[[str], bool]) -> str:
    candidate, number = wanted, 2
    while taken(candidate):
        candidate, number = f"{wanted}-{number}", number + 1
    return candidate
