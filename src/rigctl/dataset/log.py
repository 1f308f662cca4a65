"""Everything that happened in a run, one JSON object per line, append-only.

The first line is the run's header; sessions, records, measures, commands, alarms and the end follow. Each
line ends with the field ``crc``, the CRC-32 of the line before that field in hexadecimal digits: a digit that
a bad disk has changed is still JSON. A last line that was cut off by a kill is ignored.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from zlib import crc32

from rigctl.dataset.journal import everything_in, same_file, write_fully
from rigctl.errors import ExitCode, Location, RigctlError

NAME: Final = "log.jsonl"
#: how a line with a checksum ends
_CRC: Final = re.compile(rb',"crc":"([0-9a-f]{8})"\}$')


def _as_plain(value: object) -> object:
    """What JSON does not know: numpy scalars and arrays become numbers, everything else its text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


_encode = json.JSONEncoder(
    ensure_ascii=False, allow_nan=False, check_circular=False, separators=(",", ":"), default=_as_plain
).encode


def encode_line(fields: Mapping[str, Any]) -> str:
    """One line of JSON; NaN and infinity, which JSON does not have, become null."""
    try:
        return _encode(fields)
    except ValueError:
        return _encode(_without_nan(fields))


def protected_line(fields: Mapping[str, Any]) -> bytes:
    """One line of the file, with its checksum and without its end."""
    # surrogates can come from names of files; they must not keep a run from being logged
    said = encode_line(fields)[:-1].encode("utf-8", "backslashreplace")
    return b'%s,"crc":"%08x"}' % (said, crc32(said))


def _without_nan(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return value


class LogWriter:
    """Appends lines to a log; they wait in memory until `flush`.

    An existing log is continued after its last whole line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._waiting: list[bytes] = []
        self._file = path.open("a+b", buffering=0)
        self._whole = whole_length(path)
        self._file.truncate(self._whole)

    def append(self, fields: Mapping[str, Any]) -> None:
        """Add one line."""
        self._waiting.append(protected_line(fields))

    def flush(self) -> None:
        """Hand every waiting line to the operating system.

        Raises
        ------
        OSError
            they could not be written. The file ends at its last whole line, the lines still wait.
        """
        if not self._waiting:
            return
        content = b"\n".join(self._waiting) + b"\n"
        try:
            write_fully(self._file, content)
        except OSError:
            self._file.truncate(self._whole)
            raise
        self._whole += len(content)
        self._waiting.clear()

    def sync(self) -> None:
        """Wait until what was flushed is on the disk itself."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file without flushing; idempotent."""
        self._file.close()

    def in_place(self) -> bool:
        """False when what is written arrives in no folder any more."""
        return same_file(self._file, self.path)

    def take_over(self, other: LogWriter, *, read_back: bool, otherwise: bytes) -> None:
        """Go on where another log cannot; with all that it has, or `otherwise` and what still waits."""
        content = everything_in(other._file) if read_back else None
        content = otherwise if content is None else content
        self._file.truncate(0)
        write_fully(self._file, content)
        self._whole = len(content)
        self._waiting = list(other._waiting)


def whole_length(path: Path) -> int:
    """Number of bytes up to the end of the last whole line."""
    return path.read_bytes().rfind(b"\n") + 1


def read_lines(path: Path) -> list[dict[str, Any] | None]:
    """The whole lines of a file of JSON objects, without their checksums; None for one that is damaged.

    Lines of earlier versions have no checksum; behind the first line that has one, every line must.

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise RigctlError(
            f"cannot read the file: {problem.strerror}", where=Location(path), exit_code=ExitCode.FAILED
        ) from problem
    lines = content[: content.rfind(b"\n") + 1].split(b"\n")[:-1]
    first = next((place for place, line in enumerate(lines) if _CRC.search(line)), len(lines))
    return [_read_line(line, protected=place >= first) for place, line in enumerate(lines)]


class LogReader:
    """Follows a log while another program writes it, from near its end on.

    Parameters
    ----------
    path: of the log; it need not be there yet.
    most: bytes at the end of what is there that are read at first.
    """

    def __init__(self, path: Path, most: int = 1 << 18) -> None:
        self._path = path
        self._most = most
        self._at: int | None = None

    def poll(self) -> list[dict[str, Any]]:
        """The whole lines that have come since the last call; a damaged one is left out."""
        try:
            with self._path.open("rb") as file:
                if self._at is None:
                    self._at = max(file.seek(0, os.SEEK_END) - self._most, 0)
                    file.seek(self._at)
                    self._at += len(file.readline()) if self._at else 0  # it may begin within a line
                file.seek(self._at)
                content = file.read(4 * self._most)
        except OSError:
            return []
        whole = content[: content.rfind(b"\n") + 1]
        self._at += len(whole)
        lines = (_read_line(line, protected=True) for line in whole.split(b"\n")[:-1])
        return [line for line in lines if line is not None]


def _read_line(line: bytes, *, protected: bool) -> dict[str, Any] | None:
    if protected:
        found = _CRC.search(line)
        if found is None or crc32(line[: found.start()]) != int(found.group(1), 16):
            return None
        line = line[: found.start()] + b"}"
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return fields if isinstance(fields, dict) and "crc" not in fields else None
