"""The samples of a run while it is being carried out: append-only, readable after a kill at any moment.

Layout of the file, all little-endian::

    magic       8 bytes   b"RIGJRNL2"
    frame 0     header    JSON: run, session, offset, columns
    frame 1…    header    rows of float64, one after another

    header      marker 8 bytes, number u32, first row u64, length u32,
                crc32 of the payload u32, crc32 of the header before it u32

A frame whose header or payload does not match its checksum is skipped: reading goes on at the next marker
behind which a whole frame lies. Each frame says which row of the journal it begins with, so that the rows
missing before it are counted.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

from rigctl.errors import ExitCode, Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAGIC: Final = b"RIGJRNL2"
#: of earlier versions, whose frames have a length and a checksum alone
_FIRST_MAGIC: Final = b"RIGJRNL1"
_FIRST_HEADER = struct.Struct("<II")
NAME: Final = "samples.journal"
#: begins every frame; no two bytes alike, so that no shifted copy of it matches
_MARKER: Final = b"\xa7RGJ\x1eF\x95\n"
_HEADER = struct.Struct("<8sIQII")
_CHECKSUM = struct.Struct("<I")
_HEADER_BYTES: Final = _HEADER.size + _CHECKSUM.size
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
        self._file = path.open("x+b", buffering=0)
        self._whole = 0  # bytes of the file that are whole frames
        self._frames = self._rows = 0
        first = json.dumps({**facts, "columns": list(columns)}, ensure_ascii=False).encode("utf-8")
        self._write(MAGIC, _frame_header(0, 0, first), first)

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
                        self._write(_frame_header(self._frames + 1, self._rows, payload), payload)
                        self._frames += 1
                        self._rows += len(payload) // (8 * self._width)
                        written = start + len(payload)
        finally:
            del self._waiting[:written]

    def sync(self) -> None:
        """Wait until what was flushed is on the disk itself: from here on a power failure loses none."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file without flushing; idempotent."""
        self._file.close()

    def in_place(self) -> bool:
        """False when what is written arrives in no folder any more: it was deleted, moved or unmounted."""
        return same_file(self._file, self.path)

    def take_over(self, other: JournalWriter, *, read_back: bool) -> None:
        """Go on where another journal cannot, with all that it has, or with what still waits."""
        content = everything_in(other._file) if read_back else None
        if content is not None:
            self._file.seek(0)
            write_fully(self._file, content)
            self._whole = len(content)
        self._frames, self._rows = other._frames, other._rows
        self._waiting = bytearray(other._waiting)

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


def same_file(file: Any, path: Path) -> bool:
    """Whether an open file is the one that a path leads to."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def everything_in(file: Any) -> bytes | None:
    """What an open file holds, even one that was deleted; None where it cannot be read any more."""
    try:
        file.seek(0)
        content: bytes = file.read()
        file.seek(0, os.SEEK_END)
    except OSError:
        return None
    return content


def _frame_header(number: int, first_row: int, payload: bytes | memoryview) -> bytes:
    head = _HEADER.pack(_MARKER, number, first_row, len(payload), zlib.crc32(payload))
    return head + _CHECKSUM.pack(zlib.crc32(head))


@dataclass(frozen=True)
class Frame:
    """One whole frame: its number, the row of the journal it begins with, and where its payload lies."""

    number: int
    first_row: int
    start: int
    length: int


@dataclass(frozen=True)
class Journal:
    """A journal as it is found on disk.

    Parameters
    ----------
    facts: the first frame: run, session, offset, columns; None when it is damaged.
    frames: the whole frames of rows, in order.
    lost_bytes: of damaged frames, and behind the last whole one.
    """

    path: Path
    facts: dict[str, Any] | None
    frames: tuple[Frame, ...]
    lost_bytes: int

    def blocks(self, width: int, rows: int = 1 << 17) -> Iterator[NDArray[np.float64]]:
        """The rows in order, as arrays of shape (`rows`, `width`); the last may be shorter.

        The division depends on the number of rows only, not on when they happened to be flushed.
        """
        import numpy as np

        size = rows * width * 8
        gathered = bytearray()
        with self.path.open("rb") as file:
            for frame in self.frames:
                file.seek(frame.start)
                gathered += file.read(frame.length)
                while len(gathered) >= size:
                    yield np.frombuffer(bytes(gathered[:size]), dtype="<f8").reshape(-1, width)
                    del gathered[:size]
        if gathered:
            yield np.frombuffer(bytes(gathered), dtype="<f8").reshape(-1, width)

    @property
    def damaged(self) -> bool:
        """Whether anything of it could not be read, its first frame included."""
        return self.facts is None or self.lost_bytes > 0

    def rows(self, width: int) -> int:
        """Number of whole rows of `width` values."""
        return sum(frame.length for frame in self.frames) // (8 * width)

    def lost_rows(self, width: int) -> int:
        """Rows that are missing before and between whole frames; how many after the last one is not known."""
        if not self.frames:
            return 0
        last = self.frames[-1]
        return last.first_row + last.length // (8 * width) - self.rows(width)


class JournalReader:
    """Follows a journal while another program writes it, from near its end on.

    Nothing of the writer's is waited for or locked. A frame that is still being written is read the next
    time; a damaged one is left out.

    Parameters
    ----------
    path: of the journal; it need not be there yet.
    most: bytes at the end of what is there that are read at first.
    """

    def __init__(self, path: Path, most: int = 1 << 23) -> None:
        self._path = path
        self._most = most
        self._file: BinaryIO | None = None
        self._at = 0
        self.facts: dict[str, Any] | None = None  #: the first frame; None before there is one

    def poll(self, most: int = 1 << 21) -> list[bytes]:
        """The payloads of the frames that have come since the last call, about `most` bytes of them.

        Each holds whole rows of float64. A new file in the same place, of a run that goes on, is begun with.
        """
        if not self._open():
            return []
        found: list[bytes] = []
        taken = 0
        while taken < most and (payload := self._next()) is not None:
            found.append(payload)
            taken += len(payload)
        return found

    def close(self) -> None:
        """Let the file go; idempotent."""
        if self._file is not None:
            self._file.close()
        self._file, self.facts = None, None

    def _open(self) -> bool:
        try:
            if self._file is not None and same_file(self._file, self._path):
                return True
            self.close()
            self._file = self._path.open("rb")
            if self._file.read(len(MAGIC)) != MAGIC:
                self.close()
                return False
            first, payload = _read_frame(self._file, len(MAGIC))
        except OSError:
            self.close()
            return False
        if first is None or first.number != 0:
            self.close()
            return False
        self.facts = json.loads(payload)
        begins = first.start + first.length
        size = os.fstat(self._file.fileno()).st_size
        near = size - self._most
        self._at = _next_marker(self._file, near, size) if near > begins else begins
        return True

    def _next(self) -> bytes | None:
        file = self._file
        assert file is not None  # noqa: S101 - it was opened just now
        frame, payload = _read_frame(file, self._at)
        if frame is None:
            size = os.fstat(file.fileno()).st_size
            after = _next_marker(file, self._at + 1, size)
            if after >= size:
                return None  # it is still being written
            frame, payload = _read_frame(file, after)
            if frame is None:
                return None
        self._at = frame.start + frame.length
        return payload


def read_journal(path: Path) -> Journal:
    """Find the whole frames of a journal, whatever lies between them.

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


def _scan(path: Path, file: BinaryIO) -> Journal:
    facts, frames = None, list[Frame]()
    at, size = len(MAGIC), path.stat().st_size
    if size < at:
        return Journal(path, None, (), size)
    magic = file.read(at)
    if magic == _FIRST_MAGIC:
        return _scan_first_format(path, file, size)
    lost = 0 if magic == MAGIC else at
    while at < size:
        frame, payload = _read_frame(file, at)
        if frame is None:
            after = _next_marker(file, at + 1, size)
            lost += after - at
            at = after
            continue
        if frame.number == 0:
            facts = json.loads(payload)
        elif not frames or frame.number > frames[-1].number:
            frames.append(frame)
        at = frame.start + frame.length
    return Journal(path, facts, tuple(frames), lost)


def _scan_first_format(path: Path, file: BinaryIO, size: int) -> Journal:
    """A journal that an earlier version has left: its frames up to the first damage."""
    facts, frames, rows, at = None, list[Frame](), 0, len(_FIRST_MAGIC)
    while len(head := file.read(_FIRST_HEADER.size)) == _FIRST_HEADER.size:
        length, checksum = _FIRST_HEADER.unpack(head)
        payload = file.read(length) if 0 < length <= _MAX_FRAME_BYTES else b""
        if not payload or len(payload) != length or zlib.crc32(payload) != checksum:
            break
        if facts is None:
            facts = json.loads(payload)
        else:
            frames.append(Frame(len(frames) + 1, rows, at + _FIRST_HEADER.size, length))
            rows += length // (8 * len(facts["columns"]))
        at += _FIRST_HEADER.size + length
    return Journal(path, facts, tuple(frames), size - at)


def _read_frame(file: BinaryIO, at: int) -> tuple[Frame | None, bytes]:
    """The frame that begins at a byte of the file; None when none does, or it is cut off or damaged."""
    file.seek(at)
    head = file.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES or not head.startswith(_MARKER):
        return None, b""
    (own,) = _CHECKSUM.unpack(head[_HEADER.size :])
    if zlib.crc32(head[: _HEADER.size]) != own:
        return None, b""
    _, number, first_row, length, checksum = _HEADER.unpack(head[: _HEADER.size])
    if length > _MAX_FRAME_BYTES:
        return None, b""
    payload = file.read(length)
    if len(payload) != length or zlib.crc32(payload) != checksum:
        return None, b""
    return Frame(number, first_row, at + _HEADER_BYTES, length), payload


def _next_marker(file: BinaryIO, at: int, size: int) -> int:
    """Where the next marker begins, from a byte of the file on; the file's end when there is none."""
    while at < size:
        file.seek(at)
        part = file.read(_FRAME_BYTES)
        found = part.find(_MARKER)
        if found >= 0:
            return at + found
        if len(part) < _FRAME_BYTES:
            break
        at += len(part) - len(_MARKER) + 1  # a marker may lie across the end of the part
    return size
