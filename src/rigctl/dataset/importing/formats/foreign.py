"""Readers of foreign formats, each in a separate process.

They are large, partly native libraries, which a damaged file can crash, send into an endless loop or make
allocate any amount of memory. In a separate process with limits this does no harm. The data are returned as
Arrow files in a temporary folder.

The module runs on both sides: `open_in_process` and `_opened` in the calling process, `read` in that of the
reader. In between are a task as JSON on stdin, an exit status, and a folder with the data: nothing that is
unpickled, and thus executed, ever comes back. The folder lives as long as the returned file does.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final, NoReturn

from rigctl.child_process import module_command
from rigctl.dataset.importing.cells.times import ArrayClock
from rigctl.dataset.importing.formats.groups import Column, Group, GroupedFile, is_text
from rigctl.dataset.importing.formats.limits import OUT_OF_MEMORY
from rigctl.dataset.importing.formats.table import Heading
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.json_values import parse_json

if TYPE_CHECKING:
    import pyarrow as pa
    from numpy.typing import NDArray

#: memory limit of a reader, bytes, and additional bytes per byte of the file
_MEMORY: Final = 900_000_000
_MEMORY_PER_BYTE: Final = 16
#: its limit of CPU time, s, and bytes of the file per additional second. It ends endless loops only, and is
#: far from what a good file takes, which must not be refused because the computer is busy: libraries that are
#: imported for the first time are compiled, which alone can take 10 s
_SECONDS: Final = 60.0
_BYTES_PER_SECOND: Final = 200_000
#: limit of elapsed time, as a multiple of that: a reader that only waits has no CPU time to limit
_PATIENCE: Final = 20.0
#: values of all columns together in one piece of the result
_PIECE_VALUES: Final = 1 << 20
_FACTS: Final = "facts.json"

#: a reader of a file, given its path and the caller's options
Reader = Callable[[Path, Options], GroupedFile]


def open_in_process(path: Path, options: Options, module: str, function: str) -> GroupedFile:
    """Read a file with a function of a module, in a separate process.

    Raises
    ------
    RigctlError
        the reader refuses the file, crashes, takes too long or needs too much memory.
    """
    folder = Path(mkdtemp(prefix="rigctl-import-"))
    try:
        size = _size(path)
        seconds = _SECONDS + size / _BYTES_PER_SECOND
        memory = _MEMORY + _MEMORY_PER_BYTE * size
        task = {
            "path": str(path),
            "folder": str(folder),
            "module": module,
            "function": function,
            "options": {**asdict(options), "may_lack": sorted(options.may_lack), "own": sorted(options.own)},
            "memory": memory,
            "seconds": seconds,
        }
        _carry_out(task, path)
        return _opened(path, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError as problem:
        raise RigctlError("there is no such file", where=Location(path)) from problem
    except OSError as problem:
        raise RigctlError(f"cannot read the file: {problem.strerror}", where=Location(path)) from problem


def _start(task: Mapping[str, Any]) -> int:
    """Run a task in a separate process; return its exit status."""
    threads = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_MAX_THREADS")
    return subprocess.run(  # noqa: S603 - this program itself, and nothing from the file
        module_command("rigctl.dataset.importing.formats.foreign"),
        input=json.dumps(task).encode("utf-8"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **dict.fromkeys(threads, "1"), "PYTHONUTF8": "1"},
        timeout=_PATIENCE * task["seconds"],
        check=False,
    ).returncode


def _carry_out(task: Mapping[str, Any], path: Path) -> None:
    """Run the reader, and turn its failures into clear errors."""
    try:
        code = _start(task)
    except subprocess.TimeoutExpired as problem:
        raise _too_long(path, task["seconds"]) from problem
    # The facts are written last: a reader that ended without them has not ended well, whatever its status.
    if code == 0 and (Path(task["folder"]) / _FACTS).exists():
        return
    over = (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)) if os.name == "posix" else ()
    if code in over:
        raise _too_long(path, task["seconds"])
    if code == OUT_OF_MEMORY:
        raise RigctlError(
            f"reading it takes more than {task['memory'] / 1e9:.1f} GB of memory",
            expected="a file that is not damaged, and no larger than it looks",
            hint="Write it as Parquet or CSV, in parts",
            where=Location(path),
        )
    raise RigctlError(
        "the file is damaged: the program that reads this format crashed over it",
        value=f"exit status {code}",
        where=Location(path),
    )


def _too_long(path: Path, seconds: float) -> RigctlError:
    return RigctlError(
        f"reading it did not end within {seconds:.0f} s of processor time",
        expected="a file that is not damaged",
        hint="Open it with the program that wrote it, and save it again",
        where=Location(path),
    )


# --- in the process of the reader


def main() -> None:
    """Read the file named by the task on standard input, within its limits."""
    read(json.loads(sys.stdin.buffer.read()))


def read(task: Mapping[str, Any]) -> NoReturn:
    """Run a task, and end this process."""
    from importlib import import_module

    from rigctl.dataset.importing.formats.limits import limit_process

    folder = Path(task["folder"])
    try:
        limit_process(task["memory"], task["seconds"])
        given = task["options"]
        sets = {name: frozenset(given[name]) for name in ("may_lack", "own")}
        options = Options(**{**given, **sets, "missing": tuple(given["missing"])})
        reader: Reader = getattr(import_module(task["module"]), task["function"])
        facts = _hand_over(reader(Path(task["path"]), options), folder)
    except RigctlError as problem:
        facts = {"error": _as_data(problem)}
    except MemoryError:
        os._exit(OUT_OF_MEMORY)
    (folder / _FACTS).write_text(json.dumps(facts), encoding="utf-8")
    # skips the destructors of a library that may have read a damaged file
    os._exit(0)


def _as_data(problem: RigctlError) -> dict[str, Any]:
    names = ("what", "value", "expected", "nearest", "hint")
    where = {"line": problem.where.line, "column": problem.where.column}
    return {**{name: getattr(problem, name) for name in names}, **where}


def _hand_over(file: GroupedFile, folder: Path) -> dict[str, Any]:
    """Write the data, group by group, and return the other facts."""
    groups = []
    with file.reading() as opened:
        for number, group in enumerate(opened):
            rows = max(_PIECE_VALUES // max(len(group.columns), 1), 1)
            _write_group(folder / f"{number}.arrow", group, rows)
            columns = [[column.name, column.unit] for column in group.columns]
            facts = {"name": group.name, "rows": group.rows, "first": group.first, "piece": rows}
            groups.append({**facts, "columns": columns})
    return {
        "groups": groups,
        "headings": [[one.name, one.unit, one.seconds, one.spent] for one in file.headings],
        "noun": file.noun,
        "remarks": list(file.remarks),
        "damage": list(file.damage),
        "clock": None if file.clock is None else [file.clock.origin, file.clock.epoch],
        "began": file.began,
        "merged": file.merged,
    }


def _write_group(path: Path, group: Group, rows: int) -> None:
    import pyarrow as pa

    writer: pa.RecordBatchFileWriter | None = None
    try:
        for start in range(0, group.rows, rows):
            stop = min(start + rows, group.rows)
            arrays = [_as_arrow(column.read(start, stop), stop - start) for column in group.columns]
            batch = pa.record_batch(arrays, names=[str(index) for index in range(len(arrays))])
            writer = writer or pa.ipc.new_file(str(path), batch.schema)
            writer.write_batch(batch)
    finally:
        if writer is not None:
            writer.close()


def _as_arrow(values: NDArray[Any], rows: int) -> pa.Array:
    """Return a column as an Arrow array; nulls if it is neither numbers, nor texts, nor time stamps."""
    import pyarrow as pa

    if values.ndim == 1 and is_text(values):
        texts = [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text) for text in values]
        return pa.array(texts, pa.string())
    if values.ndim != 1 or values.dtype.kind not in "fiubM":
        return pa.nulls(rows)
    if values.dtype.kind == "M":
        return pa.array(values.astype("datetime64[ns]"))
    # Arrow accepts only the native byte order
    return pa.array(values.astype(values.dtype.newbyteorder("=")))


# --- in the calling process again


def _opened(path: Path, folder: Path) -> GroupedFile:
    """Return the file from its reader's `folder`, which exists as long as the result does."""
    facts = parse_json((folder / _FACTS).read_text(encoding="utf-8"))
    if "error" in facts:
        error = facts["error"]
        where = Location(path, error.pop("line"), error.pop("column"))
        raise RigctlError(**error, where=where)
    described = facts["groups"]

    @contextmanager
    def reading() -> Iterator[Sequence[Group]]:
        files = [
            _Pieces(folder / f"{number}.arrow", group["piece"]) for number, group in enumerate(described)
        ]
        try:
            yield [_group(group, pieces) for group, pieces in zip(described, files, strict=True)]
        finally:
            for pieces in files:
                pieces.close()

    clock = facts["clock"]
    file = GroupedFile(
        path,
        tuple(Heading(name, unit, Location(path), *marks) for name, unit, *marks in facts["headings"]),
        reading,
        facts["noun"],
        tuple(facts["remarks"]),
        tuple(facts["damage"]),
        None if clock is None else ArrayClock(clock[0], tuple(clock[1]) if clock[1] else None),
        facts["began"],
        facts["merged"],
    )
    weakref.finalize(file, shutil.rmtree, folder, ignore_errors=True)
    return file


def _group(facts: Mapping[str, Any], pieces: _Pieces) -> Group:
    def reader(index: int) -> Callable[[int, int], NDArray[Any]]:
        return lambda start, stop: pieces.read(index, start, stop)

    columns = tuple(Column(name, unit, reader(index)) for index, (name, unit) in enumerate(facts["columns"]))
    return Group(facts["name"], facts["rows"], columns, facts["first"])


class _Pieces:
    """Reads an Arrow file of pieces of equal length, caching one of them."""

    def __init__(self, path: Path, rows: int) -> None:
        self._path = path
        self._rows = rows
        self._file: pa.RecordBatchFileReader | None = None
        self._stream: Any = None
        self._held: tuple[int, pa.RecordBatch] | None = None

    def read(self, index: int, start: int, stop: int) -> NDArray[Any]:
        """Return the values of a column from one row to another."""
        import numpy as np

        parts = []
        for number in range(start // self._rows, -(-stop // self._rows)):
            begin = number * self._rows
            span = slice(max(start - begin, 0), min(stop - begin, self._rows))
            column = self._piece(number).column(index)[span]
            parts.append(np.asarray(column.to_numpy(zero_copy_only=False)))
        return np.concatenate(parts) if parts else np.zeros(0)

    def _piece(self, number: int) -> pa.RecordBatch:
        import pyarrow as pa

        if self._held is None or self._held[0] != number:
            if self._file is None:
                self._stream = pa.OSFile(str(self._path))
                self._file = pa.ipc.open_file(self._stream)
            self._held = (number, self._file.get_batch(number))
        return self._held[1]

    def close(self) -> None:
        """Close the file."""
        self._held, self._file = None, None
        if self._stream is not None:
            self._stream.close()
        self._stream = None


if __name__ == "__main__":
    main()
