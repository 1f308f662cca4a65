"""Where `rigctl` begins: the overview is shown before the libraries of the command line are imported."""

from __future__ import annotations

import atexit
import gc
import os
import sys


def main() -> None:
    """Show the overview, or carry out a command; see `rigctl.cli.main`."""
    if sys.argv[1:] in (["--help"], ["-h"]) and "_RIGCTL_COMPLETE" not in os.environ:
        from rigctl.cli.overview import overview

        sys.stdout.write(overview())
        return
    from rigctl.cli.late_modules import load_late
    from rigctl.cli.main import main as carry_out

    load_late()
    atexit.register(_skip_last_collection)
    carry_out()


def _skip_last_collection() -> None:
    """Spare a command the last search for cycles, 0.1 to 0.2 s."""
    if "duckdb" not in sys.modules:  # its bindings report all that is not collected as leaked, on stderr
        gc.freeze()
