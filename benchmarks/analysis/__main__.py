"""Compare and diagnose, and their scaling: ``python -m benchmarks.analysis [--steps] [--slow]``.

Whole commands, with only compiled code cached, and again with cached fits: on the standard campaign of 28
strokes, with a leaking valve that the textbook model lacks, and on the eight published strokes. Every time is
the shortest of several, given with its CPU time, which other work on the machine affects less, and with the
requirement for two idle cores. ``--steps`` times their parts in one process. ``--slow`` compares up to a
thousand records, and imports and compares ten million rows, each in a separate process, which takes half an
hour.
``--long`` compares and diagnoses one record of 48 640 rows instead, whose input is commanded at every sample
(measured where RIGCTL_REAL_DATA names a folder with the Silverbox data, else simulated), ``--strokes``
diagnoses 32 strokes with both chamber pressures: whole commands, the median of three. ``--sensors`` diagnoses
the 28 strokes with exact sensors and with errors of sensors as unknowns.
``--own`` diagnoses a user's own bench instead, as a whole command, compiled for the first time and again;
``--apply`` adds three hidden effects to the model of 28 strokes, and ``--discover`` looks for a formula of
what is in no library, each once, as a whole command.

Python's bytecode is cached for these commands, as for an installed package: otherwise every command would
compile the sources of the whole package again.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.analysis.data import (
    CHAMBERS_RIG,
    MODEL,
    RIG,
    ROOT,
    THREE,
    run_of,
    run_of_chambers,
    run_of_three,
    runs_of_sensors,
    write_fast,
    write_own_bench,
    write_tight,
)
from benchmarks.analysis.long_record import write_long
from benchmarks.analysis.process import in_a_command, in_a_process
from benchmarks.engine.timing import best
from benchmarks.record import keep, table

HERE = Path(__file__).parent
#: required wall time of whole commands on two idle cores, s
ASKED_OF_COMMANDS = {"rigctl compare": 4.0, "rigctl diagnose": 8.0}
TIMES = 2
#: required wall time on two cores, warm, s
ASKED = {"fit": 4.0, "compare beside it": 3.0, "diagnose, singles": 8.0, "diagnose, pairs": 20.0}
#: required wall time for a user's bench, as a whole command, s
OWN = {"compiled for the first time": 20.0, "afterwards": 5.0}
#: required wall time on two cores of a long record and of strokes with chamber pressures, whole commands, s
OF_LONG = {"compare": 5.0, "diagnose": 20.0}
OF_STROKES = {"diagnose": 15.0}
MEDIAN_OF = 3
#: required CPU time of a diagnosis with errors of sensors, in times that with exact ones
OF_SENSORS = 1.3
#: names of the results of each option
OF_LONGER = {
    "--own": "own bench",
    "--apply": "apply",
    "--discover": "discover",
    "--long": "long record",
    "--strokes": "strokes",
    "--sensors": "sensors",
}
#: names of the results of the longer commands
APPLY, DISCOVER = 30.0, 60.0
RECORDS = (28, 100, 300, 1000)
#: times the standard campaign's 28 records of ten thousand samples
REPEATS = 36
ASKED_MEGABYTES = 1000.0


def main() -> None:
    os.environ["RIGCTL_RESULTS"] = "off"  # the work must be done, not found in the cache
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    kept: dict[str, Any] = {}
    path = HERE / "results.json"
    if path.exists():
        kept = json.loads(path.read_text("utf-8"))["results"]
        kept.pop("note", None)  # depends on the load of the machine
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
        longer = {
            "--own": own_bench,
            "--apply": apply,
            "--discover": discover,
            "--long": long_record,
            "--strokes": strokes,
            "--sensors": sensors,
        }
        asked = [option for option in longer if option in sys.argv[1:]]
        for option in asked:
            kept[OF_LONGER[option]] = longer[option](folder / option[2:])
        if not asked:
            kept["commands"] = commands(folder)
        if "--steps" in sys.argv[1:]:
            kept["standard"] = standard(folder)
        if "--slow" in sys.argv[1:]:
            kept["records"] = growing(folder)
            kept["rows"] = many_rows(folder)
    print(f"\nkept in {keep(HERE, kept, 'numpy', 'scipy', 'numba', 'pyarrow')}")


def commands(folder: Path) -> dict[str, dict[str, float]]:
    """Whole commands, their start included."""
    rigctl = str(Path(sys.executable).parent / "rigctl")
    strokes = [rigctl, "import", str(ROOT / "data" / "hl32-strokes.csv"), "--rig", str(RIG), "--json"]
    (folder / "table").mkdir()
    table_of = json.loads(
        subprocess.run(strokes, cwd=folder / "table", check=True, capture_output=True).stdout
    )
    runs = {
        "": str(run_of(28, folder / "commands").folder),
        ", the eight published strokes": table_of["path"],
    }
    found = {}
    rows = [("", "seconds", "of processor", "asked", "ratio")]
    for data, run in runs.items():
        for name in ("compare", "diagnose"):
            command = [rigctl, name, run, "--model", str(MODEL), "--json"]
            for kept, results in (("", "off"), (", asked again", str(folder / "results"))):
                shown = f"rigctl {name}{data}{kept}"
                took = in_a_command(command, {"RIGCTL_RESULTS": results}, TIMES)
                found[shown] = took
                asked = ASKED_OF_COMMANDS.get(shown)
                beside = ("", "") if asked is None else (f"{asked:g}", f"{took['wall'] / asked:.2f}")
                rows.append((shown, f"{took['wall']:.1f}", f"{took['cpu']:.1f}", *beside))
                print("  ".join(rows[-1]), flush=True)
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg()) if hasattr(os, "getloadavg") else "not known"
    table(f"whole commands, warm; load of the machine in the last 1, 5 and 15 minutes: {load}", rows)
    return found


def standard(folder: Path) -> dict[str, dict[str, float]]:
    """The standard campaign, step by step."""
    from rigctl.analysis.comparison import judge
    from rigctl.analysis.diagnosis import diagnose_comparison
    from rigctl.analysis.fitting import fit_to_data, read_runs
    from rigctl.model import load_model

    run, model = run_of(28, folder), load_model(MODEL)
    data = read_runs(model, [run])
    fitted = fit_to_data(model, data)
    judged = judge(fitted, model.name)
    works: dict[str, Callable[[], object]] = {
        "read, noise": lambda: read_runs(model, [run]),
        "fit": lambda: fit_to_data(model, data),
        "compare beside it": lambda: judge(fitted, model.name),
        "diagnose, singles": lambda: diagnose_comparison(judged, most=1),
        "diagnose, pairs": lambda: diagnose_comparison(judged, most=2),
    }
    found = {name: best(work, 3) for name, work in works.items()}
    rows = [("", "seconds", "of processor", "asked", "ratio")]
    for name, took in found.items():
        asked = ASKED.get(name)
        shown = ("", "") if asked is None else (f"{asked:g}", f"{took['wall'] / asked:.2f}")
        rows.append((name, f"{took['wall']:.2f}", f"{took['cpu']:.2f}", *shown))
    verdict = diagnose_comparison(judged, most=2)
    table(f"28 records, {run.info['rows']} rows: {verdict.verdict}, {', '.join(verdict.effects)}", rows)
    return found


def own_bench(folder: Path) -> dict[str, dict[str, float]]:
    """``rigctl diagnose`` of a user's own bench: 12 records of 600 samples, 3 states, all generic effects."""
    log = write_own_bench(folder)
    command = [sys.executable, "-m", "rigctl", "import", str(log), "--rig", "rig.yaml"]
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    found = {}
    rows = [("own bench, the whole command", "seconds", "of processor", "asked")]
    for name, asked in OWN.items():
        environment = os.environ | {"RIGCTL_CACHE_DIR": str(folder / "cache"), "RIGCTL_RESULTS": "off"}
        before, began = os.times(), time.perf_counter()
        command = [sys.executable, "-m", "rigctl", "diagnose", "latest", "--model", "model.yaml"]
        subprocess.run(command, check=True, capture_output=True, cwd=folder, env=environment)
        wall, after = time.perf_counter() - began, os.times()
        cpu = sum(after[2:4]) - sum(before[2:4])  # of child processes, not available on Windows
        found[name] = {"wall": wall, "cpu": cpu}
        rows.append((name, f"{wall:.1f}", f"{cpu:.1f}", f"{asked:g}"))
    table("each with no result of an earlier command at hand", rows)
    return found


def long_record(folder: Path) -> dict[str, dict[str, float]]:
    """``rigctl compare`` and ``rigctl diagnose`` of one record of 48 640 rows."""
    log, source = write_long(folder)
    command = [sys.executable, "-m", "rigctl", "import", str(log), "--rig", "oscillator-rig.yaml", "--json"]
    imported = json.loads(subprocess.run(command, check=True, capture_output=True, cwd=folder).stdout)
    title = f"one record of 48640 rows ({source}), a command at every sample"
    return _medians(title, imported["path"], folder / "oscillator-model.yaml", OF_LONG)


def strokes(folder: Path) -> dict[str, dict[str, float]]:
    """``rigctl diagnose`` of 32 strokes of the shipped cylinder with both chamber pressures recorded."""
    run = str(run_of_chambers(folder / "runs").folder)
    return _medians("32 strokes with both chamber pressures", run, MODEL, OF_STROKES)


def _medians(title: str, run: str, model: Path, asked: dict[str, float]) -> dict[str, dict[str, float]]:
    found = {}
    rows = [("", "seconds", "of processor", "asked")]
    for name, wanted in asked.items():
        command = [sys.executable, "-m", "rigctl", name, run, "--model", str(model), "--json"]
        took = in_a_command(command, {}, MEDIAN_OF, statistics.median)
        found[f"rigctl {name}"] = took
        rows.append((f"rigctl {name}", f"{took['wall']:.1f}", f"{took['cpu']:.1f}", f"{wanted:g}"))
    table(f"{title}; median of {MEDIAN_OF}, each with no result of an earlier command at hand", rows)
    return found


def sensors(folder: Path) -> dict[str, dict[str, float]]:
    """``rigctl diagnose`` of the 28 strokes, with what the rig file says of its sensors."""
    found: dict[str, dict[str, float]] = {}
    rows = [("rigctl diagnose", "seconds", "of processor", "times that with exact sensors")]
    for name, run in runs_of_sensors(folder).items():
        command = [sys.executable, "-m", "rigctl", "diagnose", str(run), "--model", str(MODEL), "--json"]
        found[name] = took = in_a_command(command, {}, TIMES)
        ratio = took["cpu"] / next(iter(found.values()))["cpu"]
        rows.append((name, f"{took['wall']:.1f}", f"{took['cpu']:.1f}", f"{ratio:.2f}"))
    table(f"28 strokes; at most {OF_SENSORS:g} times is required, of processor", rows)
    return found


def apply(folder: Path) -> dict[str, float]:
    """``rigctl diagnose --apply`` of 28 strokes of a bench with three hidden effects."""
    run = str(run_of_three(folder / "runs").folder)
    model = folder / "model.yaml"
    model.write_bytes(MODEL.read_bytes())
    command = ["diagnose", run, "--model", str(model), "--apply", "--json"]
    took, said = _once(folder, command)
    added = [name for step in said["steps"] for name in step["effects"]]
    rows = [
        ("28 strokes", "seconds", "of processor", "asked"),
        ("rigctl diagnose --apply", f"{took['wall']:.1f}", f"{took['cpu']:.1f}", f"{APPLY:g}"),
    ]
    table(f"hidden: {', '.join(THREE)}; added: {', '.join(added)}", rows)
    return took


def discover(folder: Path) -> dict[str, float]:
    """``rigctl discover`` of 32 strokes with friction at one position, which is not in the library."""
    run = str(write_tight(folder / "runs"))
    took, said = _once(folder, ["discover", run, "--model", str(MODEL), "--json"])
    rows = [
        (f"32 strokes, rig {CHAMBERS_RIG.stem}", "seconds", "of processor", "asked"),
        ("rigctl discover", f"{took['wall']:.1f}", f"{took['cpu']:.1f}", f"{DISCOVER:g}"),
    ]
    table(f"formulas: {', '.join(one['formula'] for one in said['formulas'])}", rows)
    return took


def _once(folder: Path, command: list[str]) -> tuple[dict[str, float], dict[str, Any]]:
    """Wall and CPU time, s, of a command of rigctl with cached machine code and bytecode, and its output."""
    rigctl = [sys.executable, "-m", "rigctl"]
    warm = [*rigctl, "compare", command[1], "--model", str(MODEL), "--json"]
    subprocess.run(warm, check=True, capture_output=True, cwd=folder)
    before, began = os.times(), time.perf_counter()
    done = subprocess.run([*rigctl, *command], check=True, capture_output=True, cwd=folder)
    wall, after = time.perf_counter() - began, os.times()
    return {"wall": wall, "cpu": sum(after[2:4]) - sum(before[2:4])}, json.loads(done.stdout)


def growing(folder: Path) -> dict[str, dict[str, float]]:
    """Compare, including the fit, for increasing numbers of standard records."""
    found = {}
    rows = [("records", "seconds", "of processor", "of processor, a record", "MB of memory")]
    for count in RECORDS:
        used = in_a_process("compare", str(run_of(count, folder / str(count)).folder))
        found[str(count)] = {"wall": used.wall, "cpu": used.cpu, "megabytes": used.megabytes}
        each = f"{1e3 * used.cpu / count:.0f} ms"
        rows.append((str(count), f"{used.wall:.1f}", f"{used.cpu:.1f}", each, f"{used.megabytes:.0f}"))
        print("  ".join(rows[-1]), flush=True)
    table("compare, a process each, its start included", rows)
    return found


def many_rows(folder: Path) -> dict[str, dict[str, float]]:
    """Import and compare ten million rows."""
    path = folder / "fast.parquet"
    count = write_fast(path, REPEATS)
    imported = in_a_process("import", str(path), str(folder / "fast"))
    path.unlink()
    compared = in_a_process("compare", imported.said)
    found, rows = {}, [("", "seconds", "of processor", "MB of memory", "asked")]
    for name, used in (("import", imported), ("compare", compared)):
        found[name] = {"wall": used.wall, "cpu": used.cpu, "megabytes": used.megabytes, "rows": count}
        took = (f"{used.wall:.1f}", f"{used.cpu:.1f}", f"{used.megabytes:.0f}")
        rows.append((name, *took, f"{ASKED_MEGABYTES:.0f} MB"))
    table(f"{count} rows in {28 * REPEATS} records, a process each", rows)
    return found


if __name__ == "__main__":
    main()
