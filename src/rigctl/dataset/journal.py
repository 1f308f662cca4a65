"""The samples of a run while it is being carried out: append-only, readable after a kill at any moment.

Layout of the file, all little-endian::

    magic       8 bytes                b"RIGJRNL1"
    frame 0     length u32, crc32 u32  JSON: run, session, offset, columns
    frame 1…    length u32, crc32 u32  rows of float64, one after another

A frame that is cut off or whose checksum is wrong ends the journal: everything before it is whole.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import ExitCode, Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAGIC: Final = b"RIGJRNL1"
NAME: Final = "samples.journal"
_FRAME = struct.Struct("<II")
#: more rows than fill this are written as several frames
_FRAME_BYTES: Final = 1 << 18
#: a length beyond this is no length but damage
_MAX_FRAME_BYTES: Final = 1 << 24


class JournalWriter:
    """Appends rows of float64 to a journal; they wait in memory until `flush`.

    Parameters
    ----------
    path: the new file; must not exist.
    columns: names of the values of a row, in order.
    facts: what else the first frame says (run, session, time offset).
    """

    def __init__(self, path: Path, columns: Sequence[str], facts: dict[str, Any]) -> None:
        self.path = path
        self._pack = struct.Struct(f"<{len(columns)}d").pack
        self._width = len(columns)
        self._frame_bytes = _FRAME_BYTES - _FRAME_BYTES % (8 * len(columns))
        self._waiting = bytearray()
        self._file = path.open("xb", buffering=0)
        self._whole = 0  # bytes of the file that are whole frames
        first = json.dumps({**facts, "columns": list(columns)}, ensure_ascii=False).encode("utf-8")
        self._write(MAGIC, _FRAME.pack(len(first), zlib.crc32(first)), first)

    @property
    def waiting(self) -> int:
        """Number of bytes that have not been flushed."""
        return len(self._waiting)

    def append(self, row: Sequence[float]) -> None:
        """Add one row, values in the order of the columns."""
        self._waiting += self._pack(*row)

    def append_block(self, rows: NDArray[np.float64]) -> None:
        """Add the rows of an array of shape (n, columns)."""
        import numpy as np

        block = np.ascontiguousarray(rows, dtype="<f8")
        if block.ndim != 2 or block.shape[1] != self._width:
            raise ValueError(f"a block of shape {block.shape} does not fit {self._width} columns")
        if block.size:
            self._waiting += block.data.cast("B")

    def flush(self) -> None:
        """Hand every waiting row to the operating system: from here on a kill of the program loses none.

        Raises
        ------
        OSError
            not all rows could be written. The file ends at its last whole frame, the others still wait.
        """
        written = 0
        try:
            with memoryview(self._waiting) as waiting:
                for start in range(0, len(waiting), self._frame_bytes):
                    with waiting[start : start + self._frame_bytes] as payload:
                        self._write(_FRAME.pack(len(payload), zlib.crc32(payload)), payload)
                        written = start + len(payload)
        finally:
            del self._waiting[:written]

    def sync(self) -> None:
        """Wait until what was flushed is on the disk itself: from here on a power failure loses none."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file without flushing; idempotent."""
        self._file.close()

    def _write(self, *parts: bytes | bytearray | memoryview) -> None:
        """Write all parts or none: a frame torn by a full disk would hide every later one."""
        try:
            for part in parts:
                write_fully(self._file, part)
        except OSError:
            self._file.seek(self._whole)
            self._file.truncate()
            raise
        self._whole += sum(len(part) for part in parts)


def write_fully(file: Any, part: bytes | bytearray | memoryview) -> None:
    """Write to an unbuffered file, which may take only a part of the bytes at a time."""
    written = file.write(part)
    while written < len(part):
        with memoryview(part) as view:
            more = file.write(view[written:])
        if not more:
            raise OSError("no bytes could be written")
        written += more


@dataclass(frozen=True)
class Journal:
    """A journal as it is found on disk.

    Parameters
    ----------
    facts: the first frame: run, session, offset, columns.
    starts, lengths: where each whole frame of rows lies in the file, in bytes.
    lost_bytes: what follows the last whole frame.
    """

    path: Path
    facts: dict[str, Any]
    starts: tuple[int, ...]
    lengths: tuple[int, ...]
    lost_bytes: int

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the values of a row."""
        return tuple(self.facts["columns"])

    @property
    def rows(self) -> int:
        """Number of whole rows."""
        return sum(self.lengths) // (8 * len(self.columns))

    def blocks(self, rows: int = 1 << 17) -> Iterator[NDArray[np.float64]]:
        """The rows in order, as arrays of shape (`rows`, columns); the last may be shorter.

        The division depends on the number of rows only, not on when they happened to be flushed.
        """
        import numpy as np

        width = len(self.columns)
        size = rows * width * 8
        gathered = bytearray()
        with self.path.open("rb") as file:
            for start, length in zip(self.starts, self.lengths, strict=True):
                file.seek(start)
                gathered += file.read(length)
                while len(gathered) >= size:
                    yield np.frombuffer(bytes(gathered[:size]), dtype="<f8").reshape(-1, width)
                    del gathered[:size]
        if gathered:
            yield np.frombuffer(bytes(gathered), dtype="<f8").reshape(-1, width)


def read_journal(path: Path) -> Journal | None:
    """Find the whole frames of a journal; None when not even its first frame is whole (it holds no rows).

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return _scan(path, file)
    except OSError as problem:
        raise RigctlError(
            f"cannot read the journal: {problem.strerror}",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        ) from problem


def _scan(path: Path, file: Any) -> Journal | None:
    size = path.stat().st_size
    if file.read(len(MAGIC)) != MAGIC:
        return None
    first = _read_frame(file)
    if first is None:
        return None
    facts = json.loads(first)
    row_bytes = 8 * len(facts["columns"])
    starts: list[int] = []
    lengths: list[int] = []
    end = file.tell()
    while (payload := _read_frame(file)) is not None and len(payload) % row_bytes == 0:
        starts.append(end + _FRAME.size)
        lengths.append(len(payload))
        end = file.tell()
    return Journal(path, facts, tuple(starts), tuple(lengths), size - end)


def _read_frame(file: Any) -> bytes | None:
    """The payload of the next frame; None when it is cut off or damaged.

    A length of zero is damage too: after a power failure some file systems leave zeros at the end.
    """
    head = file.read(_FRAME.size)
    if len(head) < _FRAME.size:
        return None
    length, checksum = _FRAME.unpack(head)
    if not 0 < length <= _MAX_FRAME_BYTES:
        return None
    payload: bytes = file.read(length)
    return payload if len(payload) == length and zlib.crc32(payload) == checksum else None
