"""Make the data of a campaign on the separate bench: ``python -m rigctl_validation.bench unknown-bench``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rigctl.errors import RigctlError
from rigctl_validation.bench.campaign import write_csv
from rigctl_validation.bench.recipes import RECIPES, read_hidden, with_hidden

#: digits of the numbers in the file: far below the noise, and half as long as all of them
_DIGITS = 6


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m rigctl_validation.bench", description=__doc__)
    parser.add_argument("recipe", choices=[*RECIPES], help="unknown-bench hides a worn spool (spool_leak)")
    parser.add_argument("-o", "--output", type=Path, help="the CSV file to write; RECIPE.csv by default")
    parser.add_argument(
        "--hide", action="append", default=[], metavar="NAME=VALUE", help="something hidden, SI; repeatable"
    )
    parser.add_argument("--seed", type=int, help="of noise, scatter and repetitions")
    parser.add_argument("--chamber-pressures", action="store_true", help="with sensors in both chambers")
    options = parser.parse_args(arguments)
    try:
        campaign = with_hidden(RECIPES[options.recipe], read_hidden(options.hide))
    except RigctlError as problem:
        parser.error(str(problem))
    if options.seed is not None:
        campaign = replace(campaign, seed=options.seed)
    if options.chamber_pressures:
        campaign = replace(campaign, chamber_pressures=True)
    path = options.output or Path(f"{options.recipe}.csv")
    write_csv(campaign, path, digits=_DIGITS)
    sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
