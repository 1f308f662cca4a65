"""Files of other programs, damaged at random and imported: a run or one message, in bounded time and memory.

The examples are written by the libraries that loggers use. One process imports all files of a kind; a format
that is read apart from it is read in a copy of that process, since the reader's libraries take longer to load
than a file to read: with the same bounds as in a process of its own, and judged by the same code.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from rigctl.dataset.importing import import_file
from rigctl.dataset.importing.formats import foreign
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig

MEMORY = 1 << 30  #: bytes
SECONDS = 10.0  #: of processor for one file, its reader included
_TIMES = np.arange(60) * 0.01
_POSITION = np.linspace(0.0, 59.0, 60)
_OIL = 40.0 + np.sin(_TIMES)


def csv() -> bytes:
    rows = zip(_TIMES, _POSITION, _OIL, strict=True)
    lines = [f"{t:.2f},{p:.3f},{o:.3f}" for t, p, o in rows]
    return "\n".join(["time [s],position [mm],oil_temperature [degC]", *lines, ""]).encode("ascii")


def csv_gz() -> bytes:
    return gzip.compress(csv())


def _frame() -> Any:
    import pandas as pd

    columns = ("time [s]", "position [mm]", "oil_temperature [degC]")
    return pd.DataFrame(dict(zip(columns, (_TIMES, _POSITION, _OIL), strict=True)))


def xlsx() -> bytes:
    stream = io.BytesIO()
    _frame().to_excel(stream, index=False)
    return stream.getvalue()


def parquet() -> bytes:
    stream = io.BytesIO()
    _frame().to_parquet(stream)
    return stream.getvalue()


def tdms() -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    wave = {"wf_increment": 0.01, "wf_start_offset": 0.0}
    with TdmsWriter(stream) as writer:
        writer.write_segment(
            [
                ChannelObject("log", "position", _POSITION, {**wave, "unit_string": "mm"}),
                ChannelObject("log", "oil_temperature", _OIL, {**wave, "unit_string": "degC"}),
            ]
        )
    return stream.getvalue()


def mf4() -> bytes:
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    with MDF(version="4.10") as made:
        position = Signal(_POSITION, _TIMES, name="position", unit="mm")
        oil = Signal(_OIL, _TIMES, name="oil_temperature", unit="degC")
        made.append([position, oil], common_timebase=True)
        made.save(stream)
    return stream.getvalue()


def mat() -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, {"time": _TIMES, "position": _POSITION, "units": {"time": "s", "position": "mm"}})
    return stream.getvalue()


KINDS: Mapping[str, Callable[[], bytes]] = {
    "csv": csv,
    "csv.gz": csv_gz,
    "xlsx": xlsx,
    "parquet": parquet,
    "tdms": tdms,
    "mf4": mf4,
    "mat": mat,
}


def damaged(content: bytes, kind: str, rng: random.Random) -> bytes:
    """Bytes changed, lost, added, repeated or cut off; in compressed files, often in their content."""
    if kind == "csv.gz" and rng.random() < 0.5:
        return gzip.compress(_spoiled(gzip.decompress(content), rng))
    if kind == "xlsx" and rng.random() < 0.7:
        return _spoiled_inside(content, rng)
    return _spoiled(content, rng)


def _spoiled(content: bytes, rng: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at, size = rng.randrange(max(1, len(changed))), rng.choice((1, 1, 2, 4, 8, 60))
        match rng.randrange(6):
            case 0:
                changed[at : at + 1] = bytes([changed[at] ^ (1 << rng.randrange(8))]) if changed else b""
            case 1:
                changed[at : at + size] = bytes(len(changed[at : at + size]))
            case 2:
                changed[at : at + size] = rng.randbytes(len(changed[at : at + size]))
            case 3:
                changed[at : at + size] = rng.choice((b"\xff" * 8, b"", b"\x00", b"\xff\xff\xff\x7f"))
            case 4:
                changed[at:at] = changed[at : at + size] or rng.randbytes(size)
            case _:
                if rng.random() < 0.3:
                    del changed[at:]
    return bytes(changed)


def _spoiled_inside(content: bytes, rng: random.Random) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as whole, zipfile.ZipFile(stream, "w") as made:
        hit = rng.choice(whole.namelist())
        for name in whole.namelist():
            data = whole.read(name)
            made.writestr(name, _spoiled(data, rng) if name == hit else data)
    return stream.getvalue()


@dataclass
class Found:
    """What became of the files of one kind; s of processor and bytes, of the worst."""

    read: int = 0
    refused: int = 0
    crashed_apart: int = 0  #: the reader's process died, which was reported in one message
    out_of_bounds: int = 0  #: it needed too much memory or time, which was reported
    slowest: float = 0.0
    memory: int = 0
    failures: list[str] = field(default_factory=list)


def _copied(task: Mapping[str, Any]) -> int:
    """As `foreign._start`, in a copy of this process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        _read(task)
    give_up = time.monotonic() + 20.0 * task["seconds"]
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > give_up:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise subprocess.TimeoutExpired("reader", 20.0 * task["seconds"])
        time.sleep(0.001)


def _read(task: Mapping[str, Any]) -> NoReturn:
    try:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        foreign.read({**task, "memory": task["memory"] + _present()})
    finally:
        os._exit(1)


def _present() -> int:
    """Bytes of data that this process already holds, which a reader's own process would not have."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmData")).split()[1])


def _hangs(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS:g} s of processor")


def _cpu() -> float:
    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def _one(path: Path, rig: Any, found: Found) -> None:
    runs = path.parent / "runs"
    began = _cpu()
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        import_file(path, rig, runs)
    except RigctlError as refusal:
        assert str(refusal)
        found.refused += 1
        found.crashed_apart += "crashed over it" in str(refusal)
        found.out_of_bounds += "of memory" in str(refusal) or "did not end" in str(refusal)
    else:
        found.read += 1
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        shutil.rmtree(runs, ignore_errors=True)
    found.slowest = max(found.slowest, round(_cpu() - began, 2))


def _all_of(kind: str, folder: Path, trials: int, seed: int) -> Found:
    """Import damaged files of one kind in a separate process."""
    foreign._start = _copied
    signal.signal(signal.SIGPROF, _hangs)
    rig, path, found = load_rig(shipped("rigs", "hl32-bench.yaml")), folder / f"log.{kind}", Found()
    whole = KINDS[kind]()
    path.write_bytes(whole)
    _one(path, rig, found)
    assert found.read == 1, f"the example itself is sound: {found}"
    if kind in ("tdms", "mf4", "mat", "xlsx"):  # loads the reader's libraries once, for all copies
        from rigctl.dataset.importing.formats import formats

        formats.isolated = False
        _one(path, rig, found)
        formats.isolated = True
    found = Found()
    for trial in range(trials):
        content = damaged(whole, kind, random.Random(f"{seed}-{kind}-{trial}"))
        path.write_bytes(content)
        try:
            _one(path, rig, found)
        except Exception as problem:  # noqa: BLE001 - whatever it is, it is a failure
            kept = folder / f"{seed}-{trial}.{kind}"
            kept.write_bytes(content)
            last = traceback.extract_tb(problem.__traceback__)[-1]
            found.failures.append(f"{kind} {trial} of seed {seed}: {problem!r} at {last.name}:{last.lineno}")
    found.memory = max(_own_peak(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
    if found.memory > MEMORY:
        found.failures.append(f"{kind}: {found.memory / 1e9:.2f} GB of memory")
    return found


def _own_peak() -> int:
    """The most memory that this program has had, in bytes.

    `getrusage` also counts what the process had been before it became this program: a copy of the one that
    started it.
    """
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def torture(folder: Path, trials: int, seed: int, kinds: Collection[str] = tuple(KINDS)) -> dict[str, Any]:
    """Import damaged files, the same number of each kind."""
    results: dict[str, Any] = {}
    for kind in kinds:
        here = folder / kind
        here.mkdir(parents=True, exist_ok=True)
        program = [
            sys.executable,
            "-m",
            "torture.foreign_files",
            kind,
            str(here),
            str(-(-trials // len(kinds))),
        ]
        places = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        done = subprocess.run(
            [*program, str(seed)],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))},
        )
        said = done.stdout.splitlines()[-1:] or ["{}"]
        results[kind] = (
            json.loads(said[0])
            if done.returncode == 0
            else {"failures": [f"{kind}: the process ended with {done.returncode}: {done.stderr[-2000:]}"]}
        )
    return results


if __name__ == "__main__":
    chosen, where, count, number = sys.argv[1:]
    print(json.dumps(asdict(_all_of(chosen, Path(where), int(count), int(number)))))  # noqa: T201
