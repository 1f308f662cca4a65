"""Reads the lines that others append to a file, as far as they are complete."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigctl.files.regular import regular

#: longest line that is read, bytes with its end
LONGEST_LINE: Final = 4096
_MOST_AT_ONCE: Final = 64 * LONGEST_LINE


class AppendedLines:
    """The lines appended to a file since this object was made.

    Everybody with write access to the folder can append, so that a line of any length or content must not
    delay or hide the lines after it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = _size(path)
        self._skipping = False  # the rest of a line that is too long

    def read(self) -> list[bytes]:
        """The complete lines since the last call, without their ends; longer ones are left out.

        Raises
        ------
        OSError
            the file cannot be read; one that does not exist has no lines.
        """
        if _size(self._path) <= self._offset:
            return []
        with open(self._path, "rb", opener=regular) as file:
            file.seek(self._offset)
            content = file.read(_MOST_AT_ONCE)
        *lines, rest = content.split(b"\n")
        if len(rest) >= LONGEST_LINE:
            self._offset += len(content)
        else:
            self._offset += len(content) - len(rest)
        complete = lines[1:] if self._skipping and lines else lines
        self._skipping = len(rest) >= LONGEST_LINE or (self._skipping and not lines)
        return [line for line in complete if len(line) < LONGEST_LINE]


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
