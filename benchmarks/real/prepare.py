"""The tables of the tier `real` from the files as they were published: one function for each log."""

from __future__ import annotations

import lzma
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

Floats = NDArray[np.float64]
#: sampling periods, s
_DRYER, _DAMPER, _DRIVES, _HOOP = 0.08, 0.005, 0.02, 0.1
#: rows to which a model is fitted; the others are unseen
_DRYER_FITTED, _DAMPER_FITTED = 500, 2000
#: the logger of the seals writes a row in 10 ms; every tenth is kept
_SEAL_TENTH = 10


def find(source: Path, name: str) -> Path:
    """The file of this name, anywhere in the folder."""
    found = sorted(source.rglob(name))
    if not found:
        raise SystemExit(f"{source}: there is no {name}; README.md says where it was published")
    return found[0]


def write(
    path: Path, heading: str, columns: Sequence[Floats], forms: Sequence[str], record: str = ""
) -> None:
    """Add rows to a table; the heading comes first, a record's name after the time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = not path.exists()
    with path.open("a", encoding="utf-8", newline="\n") as file:
        if fresh:
            file.write(heading + "\n")
        for row in zip(*columns, strict=True):
            cells = [format(value, form) for value, form in zip(row, forms, strict=True)]
            file.write(",".join([cells[0], record, *cells[1:]] if record else cells) + "\n")


def dryer(source: Path, out: Path) -> None:
    """Heater voltage and thermocouple: the first half is fitted, the second is unseen."""
    content = loadmat(find(source, "dryer.mat"), squeeze_me=True)
    for name, part in _halves(_DRYER_FITTED):
        u, y = content["X"][part], content["y"][part]
        columns = [np.arange(u.size) * _DRYER, u, y]
        write(
            out / "dryer" / name,
            "time [s],heater voltage [V],thermocouple [V]",
            columns,
            (".2f", ".2f", ".4f"),
        )


def damper(source: Path, out: Path) -> None:
    """Velocity and force."""
    content = loadmat(find(source, "damper.mat"), squeeze_me=True)
    for name, part in _halves(_DAMPER_FITTED):
        u, y = content["X"][part], content["y"][part]
        columns = [np.arange(u.size) * _DAMPER, u, y]
        write(out / "damper" / name, "time [s],velocity [cm/s],force [N]", columns, (".3f", ".5f", ".4f"))


def ced(source: Path, out: Path) -> None:
    """Three records of both motors' voltage, a pseudorandom binary sequence, and the pulley's speed."""
    content = loadmat(find(source, "drive.mat"), squeeze_me=True)
    for number in (1, 2, 3):
        u, z = content[f"u{number}"], content[f"z{number}"]
        columns = [np.arange(u.size) * _DRIVES, u, z]
        heading = "time [s],record,motor voltage [V],pulley speed [V]"
        write(out / "ced" / "drives.csv", heading, columns, (".2f", ".3f", ".5f"), f"prbs{number}")


def hoop(source: Path, out: Path) -> None:
    """Voltage and speed: fixed steps are fitted, random steps are unseen."""
    for name, file in (("train.csv", "fixedStepSequence.mat"), ("test.csv", "randomStepSequence.mat")):
        content = loadmat(find(source, file), squeeze_me=True)
        every = max(1, round(_HOOP / float(np.median(np.diff(content["time"])))))
        columns = [content[key][::every] for key in ("time", "u", "y")]
        write(out / "hoop" / name, "time [s],voltage [V],speed [rad/s]", columns, (".1f", ".4f", ".5f"))


def oring(source: Path, out: Path) -> None:
    """Position, pressure and force of a cylinder that a testing machine moves, at four pressures."""
    for bar in (1, 3, 5, 7):
        table = np.loadtxt(find(source, f"O-ring257_{bar}bar.csv"))[::_SEAL_TENTH]
        columns = [1e-3 * table[:, 0], table[:, 4], table[:, 5], table[:, 6]]
        heading = "time [s],record,position [mm],pressure [bar],force [N]"
        write(out / "oring" / "oring.csv", heading, columns, (".3f",) * 4, f"p{bar}")


def silverbox(source: Path, out: Path) -> None:
    """The file as it was published, compressed."""
    (out / "silverbox").mkdir(parents=True, exist_ok=True)
    content = find(source, "SNLS80mV.csv").read_bytes()
    (out / "silverbox" / "SNLS80mV.csv.xz").write_bytes(lzma.compress(content))


def emps(source: Path, out: Path) -> None:
    """The files as they were published."""
    (out / "emps").mkdir(parents=True, exist_ok=True)
    for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        shutil.copyfile(find(source, name), out / "emps" / name)


LOGS: Mapping[str, Callable[[Path, Path], None]] = {
    each.__name__: each for each in (dryer, ced, damper, hoop, oring, silverbox, emps)
}


def _halves(fitted: int) -> tuple[tuple[str, slice], tuple[str, slice]]:
    return ("train.csv", slice(None, fitted)), ("test.csv", slice(fitted, None))
