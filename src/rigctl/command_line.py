"""Command lines as text that a user can copy and type."""

from __future__ import annotations

import os
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
    words = ["rigctl", *map(shell_word, arguments)]
    for option, value in (("--only", chosen.only), ("--hold-out", chosen.hold_out)):
        if value:
            words += [option, quoted(value)]
    for text in chosen.assume:
        words += ["--assume", shell_word(text)]
    if chosen.family:
        words += ["--family", shell_word(chosen.family)]
    return " ".join(words)


def shell_word(text: str, *, windows: bool = os.name == "nt") -> str:
    """An argument as it is typed, in quotes where a shell would change it.

    A backslash in a word is that of a path on Windows, where every shell and program reads a slash as well.
    """
    word = text.replace("\\", "/") if windows else text
    return word if _PLAIN.fullmatch(word) else quoted(word, windows=windows)


def quoted(text: str, *, windows: bool = os.name == "nt") -> str:
    """Text in quotes for any shell, or for this system's alone if it has characters that shells expand.

    PowerShell takes what is in single quotes as it is, and two of them for one.
    """
    if not _ACTIVE & set(text):
        return f'"{text}"'
    doubled = text.replace("'", "''")
    return f"'{doubled}'" if windows else shlex.quote(text)
