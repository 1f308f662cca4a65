"""Export and import of every shipped rig in every format: ``python -m benchmarks.round_trips [RIG ...]``.

Runs without and with a hidden effect are diagnosed, exported, imported and diagnosed again. In a file, switch
times are known only to within one sample, so that a weak effect may become ambiguous; nothing else may
change. It takes some ten minutes on one core, and stores its figures beside this file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.record import keep, table

FORMATS = ("csv", "xlsx", "parquet", "tdms", "mf4", "mat")


@dataclass(frozen=True)
class Campaign:
    """A procedure, the model, and the hidden effect of the bench."""

    procedure: str
    arguments: tuple[str, ...]
    model: str
    hidden: tuple[str, ...]


STROKES = Campaign(
    "procedures/campaign.yaml",
    ("temperatures=20 degC, 60 degC", "pressures=20 bar, 40 bar"),
    "models/hl32-textbook.yaml",
    ("laminar_throttle", "valve_leakage"),
)
STEPS = Campaign(
    "procedures/heater-board-steps.yaml",
    ("powers=20 %, 80 %, 50 %, 10 %", "second=30 %", "dwell=6 min"),
    "models/heater-board.yaml",
    ("heater_coupling", "radiation"),
)
RIGS = {
    "hl32-bench": STROKES,
    "hl32-bench-instrumented": STROKES,
    "hl32-bench-lines": STROKES,
    "hl32-bench-uno": STROKES,
    "heater-board": STEPS,
    "tclab-board": STEPS,
}


def rigctl(*arguments: str) -> dict[str, Any]:
    """The answer of a command; a failure ends the benchmark with its message."""
    command = [sys.executable, "-m", "rigctl", *arguments, "--json"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"rigctl {' '.join(arguments)}\n{done.stdout}{done.stderr}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def judged(run: str, model: str) -> dict[str, Any]:
    """The verdict of a run, the named effects and those that are indistinguishable from them."""
    found = rigctl("diagnose", run, "--model", model)
    named = {name for group in found["classes"] for name in group}
    return {key: found[key] for key in ("verdict", "effects")} | {"class": sorted(named)}


def likeness(own: dict[str, Any], one: dict[str, Any]) -> str:
    """Compare a verdict with that of the original run; weaker means ambiguous with the same effect."""
    if all(one[key] == own[key] for key in ("verdict", "effects")):
        return "same"
    weaker = one["verdict"] == "ambiguous" and set(own["effects"]) & {*one["effects"], *one["class"]}
    return "weaker" if weaker else "another"


def judgements(rig: str, hidden: str | None) -> Iterator[tuple[str, dict[str, Any]]]:
    """The verdicts of a run and of its import from each kind of file, in a separate project."""
    campaign = RIGS[rig]
    arguments = [word for argument in campaign.arguments for word in ("-a", argument)]
    hide = ("--with", hidden) if hidden else ()
    path = f"rigs/{rig}.yaml"
    made = rigctl("simulate", campaign.procedure, "--rig", path, "--seed", "3", *arguments, *hide)
    yield "the run itself", judged(made["path"], campaign.model)
    for ending in FORMATS:
        rigctl("export", made["path"], "-o", f"out.{ending}", "--overwrite")
        back = rigctl("import", f"out.{ending}", "--rig", path)
        yield ending, judged(back["path"], campaign.model)


def main() -> None:
    rigs = sys.argv[1:] or list(RIGS)
    results: dict[str, dict[str, Any]] = {}
    rows = [("rig", "hidden", "by way of", "verdict", "names", "beside the run's own")]
    with tempfile.TemporaryDirectory() as name:
        subprocess.run([sys.executable, "-m", "rigctl", "init", f"{name}/project"], check=True)
        os.chdir(f"{name}/project")
        for rig in rigs:
            for hidden in (None, *RIGS[rig].hidden):
                found = dict(judgements(rig, hidden))
                results[f"{rig}, {hidden or 'nothing'} hidden"] = found
                own = found["the run itself"]
                for way, one in found.items():
                    named = ", ".join(one["effects"])
                    rows.append((rig, hidden or "", way, one["verdict"], named, likeness(own, one)))
                    print(*rows[-1], sep=", ", flush=True)
    table("every rig through every format and back", rows)
    for word in ("weaker", "another"):
        count = sum(row[-1] == word for row in rows)
        print(f"{word}: {count} of {len(rows) - 1 - len(results)} verdicts after a way through a file")
    if not sys.argv[1:]:
        packages = ("numpy", "pyarrow", "openpyxl", "npTDMS", "asammdf", "scipy")
        print(keep(Path(__file__).resolve().parent, results, *packages))


if __name__ == "__main__":
    main()
