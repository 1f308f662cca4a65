"""Command lines as text that a user can copy and type."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

#: characters without a special meaning in any shell
_PLAIN = re.compile(r"[\w./\\:@+=-]+")
#: characters with a special meaning inside double quotes
_ACTIVE = frozenset('"$`!')


@dataclass(frozen=True)
class DataOptions:
    """The options about the data of an analysis, which every following command must repeat.

    Attributes
    ----------
    only, hold_out: expressions that select records.
    assume: ``NAME=VALUE`` of inputs that were not recorded.
    family: the name or file of the user's own family, which the model may not name.
    """

    only: str | None = None
    hold_out: str | None = None
    assume: Sequence[str] = ()
    family: str | None = None


def analysis(verb: str, runs: Sequence[str], model: str, choice: DataOptions | None = None, *own: str) -> str:
    """A command for a model and runs, with the same options: ``rigctl diagnose latest --model …``.

    `own` are the words of options that other commands do not have: ``"--slot", "friction"``.
    """
    return command([verb, *runs, "--model", model, *own], choice)


def command(arguments: Sequence[str], choice: DataOptions | None = None) -> str:
    """A command with these arguments, and the options about the data."""
    chosen = choice or DataOptions()
    words = ["rigctl", *map(_quoted, arguments)]
    for option, value in (("--only", chosen.only), ("--hold-out", chosen.hold_out)):
        if value:
            words += [option, f'"{value}"' if not _ACTIVE & set(value) else shlex.quote(value)]
    for text in chosen.assume:
        words += ["--assume", _quoted(text)]
    if chosen.family:
        words += ["--family", _quoted(chosen.family)]
    return " ".join(words)


def _quoted(text: str) -> str:
    """An argument quoted for any shell, or for POSIX shells if it contains characters that shells expand."""
    if _PLAIN.fullmatch(text):
        return text
    return f'"{text}"' if not _ACTIVE & set(text) else shlex.quote(text)
