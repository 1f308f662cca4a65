"""Text files of loggers, changed at random and read: the right table or a refusal, never another table.

What is right is said by a reader that knows the form of each file from its description, without rigctl.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np

from open_range import without_ranges
from rigctl.dataset.importing.bring_in import take
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.samples import Samples
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped

ROWS = 24
#: cells without a value, by the documentation of the importer
MISSING = ("", "nan", "NA", "---", "#N/A", "OL", "OVLD", "error")
#: what stands above the names, as programs write it
ABOVE: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "a comment": ("# a log",),
    "settings": ("Model{d}GL240", "Interval{d}1 s", ""),
    "an oscilloscope": (
        *("Model{d}MDO34", "Firmware Version{d}1.20", "", "Point Format{d}Y{d}{d}"),
        *("Sample Interval{d}1.0{d}{d}", "Vertical Units{d}C{d}%{d}", "Label{d}{d}{d}", ""),
    ),
    "a list of channels": (
        *("Name:{d}oven{d}{d}{d}", "Owner:{d}lab{d}{d}{d}", "", "Channel{d}Name{d}Function{d}Range{d}"),
        *("101{d}Oven{d}Temp (Type K){d}C{d}", "102{d}Drive{d}DC voltage{d}10 V{d}", ""),
    ),
    "a recorder": (
        *(
            "Vendor{d}GRAPHTEC Corporation",
            "Model{d}GL240",
            "AMP settings",
            "CH{d}Signal name{d}Input{d}Range",
        ),
        *("CH1{d}{d}TEMP{d}TC_K", "CH2{d}{d}DC{d}10V", "Data"),
    ),
}
#: the names of time, temperature and heater, and a row of units below them
NAMES: dict[str, tuple[tuple[str, str, str], tuple[str, str, str] | None]] = {
    "brackets": (("time [s]", "temperature_1 [degC]", "heater_1 [%]"), None),
    "endings": (("time_s", "temperature_1_degC", "heater_1_pct"), None),
    "parentheses": (("Time (s)", "Temperature 1 (\N{DEGREE SIGN}C)", "Heater_1 (%)"), None),
    "a row of units": (("t", "temperature_1", "heater_1"), ("s", "degC", "%")),
    "units in parentheses": (("Time", "temperature_1", "heater_1"), ("(s)", "(\N{DEGREE SIGN}C)", "(%)")),
}
#: between cells, and the decimal sign
SIGNS = ((",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","))


@dataclass(frozen=True)
class Form:
    """The form of one logger's files."""

    delimiter: str
    decimal: str
    above: str
    names: str

    @property
    def heading(self) -> list[str]:
        names, units = NAMES[self.names]
        above = [line.format(d=self.delimiter) for line in ABOVE[self.above]]
        return [*above, *(self.delimiter.join(row) for row in (names, units) if row is not None)]

    def cell(self, value: float, digits: int) -> str:
        return f"{value:.{digits}f}".replace(".", self.decimal)


FORMS = tuple(Form(*sign, above, names) for sign, above, names in product(SIGNS, ABOVE, NAMES))


def table(rng: random.Random) -> list[list[float]]:
    start = rng.choice((0.0, 5.0, 990.0))
    level = rng.choice((20.0, 400.0))
    return [
        [start + k * 0.5, level + 2.0 * k + rng.choice((0.0, 0.25)), 0.0 if k < 9 else 60.0]
        for k in range(ROWS)
    ]


def written(form: Form, rows: Sequence[Sequence[float]], digits: int) -> list[str]:
    return [form.delimiter.join(form.cell(value, digits) for value in row) for row in rows]


# --- changes


def _replaced(text: str, rng: random.Random) -> str:
    at = rng.randrange(max(len(text), 1))
    return text[:at] + rng.choice("0123456789.,;\t-+eE #'\"x") + text[at + 1 :]


def _deleted(text: str, rng: random.Random) -> str:
    at = rng.randrange(max(len(text), 1))
    return text[:at] + text[at + 1 :]


def _inserted(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice("0123456789.,;\t-+eE #'\"x") + text[at:]


def _cell(form: Form, text: str, rng: random.Random) -> str:
    cells = text.split(form.delimiter)
    other = "," if form.decimal == "." else "."
    new = rng.choice(
        (*MISSING, "-9999", "1e30", "error", "7", "1.011", "1,011", "12:30", "0x10", "1_000", "inf")
    )
    at = rng.randrange(len(cells))
    cells[at] = rng.choice((new, cells[at].replace(form.decimal, other), "", cells[at] + "e1"))
    return form.delimiter.join(cells)


def changed(form: Form, lines: list[str], rng: random.Random) -> list[str]:
    """The lines with one or a few changes below the heading."""
    lines, first = list(lines), len(form.heading)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(first, len(lines))
        changes: Sequence[Callable[[], Any]] = (
            lambda at=at: lines.__setitem__(at, _replaced(lines[at], rng)),
            lambda at=at: lines.__setitem__(at, _deleted(lines[at], rng)),
            lambda at=at: lines.__setitem__(at, _inserted(lines[at], rng)),
            lambda at=at: lines.__setitem__(at, _cell(form, lines[at], rng)),
            lambda at=at: lines.insert(at, lines[rng.randrange(first, len(lines))]),
            lambda at=at: lines.insert(at, form.heading[-1]),
            lambda at=at: lines.insert(at, form.delimiter.join(reversed(NAMES[form.names][0]))),
            lambda at=at: lines.insert(at, rng.choice(("", "# stopped", "stopped", form.delimiter))),
            lambda at=at: lines.__delitem__(slice(at, at + 3)) if len(lines) > first + 8 else None,
        )
        rng.choice(changes)()
    return lines


# --- the strict reader

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")


def strictly(form: Form, lines: Sequence[str]) -> list[list[float]] | None:
    """The table of a file of this form; None if any line is not a row of it, or could be read in two ways."""
    repeated = [tuple(row) for row in NAMES[form.names] if row is not None]
    rows: list[list[float]] = []
    for line in lines[len(form.heading) :]:
        if not line.strip() or not line.replace(form.delimiter, "").strip():
            continue
        cells = [cell.strip() for cell in line.split(form.delimiter)]
        if line.startswith("#") and cells[0] not in MISSING:
            continue
        # the heading again; directly below itself, one of two rows may lack a name that the other has
        if tuple(cells) in repeated or (not rows and _below_its_like(cells, repeated)):
            continue
        while len(cells) > 3 and not cells[-1]:
            cells.pop()
        values = [_value(cell, form.decimal) for cell in cells]
        if len(values) != 3 or None in values or '"' in line:
            return None
        rows.append([value for value in values if value is not None])
    times = [row[0] for row in rows]
    rising = all(b > a for a, b in pairwise(times))
    return rows if rising and not any(np.isnan(times)) else None


def _below_its_like(cells: Sequence[str], headings: Sequence[Sequence[str]]) -> bool:
    return any(
        len(cells) == len(names) and all(cell in ("", name) for cell, name in zip(cells, names, strict=True))
        for names in headings
    )


def _value(cell: str, decimal: str) -> float | None:
    if cell in MISSING:
        return float("nan")
    if decimal != "." and "." in cell:
        return None
    plain = cell.replace(decimal, ".")
    if not _NUMBER.fullmatch(plain):
        return None
    value = float(plain)
    return float("nan") if value in (-9999.0, 1e30) else value if np.isfinite(value) else None


# --- the comparison


@dataclass
class Found:
    """What became of the files."""

    read: int = 0
    refused: int = 0
    refused_though_readable: int = 0
    failures: list[str] = field(default_factory=list)


def torture(folder: Path, trials: int, seed: int) -> Found:
    """Read changed files of all forms."""
    rig, found = without_ranges(shipped("rigs", "heater-board.yaml")), Found()
    folder.mkdir(parents=True, exist_ok=True)
    for trial in range(trials):
        rng = random.Random(f"{seed}-{trial}")
        form = FORMS[trial % len(FORMS)]
        whole = [*form.heading, *written(form, table(rng), rng.choice((1, 2, 3)))]
        lines = whole if trial < len(FORMS) else changed(form, whole, rng)
        path = folder / "log.csv"
        path.write_text("\n".join([*lines, ""]), encoding="utf-8")
        expected = strictly(form, lines)
        try:
            got = _read(path, rig)
        except RigctlError as refusal:
            assert str(refusal)
            found.refused += 1
            found.refused_though_readable += expected is not None
            if trial < len(FORMS):
                found.failures.append(f"{form}: the file itself is refused: {refusal}")
            continue
        except Exception as problem:  # noqa: BLE001 - whatever it is, it is a failure
            found.failures.append(f"{trial} of seed {seed}, {form}: {problem!r}")
            continue
        found.read += 1
        if expected is None or not _same(got, expected):
            kept = folder / f"{seed}-{trial}.csv"
            kept.write_bytes(path.read_bytes())
            found.failures.append(f"{trial} of seed {seed}, {form}: {kept}")
    return found


def _read(path: Path, rig: Any) -> np.ndarray:
    """The rows as an import would take them; refused unless all of them are good."""
    taken = take([path], rig, Options(), keep_good=False)
    assert isinstance(taken, Samples)
    if taken.found.bad_rows:
        raise RigctlError(str(taken.found.faults[0].what))
    block = np.concatenate([part.block for part in taken.kept])
    columns = [taken.layout.columns.index(name) for name in ("time", "temperature_1", "heater_1")]
    return block[:, columns] - [0.0, 273.15, 0.0]


def _same(got: np.ndarray, expected: Sequence[Sequence[float]]) -> bool:
    wanted = np.array(expected, dtype=float).reshape(-1, 3) * [1.0, 1.0, 0.01]
    return got.shape == wanted.shape and np.allclose(got, wanted, rtol=1e-9, atol=1e-9, equal_nan=True)


def main() -> None:
    """``make loggers``: as many files as asked; prints the count, and each that was read wrongly."""
    asked = argparse.ArgumentParser(prog="python -m torture.logger_files", description=__doc__)
    asked.add_argument("--files", type=int, default=10_000)
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = torture(Path(folder), given.files, given.seed)
    verdict = f"REFUTED {len(found.failures)} times" if found.failures else f"not refuted ({given.files})"
    refused = f"{found.refused} refused, {found.refused_though_readable} of them readable"
    print(f"{verdict}: {len(FORMS)} forms; {found.read} read, {refused}", *found.failures, sep="\n")  # noqa: T201
    sys.exit(bool(found.failures))


if __name__ == "__main__":
    main()
