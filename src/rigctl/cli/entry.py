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
    atexit.register(gc.freeze)  # a last search for cycles takes 0.1 to 0.2 s of a command
    carry_out()
