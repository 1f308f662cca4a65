"""Questions to the person at the terminal, on stderr, as stdout may be a document.

The questions of `typer` are read by `input`, which sees no Ctrl-C that arrives after its last look for
signals and before the system call that waits: it then waits for a line as if nothing had been typed. Here
the line is waited for together with a pipe that Python writes a byte into for each signal, so that none
can come too early.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from rigctl.cli.echo import echo
from rigctl.printable import printable

_ANSWERS = {"y": True, "yes": True, "n": False, "no": False, "": False}


def confirm(question: str) -> bool:
    """Whether the person says yes; an empty line is a no.

    Raises
    ------
    typer.Abort
        Ctrl-C, or the end of the input.
    """
    while (answer := ask(f"{question} [y/N]").lower()) not in _ANSWERS:
        echo("type y or n", err=True)
    return _ANSWERS[answer]


def ask(question: str) -> str:
    """The line that is typed, without the space around it.

    Raises
    ------
    typer.Abort
        Ctrl-C, or the end of the input.
    """
    try:
        typer.echo(f"{printable(question)}: ", nl=False, err=True)  # noqa: TID251 - the cursor stays behind it
        sys.stderr.flush()
        _wait_for_line()
        line = sys.stdin.readline()
    except KeyboardInterrupt:
        raise typer.Abort from None
    if not line:
        raise typer.Abort
    return line.strip()


def _wait_for_line() -> None:
    """Wait until a line can be read without waiting; `KeyboardInterrupt` as soon as Ctrl-C is typed.

    Windows' console is waited for by `readline`, which Ctrl-C interrupts there. Of anything but a terminal
    lines may have been read ahead, for which this would wait in vain.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    if os.name != "posix" or not in_main_thread or not sys.stdin.isatty():
        return
    import select

    typed: list[int] = []  # the handler raises nothing, so that the pipe is always closed again
    before = signal.signal(signal.SIGINT, lambda number, _: typed.append(number))
    try:
        with _bytes_of_signals() as arrived:
            while not typed and sys.stdin not in select.select([sys.stdin, arrived], [], [])[0]:
                os.read(arrived, 1)
    finally:
        signal.signal(signal.SIGINT, before)
    if typed:
        raise KeyboardInterrupt


@contextmanager
def _bytes_of_signals() -> Iterator[int]:
    """The end of a pipe from which a byte can be read for each signal since it was made."""
    read, write = os.pipe()
    try:
        os.set_blocking(write, False)  # as Python demands
        before = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        try:
            yield read
        finally:
            signal.set_wakeup_fd(before)
    finally:
        os.close(read)
        os.close(write)
