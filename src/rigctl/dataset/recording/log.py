"""The log: everything that happened in a run, one JSON object per line, append-only.

The first line is the run's header; sessions, records, measures, commands, alarms and the end follow. Each
line ends with the field ``crc``, the hexadecimal CRC-32 of the line before that field, since a line with a
digit corrupted on disk is still valid JSON. A last line truncated by a kill is ignored.
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

from rigctl.dataset.recording.journal import same_file, whole_content, write_fully
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular

NAME: Final = "log.jsonl"
#: the end of a line with a checksum
_CRC: Final = re.compile(rb',"crc":"([0-9a-f]{8})"\}$')


def _as_plain(value: object) -> object:
    """Convert types unknown to JSON: NumPy scalars and arrays to numbers, everything else to text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


_encode = json.JSONEncoder(
    ensure_ascii=False, allow_nan=False, check_circular=False, separators=(",", ":"), default=_as_plain
).encode


def encode_line(fields: Mapping[str, Any]) -> str:
    """Encode one line of JSON; NaN and infinity, which JSON does not have, become null."""
    try:
        return _encode(fields)
    except ValueError:
        return _encode(_without_nan(fields))


def protected_line(fields: Mapping[str, Any]) -> bytes:
    """Return one line of the file, with its checksum and without its line end."""
    # file names may contain surrogates, which must not prevent logging
    text = encode_line(fields)[:-1].encode("utf-8", "backslashreplace")
    return b'%s,"crc":"%08x"}' % (text, crc32(text))


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
    """Appends lines to a log, buffered until `flush`.

    An existing log is continued after its last complete line.
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
        """Pass all buffered lines to the operating system.

        Raises
        ------
        OSError
            they could not be written. The file ends at its last complete line; the lines stay buffered.
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
        """Wait until flushed lines are on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file without flushing; idempotent."""
        self._file.close()

    def in_place(self) -> bool:
        """Return False if the file's folder was deleted, moved or unmounted."""
        return same_file(self._file, self.path)

    def take_over(self, other: LogWriter, *, read_back: bool, otherwise: bytes) -> None:
        """Continue another log, with all its lines, or with `otherwise` and the buffered lines."""
        content = whole_content(other._file) if read_back else None
        content = otherwise if content is None else content
        self._file.truncate(0)
        write_fully(self._file, content)
        self._whole = len(content)
        self._waiting = list(other._waiting)


def whole_length(path: Path) -> int:
    """Return the number of bytes up to the end of the last complete line."""
    with open(path, "rb", opener=regular) as file:
        return file.read().rfind(b"\n") + 1


def read_lines(path: Path) -> list[dict[str, Any] | None]:
    """Read the complete lines of a file of JSON objects, without their checksums; None for a damaged line.

    Lines of earlier versions have no checksum; after the first line with one, every line must have one.

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    try:
        with open(path, "rb", opener=regular) as file:
            content = file.read()
    except OSError as problem:
        raise RigctlError(
            f"cannot read the file: {problem.strerror}", where=Location(path), exit_code=ExitCode.FAILED
        ) from problem
    lines = content.split(b"\n")[:-1]  # after the last one is what a kill has truncated
    # Otherwise a damaged checksum would make its line look like one of an earlier version, and be believed.
    first = next((index for index, line in enumerate(lines) if _CRC.search(line)), len(lines))
    return [_read_line(line, protected=index >= first) for index, line in enumerate(lines)]


class LogReader:
    """Follows a log while another program writes it, starting near its end.

    Parameters
    ----------
    path: of the log, which need not exist yet.
    most: bytes at the end of the existing file that are read first.
    """

    def __init__(self, path: Path, most: int = 1 << 18) -> None:
        self._path = path
        self._most = most
        self._at: int | None = None

    def poll(self) -> list[dict[str, Any]]:
        """Return the complete lines added since the last call; damaged ones are skipped."""
        try:
            with open(self._path, "rb", opener=regular) as file:
                if self._at is None:  # it may be inside a line, the rest of which counts as damaged
                    self._at = max(file.seek(0, os.SEEK_END) - self._most, 0)
                file.seek(self._at)
                content = file.read(4 * self._most)
        except OSError:
            return []
        complete = content[: content.rfind(b"\n") + 1]
        self._at += len(complete)
        lines = (_read_line(line, protected=True) for line in complete.split(b"\n")[:-1])
        return [line for line in lines if line is not None]


def _read_line(line: bytes, *, protected: bool) -> dict[str, Any] | None:
    if protected:
        match = _CRC.search(line)
        if match is None or crc32(line[: match.start()]) != int(match.group(1), 16):
            return None
        line = line[: match.start()] + b"}"
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return fields if isinstance(fields, dict) and "crc" not in fields else None
