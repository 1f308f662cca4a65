"""Simulating, differentiating and fitting 28 records, compared with the usual alternatives.

    python -m benchmarks.engine [--runs 20] [--slow] [--venvs DIR] [--install] [--only NAME]

SciPy and CasADi take part where they are installed here. diffrax lives in a virtual environment of its own
under DIR; `--install` makes it. `--slow` also times 28 columns of those that take a minute for them; `--only`
measures one peer or part again and keeps the rest.
Every peer is measured in a separate process. The shortest of several runs counts, as it is the one least
affected by other load of the machine. The CPU time of all threads is given beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.engine import building, fit, oracle, scaling, stepping, superset
from benchmarks.engine.common import EIGHT, OURS, PEERS, Floats
from benchmarks.engine.tables import tables
from benchmarks.record import keep, table

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PARTS = {
    "solvers": oracle,
    "fit": fit,
    "stepper": stepping,
    "superset": superset,
    "scaling": scaling,
    "building": building,
}
SEPARATE = {"diffrax": ("diffrax", "jax", "numpy")}


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=20)
    arguments.add_argument("--slow", action="store_true")
    arguments.add_argument("--venvs", type=Path)
    arguments.add_argument("--install", action="store_true")
    arguments.add_argument("--only", action="append", choices=(*PEERS, *PARTS))
    options = arguments.parse_args()
    kept = json.loads((HERE / "results.json").read_text(encoding="utf-8")) if options.only else {}
    wanted = options.only or (*PEERS, *PARTS)
    results: dict[str, Any] = kept.get("results", {"campaign": {}})
    known: dict[str, str] = kept.get("versions", {})
    peers = [name for name in PEERS if name in wanted]
    reference = oracle.ourselves() if peers else None
    for name in peers:
        python = interpreter(name, options.venvs, install=options.install)
        if python is None:
            print(f"{name} is not installed: left out")
            continue
        print(f"measuring {name}", flush=True)
        found, outputs, columns = measured(python, name, options.runs, slow=options.slow or name == OURS)
        known |= found.pop("versions")
        results["campaign"][name] = found | errors(outputs, columns, reference)
    for name, part in PARTS.items():
        if name in wanted:
            print(f"measuring {name}", flush=True)
            results[name] = part.results()
    for title, rows in tables(results):
        table(title, rows)
    print(f"\nkept in {keep(HERE, results, elsewhere=known)}")


def interpreter(name: str, venvs: Path | None, *, install: bool) -> Path | None:
    """The Python that has the peer, or None."""
    if name not in SEPARATE:
        python = Path(sys.executable)
        return python if imports(python, PEERS[name].package) else None
    if venvs is None:
        return None
    folder = venvs / name
    if install and not folder.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        python = executable(folder)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *SEPARATE[name]], check=True)
    return executable(folder) if folder.exists() else None


def executable(folder: Path) -> Path:
    """The Python of a virtual environment."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def imports(python: Path, package: str) -> bool:
    """Whether a package is installed there."""
    code = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({package!r}) is None)"
    return subprocess.run([python, "-c", code], check=False).returncode == 0


def measured(python: Path, name: str, runs: int, *, slow: bool) -> tuple[dict[str, Any], Floats, Floats]:
    """A peer's times and memory, its outputs and its first 8 columns."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "computed.npz"
        command = [python, "-m", "benchmarks.engine.measure", name, str(runs), str(int(slow)), file]
        path = os.pathsep.join((str(ROOT / "src"), str(ROOT)))
        environment = {**os.environ, "PYTHONPATH": path, "JAX_PLATFORMS": "cpu"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{name} failed:\n{done.stderr}")
        with np.load(file) as computed:
            return json.loads(done.stdout.splitlines()[-1]), computed["outputs"], computed["columns"]


def errors(outputs: Floats, columns: Floats, reference: tuple[Floats, Floats]) -> dict[str, float]:
    """The largest error of an output, as a share of its peak, and of a column, as a share of its length."""
    exact, slopes = reference
    peak = np.abs(exact).max(axis=(0, 1))
    # each column over all outputs, these in units of their noise
    wrong, whole = (
        np.sqrt(np.square(x / fit.SIGMA[:, None]).sum(axis=(0, 1, 2)))
        for x in (columns - slopes[..., : len(EIGHT)], slopes[..., : len(EIGHT)])
    )
    return {
        "output_error": float((np.abs(outputs - exact).max(axis=(0, 1)) / peak).max()),
        "column_error": float((wrong / whole).max()),
    }


if __name__ == "__main__":
    main()
