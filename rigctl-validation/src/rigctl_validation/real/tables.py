"""The tables of the real logs as a logger writes them: a heading, and a line for each row."""

from __future__ import annotations

import lzma
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import Location, RigctlError
from rigctl_validation.real.logs import RealLog

Floats = NDArray[np.float64]

_TRAIN: Final = {"ced": "drives.csv", "oring": "oring.csv"}
#: of the Silverbox: sampling rate, Hz; first row of its first multisine, rows in each, and the arrow's rows
_RATE, _FIRST, _EACH, _ARROW = 1e7 / 2**14, 40_650, 8675, 40_000
#: rows of the first multisine to which a model is fitted
_FITTED = 4000
#: every tenth reading of the positioning system is used, with the mean voltage until the next: 100 Hz
_TENTH = 10


def training_lines(log: RealLog, folder: Path) -> list[str]:
    """The log that a user has: its heading and rows."""
    if log.name == "silverbox":
        return _silverbox(folder)["first multisine"][: 1 + _FITTED]
    if log.name == "emps":
        return _positioning(folder / "emps" / "DATA_EMPS.mat")
    return _read(folder / log.name / _TRAIN.get(log.name, "train.csv"))


def unseen_lines(log: RealLog, folder: Path) -> dict[str, list[str]]:
    """The parts to which nothing was fitted, by name; none where everything was measured in one log."""
    if log.fit:
        return {}
    if log.name == "silverbox":
        parts = _silverbox(folder)
        return {name: parts[name] for name in log.known}
    if log.name == "emps":
        return {"pulses": _positioning(folder / "emps" / "DATA_EMPS_PULSES.mat")}
    return {name: _read(folder / log.name / "test.csv") for name in log.known}


def write_lines(path: Path, lines: Sequence[str], rows: int = 0) -> None:
    """Write a log, cut to its first `rows` rows; 0 for all."""
    kept = lines[: 1 + rows] if rows else lines
    path.write_text("\n".join(kept) + "\n", encoding="utf-8", newline="\n")


def _read(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").split("\n")[:-1]
    except OSError as problem:
        raise _missing(path) from problem


def _missing(path: Path) -> RigctlError:
    return RigctlError(
        "a file of the real logs is missing",
        expected="the files that benchmarks/real/README.md lists",
        where=Location(path),
    )


def _silverbox(folder: Path) -> dict[str, list[str]]:
    """The arrow and the multisines, of the file as it was published, in mV."""
    path = folder / "silverbox" / "SNLS80mV.csv.xz"
    try:
        content = lzma.decompress(path.read_bytes()) if path.exists() else path.with_suffix("").read_bytes()
        table = 1e3 * np.loadtxt(BytesIO(content), delimiter=",", skiprows=1, usecols=(0, 1))
    except (OSError, lzma.LZMAError) as problem:
        raise _missing(path) from problem
    last = _FIRST + 9 * _EACH
    return {
        "first multisine": _silverbox_lines(table[_FIRST : _FIRST + _EACH]),
        "multisine 10": _silverbox_lines(table[last : last + _EACH]),
        "arrow": _silverbox_lines(table[:_ARROW]),
    }


def _silverbox_lines(table: Floats) -> list[str]:
    times = np.arange(table.shape[0]) / _RATE
    rows = zip(times.tolist(), table.tolist(), strict=True)
    return ["time [s],drive [mV],output [mV]", *(f"{t:.9g},{u:.9g},{y:.9g}" for t, (u, y) in rows)]


def _positioning(path: Path) -> list[str]:
    """The positioning system at 100 Hz, of the file as it was published."""
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True)
    except OSError as problem:
        raise _missing(path) from problem
    count = content["t"].size // _TENTH
    voltage = content["vir"][: count * _TENTH].reshape(count, _TENTH).mean(axis=1)
    columns = [content["t"][::_TENTH][:count], voltage, 1e3 * content["qm"][::_TENTH][:count]]
    rows = np.column_stack(columns).tolist()
    return ["time [s],voltage [V],position [mm]", *(f"{t:.9g},{u:.9g},{x:.9g}" for t, u, x in rows)]
