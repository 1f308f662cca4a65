"""Where `rigctl` begins: the overview is shown before the libraries of the command line are imported."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys

from rigctl.child_process import isolate_children
from rigctl.cli.closed_output import UNREAD, by_closed_pipe, discard_output, is_unread, notice_closed_pipes

#: exit status after Ctrl-C, as `rigctl.errors.ExitCode` has it, which is imported later
INTERRUPTED = 130


def main() -> None:
    """Show the overview, or carry out a command; see `rigctl.cli.main`.

    Where the reader of the output has closed the pipe, as ``head`` does, the process ends without a message.
    """
    isolate_children()
    notice_closed_pipes()
    code: int | str | None = 0
    unread = False
    try:
        _show_or_carry_out()
    except SystemExit as end:
        code, unread = end.code, by_closed_pipe(end)
    except BrokenPipeError:
        if not is_unread():  # not of stdout or stderr
            raise
        unread = True
    except KeyboardInterrupt:  # a second Ctrl-C while the first was handled
        code = INTERRUPTED
    # one more ends the process at once, without a traceback from the interpreter's own end
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except BrokenPipeError:
        unread = True
    if unread:
        discard_output()
        sys.exit(code if code not in (0, 1, None) else UNREAD)
    sys.exit(code)


def _show_or_carry_out() -> None:
    if sys.argv[1:] in (["--help"], ["-h"]) and "_RIGCTL_COMPLETE" not in os.environ:
        from rigctl.cli.overview import overview

        print(overview(), end="")  # noqa: T201 - not with a process that has no stdout
        return
    from rigctl.cli.late_modules import load_late
    from rigctl.cli.main import main as carry_out

    load_late()
    if os.environ.get("_RIGCTL_COMPLETE") == "complete_bash":
        from rigctl.cli.complete import join_words

        join_words(os.environ)
    atexit.register(_skip_last_collection)
    carry_out()


def _skip_last_collection() -> None:
    """Skip the garbage collection at the end of the interpreter, 0.1 to 0.2 s."""
    if "duckdb" not in sys.modules:  # its bindings would report uncollected objects as leaks on stderr
        gc.freeze()
