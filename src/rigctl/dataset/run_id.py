"""The name of a run: when it began and what it carried out."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigctl.dataset.shards import is_taken
from rigctl.errors import RigctlError, nearest_name

#: how the newest run is called on the command line
LATEST: Final = "latest"

#: longest slug; keeps a run's paths well below the 260 characters that some systems allow
_SLUG_LENGTH = 40


def slug(name: str) -> str:
    """A procedure's name as part of a folder's name: lower-case ASCII letters, digits and dashes.

    ``slug("Stroke campaign (40 °C)")`` is ``stroke-campaign-40-c``; a name without any of these is ``run``.
    """
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii").lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_name)[:_SLUG_LENGTH].strip("-") or "run"


class SeveralRuns(RigctlError):
    """Several ids begin like this."""


def chosen_id(ref: str, ids: Sequence[str], *, shown: str = "") -> str:
    """The id that `ref` is, or begins; the last of them for ``latest``.

    Parameters
    ----------
    ids: of some runs, oldest first; not empty.
    shown: where a run of this id was looked for, as errors name it.

    Raises
    ------
    RigctlError
        no id begins like this (names the nearest), or several do.
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
        nearest=nearest_name(ref, ids),
    )


def new_run_id(name: str, when: datetime, runs: Path) -> str:
    """``YYYYMMDD-HHMMSS-slug`` in UTC; ``-2``, ``-3``, … is appended while a run has that name.

    Two programs may still be given the same name in the same moment; `RunWriter.create` settles that.
    """
    wanted = f"{when.astimezone(UTC):%Y%m%d-%H%M%S}-{slug(name)}"
    return free_run_id(wanted, runs)


def free_run_id(wanted: str, runs: Path) -> str:
    """`wanted`, or the first of ``wanted-2``, ``wanted-3``, … that no run in `runs` has."""
    return _first_free(wanted, lambda name: is_taken(runs, name))


def next_free(wanted: str, folder: Path, suffix: str = "") -> str:
    """`wanted`, or the first of ``wanted-2``, ``wanted-3``, … that with `suffix` is no entry of `folder`."""
    return _first_free(wanted, lambda name: (folder / f"{name}{suffix}").exists())


def _first_free(wanted: str, taken: Callable[[str], bool]) -> str:
    candidate, number = wanted, 2
    while taken(candidate):
        candidate, number = f"{wanted}-{number}", number + 1
    return candidate
