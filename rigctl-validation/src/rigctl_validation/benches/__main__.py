"""Write the files of a user of a small bench: ``python -m rigctl_validation.benches motor --hide 0.0046``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rigctl_validation.benches.bench import NOISES, SAMPLES, BenchCampaign, write_bench
from rigctl_validation.benches.register import BENCHES
from rigctl_validation.benches.size import size_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the folder and print the size λ of the hidden effect; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m rigctl_validation.benches", description=__doc__)
    benches = "; ".join(f"{b.name} hides {b.hidden.what} [{b.hidden.unit}]" for b in BENCHES.values())
    parser.add_argument("bench", choices=list(BENCHES), help=benches)
    parser.add_argument("-o", "--output", type=Path, help="the folder; the bench's name by default")
    parser.add_argument("--hide", type=float, default=0.0, metavar="AMPLITUDE", help="of what it hides")
    parser.add_argument("--sampling", choices=list(SAMPLES), default="fast", help="samples per time constant")
    parser.add_argument("--noise", choices=list(NOISES), default="white")
    parser.add_argument("--unrecorded", action="store_true", help="without the optional input")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    campaign = BenchCampaign(
        BENCHES[options.bench],
        options.hide,
        options.sampling,
        not options.unrecorded,
        options.noise,
        options.seed,
    )
    log = write_bench(campaign, options.output or Path(options.bench))
    sys.stdout.write(f"{log}: lambda = {size_of(campaign):.3g}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
