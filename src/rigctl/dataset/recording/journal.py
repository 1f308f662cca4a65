"""The journal: a run's samples while it is in progress, append-only and readable after a kill at any time.

Layout of the file, all little-endian::

    magic       8 bytes   b"RIGJRNL2"
    frame 0     header    JSON: run, session, offset, columns
    frame 1…    header    rows of float64, one after another

    header      marker 8 bytes, number u32, first row u64, length u32,
                crc32 of the payload u32, crc32 of the header before it u32

A frame whose header or payload does not match its checksum is skipped: reading continues at the next marker
that begins a complete frame. Each frame has the number of its first row in the journal, so that the rows
missing before it are counted.

The header has a checksum of its own, so that a damaged length is not believed: it would skip whatever
comes after it. A marker may also occur among the numbers of a payload; what follows it there is no header
with a right checksum, and the search goes on. See
docs/decisions/0045-journal-damage-affects-only-damaged-frames.md.
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
from rigctl.files.regular import regular
from rigctl.json_values import parse_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAGIC: Final = b"RIGJRNL2"
#: of earlier versions, whose frames have only a length and a checksum
_FIRST_MAGIC: Final = b"RIGJRNL1"
_FIRST_HEADER = struct.Struct("<II")
NAME: Final = "samples.journal"
#: begins every frame; all bytes differ, so that no shifted copy matches
_MARKER: Final = b"\xa7RGJ\x1eF\x95\n"
_HEADER = struct.Struct("<8sIQII")
_CHECKSUM = struct.Struct("<I")
_HEADER_BYTES: Final = _HEADER.size + _CHECKSUM.size
#: size of a frame; more rows are written as several frames
_FRAME_BYTES: Final = 1 << 18
#: longest plausible frame; anything longer is damage
_MAX_FRAME_BYTES: Final = 1 << 24


class JournalWriter:
    """Appends rows of float64 to a journal, buffered until `flush`.

    Parameters
    ----------
    path: the new file; must not exist.
    columns: names of the values in a row, in order.
    facts: other content of the first frame (run, session, time offset).
    """

    def __init__(self, path: Path, columns: Sequence[str], facts: dict[str, Any]) -> None:
        self.path = path
        self._pack = struct.Struct(f"<{len(columns)}d").pack
        self._width = len(columns)
        self._frame_bytes = _FRAME_BYTES - _FRAME_BYTES % (8 * len(columns))
        self._waiting = bytearray()
        self._file = path.open("x+b", buffering=0)
        self._whole = 0  # bytes of complete frames in the file
        self._frames = self._rows = 0
        first = json.dumps({**facts, "columns": list(columns)}).encode("utf-8")
        self._write(MAGIC, _frame_header(0, 0, first), first)

    @property
    def waiting(self) -> int:
        """Number of unflushed bytes."""
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
        """Pass all buffered rows to the operating system: a kill of the program then loses none.

        Raises
        ------
        OSError
            not all rows could be written. The file ends at its last complete frame; the others stay buffered.
        """
        # In pieces of `_FRAME_BYTES`: damage, or a full disk, costs one of them.
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
        """Wait until flushed rows are on the disk: a power failure then loses none."""
        os.fsync(self._file.fileno())

    @property
    def shortened(self) -> bool:
        """Whether the file has fewer bytes than were written: something else has truncated it."""
        return os.fstat(self._file.fileno()).st_size < self._whole

    def close(self) -> None:
        """Close the file without flushing; idempotent."""
        self._file.close()

    def in_place(self) -> bool:
        """Return False if the file's folder was deleted, moved or unmounted."""
        return same_file(self._file, self.path)

    def take_over(self, other: JournalWriter, *, read_back: bool) -> None:
        """Continue another journal, with all its rows or only the buffered ones."""
        content = whole_content(other._file) if read_back else None
        # Frame and row numbers go on in either case: a reader sees from them what is missing before the first
        # frame.
        if content is not None:
            self._file.seek(0)
            write_fully(self._file, content)
            self._whole = len(content)
        self._frames, self._rows = other._frames, other._rows
        self._waiting = bytearray(other._waiting)

    def _write(self, *parts: bytes | bytearray | memoryview) -> None:
        """Write all parts or none: a frame truncated by a full disk would hide every later one."""
        try:
            for part in parts:
                write_fully(self._file, part)
        except OSError:
            self._file.seek(self._whole)
            self._file.truncate()
            raise
        self._whole += sum(len(part) for part in parts)


def write_fully(file: Any, part: bytes | bytearray | memoryview) -> None:
    """Write all bytes to an unbuffered file, which may accept only part of them at a time."""
    written = file.write(part)
    while written < len(part):
        with memoryview(part) as view:
            more = file.write(view[written:])
        if not more:
            raise OSError("no bytes could be written")
        written += more


def same_file(file: Any, path: Path) -> bool:
    """Return whether an open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def whole_content(file: Any) -> bytes | None:
    """Return the content of an open file, even a deleted one; None if it can no longer be read."""
    try:
        file.seek(0)
        content: bytes = file.read()
    except OSError:
        return None
    return content


def _frame_header(number: int, first_row: int, payload: bytes | memoryview) -> bytes:
    head = _HEADER.pack(_MARKER, number, first_row, len(payload), zlib.crc32(payload))
    return head + _CHECKSUM.pack(zlib.crc32(head))


@dataclass(frozen=True)
class Frame:
    """One complete frame: its number, its first row in the journal, and the position of its payload."""

    number: int
    first_row: int
    start: int
    length: int


@dataclass(frozen=True)
class Journal:
    """A journal as found on disk.

    Parameters
    ----------
    facts: the first frame: run, session, offset, columns; None if it is damaged.
    frames: the complete frames of rows, in order.
    lost_bytes: of damaged frames, and after the last complete one.
    """

    path: Path
    facts: dict[str, Any] | None
    frames: tuple[Frame, ...]
    lost_bytes: int

    def blocks(self, width: int, rows: int) -> Iterator[NDArray[np.float64]]:
        """Yield the rows in order, as arrays of shape (`rows`, `width`); the last may be shorter.

        The division depends only on the number of rows, not on when they were flushed.
        """
        import numpy as np

        size = rows * width * 8
        gathered = bytearray()
        with open(self.path, "rb", opener=regular) as file:
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
        """Whether any part could not be read, including the first frame."""
        return self.facts is None or self.lost_bytes > 0

    def rows(self, width: int) -> int:
        """Return the number of complete rows of `width` values."""
        return sum(frame.length for frame in self.frames) // (8 * width)

    def lost_rows(self, width: int) -> int:
        """Return the number of rows missing before or between complete frames, but not after the last."""
        if not self.frames:
            return 0
        last = self.frames[-1]
        return last.first_row + last.length // (8 * width) - self.rows(width)


class JournalReader:
    """Follows a journal while another program writes it, starting near its end.

    It neither waits for nor locks the writer. A frame that is still being written is read the next time; a
    damaged one is skipped.

    Parameters
    ----------
    path: of the journal, which need not exist yet.
    most: bytes at the end of the existing file that are read first.
    """

    def __init__(self, path: Path, most: int = 1 << 23) -> None:
        self._path = path
        self._most = most
        self._file: BinaryIO | None = None
        self._at: int  # of the next frame, in the open file
        self.facts: dict[str, Any] | None = None  #: the first frame; None until there is one

    def poll(self, most: int = 1 << 21) -> list[bytes]:
        """Return the payloads of the frames added since the last call, about `most` bytes at most.

        Each has complete rows of float64. A new file at the same path, of a resumed run, is read from its
        start.
        """
        if not self._open():
            return []
        payloads: list[bytes] = []
        taken = 0
        while taken < most and (payload := self._next()) is not None:
            payloads.append(payload)
            taken += len(payload)
        return payloads

    def close(self) -> None:
        """Close the file; idempotent."""
        if self._file is not None:
            self._file.close()
        self._file, self.facts = None, None

    def _open(self) -> bool:
        try:
            if self._file is not None and same_file(self._file, self._path):
                return True
            self.close()
            self._file = open(self._path, "rb", opener=regular)  # noqa: SIM115
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
        self.facts = parse_json(payload)
        # A long journal is entered at the first marker near its end: earlier rows are of no interest to an
        # observer.
        begins = first.start + first.length
        size = os.fstat(self._file.fileno()).st_size
        near = size - self._most
        self._at = _next_marker(self._file, near, size) if near > begins else begins
        return True

    def _next(self) -> bytes | None:
        file = self._file
        assert file is not None  # noqa: S101 - it was opened just now
        at, size = self._at, os.fstat(file.fileno()).st_size
        frame, payload = _read_frame(file, at)
        while frame is None:
            # Damage, or the end of what has been written so far? Only a later marker tells: the writer
            # appends in order.
            at = _next_marker(file, at + 1, size)
            if at >= size:
                return None  # still being written
            frame, payload = _read_frame(file, at)
        self._at = frame.start + frame.length
        return payload


def read_journal(path: Path) -> Journal:
    """Find the complete frames of a journal, with anything between them.

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    try:
        with open(path, "rb", opener=regular) as file:
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
            facts = parse_json(payload)
        # A frame whose number does not rise is a copy of an earlier one: its rows would count twice.
        elif not frames or frame.number > frames[-1].number:
            frames.append(frame)
        at = frame.start + frame.length
    return Journal(path, facts, tuple(frames), lost)


def _scan_first_format(path: Path, file: BinaryIO, size: int) -> Journal:
    """Read a journal of an earlier version: its frames up to the first damage."""
    facts, frames, rows, at = None, list[Frame](), 0, len(_FIRST_MAGIC)
    while len(head := file.read(_FIRST_HEADER.size)) == _FIRST_HEADER.size:
        length, checksum = _FIRST_HEADER.unpack(head)
        payload = file.read(length) if length <= _MAX_FRAME_BYTES else b""
        if not payload or len(payload) != length or zlib.crc32(payload) != checksum:
            break
        if facts is None:
            facts = parse_json(payload)
        else:
            frames.append(Frame(len(frames) + 1, rows, at + _FIRST_HEADER.size, length))
            rows += length // (8 * len(facts["columns"]))
        at += _FIRST_HEADER.size + length
    return Journal(path, facts, tuple(frames), size - at)


def _read_frame(file: BinaryIO, at: int) -> tuple[Frame | None, bytes]:
    """Return the frame that begins at a byte of the file; None without a complete, intact frame."""
    file.seek(at)
    head = file.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES:
        return None, b""
    (header_checksum,) = _CHECKSUM.unpack(head[_HEADER.size :])
    if zlib.crc32(head[: _HEADER.size]) != header_checksum:
        return None, b""
    _, number, first_row, length, checksum = _HEADER.unpack(head[: _HEADER.size])
    if length > _MAX_FRAME_BYTES:
        return None, b""
    payload = file.read(length)
    if len(payload) != length or zlib.crc32(payload) != checksum:
        return None, b""
    return Frame(number, first_row, at + _HEADER_BYTES, length), payload


def _next_marker(file: BinaryIO, at: int, size: int) -> int:
    """Return the position of the next marker from a byte of the file on; the file's end if there is none."""
    while True:
        file.seek(at)
        part = file.read(_FRAME_BYTES)
        offset = part.find(_MARKER)
        if offset >= 0:
            return at + offset
        if len(part) < _FRAME_BYTES:
            return size
        at += len(part) - len(_MARKER) + 1  # a marker may span two parts
