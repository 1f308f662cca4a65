"""``make torture``: the requested number of trials from a seed; prints the results as JSON."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from torture import (
    broken_files,
    corruptions,
    endings,
    foreign_files,
    guarded,
    logger_files,
    lying,
    several,
    switching_off,
)


def main() -> None:
    asked = argparse.ArgumentParser(prog="python -m torture", description=__doc__)
    asked.add_argument("--corruptions", type=int, default=5000)
    asked.add_argument("--files", type=int, default=100_000)
    asked.add_argument("--foreign", type=int, default=10_000)
    asked.add_argument("--loggers", type=int, default=10_000)
    asked.add_argument("--endings", type=int, default=2000)
    asked.add_argument("--intermittent", type=int, default=1000, help="endings beside a loose contact")
    asked.add_argument("--restarts", type=int, default=1000, help="endings beside a restart of the device")
    asked.add_argument("--lying", type=int, default=2000, help="endings behind each protocol")
    asked.add_argument("--guarded", type=int, default=80)
    asked.add_argument("--several", type=int, default=80, help="endings over three devices, one with a fault")
    asked.add_argument("--off", type=int, default=5, help="calls of 'rigctl off' of each kind")
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    # Under `nohup` the runs would rightly ignore the SIGHUP with which some of them are to be ended.
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    kinds = endings.available()
    with tempfile.TemporaryDirectory() as folder:
        runs, files = Path(folder) / "runs", Path(folder) / "files"
        files.mkdir()
        found = {
            "corruptions": asdict(corruptions.torture(runs, given.corruptions, given.seed)),
            "broken_files": asdict(broken_files.torture(files, given.files, given.seed)),
            "foreign_files": foreign_files.torture(Path(folder) / "foreign", given.foreign, given.seed),
            "logger_files": asdict(logger_files.torture(Path(folder) / "loggers", given.loggers, given.seed)),
            "endings": asdict(endings.torture(Path(folder) / "endings", given.endings, given.seed, kinds)),
            "intermittent": asdict(
                endings.torture(
                    Path(folder) / "intermittent", given.intermittent, given.seed, kinds, "intermittent"
                )
            ),
            "restarts": asdict(
                endings.torture(
                    Path(folder) / "restarts",
                    given.restarts,
                    given.seed,
                    [kind for kind in kinds if kind != "simulated"],
                    "restart",
                )
            ),
            "lying": asdict(
                lying.torture(Path(folder) / "lying", given.seed, lying.KINDS, iter(range(given.lying)))
            ),
            "restarts_behind_protocols": asdict(
                lying.torture(
                    Path(folder) / "restarting",
                    given.seed,
                    lying.KINDS,
                    iter(range(given.restarts // len(lying.KINDS))),
                    lying.RESTARTS,
                )
            ),
            "guarded": asdict(
                guarded.torture(
                    Path(folder) / "guarded", given.guarded if sys.platform == "linux" else 0, given.seed
                )
            ),
            "several": asdict(
                several.torture(
                    Path(folder) / "several", given.several if sys.platform == "linux" else 0, given.seed
                )
            ),
            "off": asdict(switching_off.torture(Path(folder) / "off", given.off)) if given.off else {},
        }
    print(json.dumps({"seed": given.seed, **found}, indent=1))  # noqa: T201
    failed = [part for part in (*found.values(), *found["foreign_files"].values()) if part.get("failures")]
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
