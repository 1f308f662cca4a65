"""Questions at a real pseudo-terminal: every answer, and Ctrl-C at the moment that the question appears."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Callable

import pytest

from systems import needs_posix

pytestmark = needs_posix("a pseudo-terminal")

CTRL_C, END_OF_INPUT = "\x03", "\x04"

#: Ctrl-C is a signal to the processes of the session whose own terminal it is typed at
_ASKING = """
import fcntl, sys, termios
import typer
from rigctl.cli.question import confirm
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
# otherwise Ctrl-C discards what has been printed and not been read yet, which may be the next question
settings = termios.tcgetattr(0)
settings[3] |= termios.NOFLSH
termios.tcsetattr(0, termios.TCSANOW, settings)
for _ in range(int(sys.argv[1])):
    try:
        print("answer", confirm("Ready?"), flush=True)
    except typer.Abort as abort:
        print("answer", type(abort.__context__).__name__, flush=True)
"""


def _asked(count: int, typed: Callable[[int], str]) -> list[str]:
    """The answers that a program receives if this is typed as soon as its n-th question appears."""
    end, other = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", _ASKING, str(count)],
        stdin=other,
        stdout=other,
        stderr=other,
        start_new_session=True,
    )
    os.close(other)
    text, asked = "", 0
    try:
        while True:
            assert select.select([end], [], [], 300.0)[0], (
                f"it waits on, after {asked} questions: {text[-99:]}"
            )
            try:
                text += os.read(end, 65536).decode()
            except OSError:  # how Linux reports that the other end is closed
                break
            while text.count("[y/N]: ") > asked:
                os.write(end, typed(asked).encode())
                asked += 1
    finally:
        process.kill()
        process.wait()
        os.close(end)
    return [line.partition("answer ")[2] for line in text.splitlines() if "answer " in line]


def test_every_answer() -> None:
    typed = ["y\n", "YES\n", "n\n", " no \n", "\n", "perhaps\n", "y\n", END_OF_INPUT, CTRL_C]
    answers = _asked(8, typed.__getitem__)
    assert answers == ["True", "True", "False", "False", "False", "True", "NoneType", "KeyboardInterrupt"]


def test_ctrl_c_is_never_lost() -> None:
    """Of 3000 such questions asked by typer itself, 6 went on waiting on a busy computer."""
    assert _asked(1000, lambda _: CTRL_C) == ["KeyboardInterrupt"] * 1000


@pytest.mark.parametrize("count", [1, 2])
def test_what_is_typed_ahead_is_an_answer(count: int) -> None:
    assert _asked(2, lambda asked: ["y\n" * count, "n\n"][asked]) == [
        "True",
        "False" if count == 1 else "True",
    ]
