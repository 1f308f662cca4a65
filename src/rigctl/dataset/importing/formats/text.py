"""Reads the lines of a text file as UTF-8, for any encoding and line ends, in parts.

In: a file, perhaps compressed, in any encoding. Out: its lines, or pieces of some MiB that end with a
line, as UTF-8 with line feeds, for readers that know nothing else. What is UTF-8 already passes through
unchanged. Lengths are bounded: of a line, of blank stretches, and of what is held in memory, since a file
may be anything.
"""

from __future__ import annotations

import codecs
import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, cast

from rigctl.errors import Location, RigctlError, nearest_name
from rigctl.files.regular import regular

#: bytes of the file in memory at a time
PIECE: Final = 1 << 23
#: longest line of a table, bytes
LONGEST_LINE: Final = 1 << 20
#: bytes for detecting the encoding and the form of a file
HEAD: Final = 1 << 18
#: limit of consecutive blank lines
_MOST_BLANK: Final = 1_000_000

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


@dataclass(frozen=True)
class TextForm:
    """The encoding and line ends of a file.

    Parameters
    ----------
    encoding: its name in Python.
    mark: length of the byte-order mark, bytes.
    returns: lines end with only a carriage return, as on old Macintoshes.
    guessed: the encoding is a guess, as it is not UTF-8 and the file does not state it.
    """

    encoding: str
    mark: int = 0
    returns: bool = False
    guessed: bool = False


def find_form(path: Path, encoding: str | None) -> TextForm:
    """Detect how a file's text is stored from its first bytes, unless the caller specifies it.

    Raises
    ------
    RigctlError
        the file cannot be read, or the encoding does not exist.
    """
    with opened(path) as file:
        head = file.read(HEAD)
    # The order of `_MARKS` matters: the mark of UTF-16-LE is the beginning of that of UTF-32-LE.
    mark, marked = next(((len(mark), name) for mark, name in _MARKS if head.startswith(mark)), (0, None))
    option = _checked(encoding, path) if encoding else None
    # a mark gives the byte order, which 'utf-16' does not
    name = marked if marked and (option or marked).startswith(marked[:6]) else option or _without_mark(head)
    text = head[mark:].decode(name, "replace")
    returns = "\r" in text and "\n" not in text
    return TextForm(name, mark, returns, guessed=name == "cp1252" and not encoding)


def _checked(encoding: str, path: Path) -> str:
    try:
        name = codecs.lookup(encoding).name
        "".encode(name)
    except (LookupError, TypeError) as problem:
        known = (
            "utf-8",
            "utf-16",
            "cp1252",
            "latin-1",
            "cp437",
            "cp850",
            "mac-roman",
            "shift-jis",
            "gb18030",
        )
        raise RigctlError(
            "unknown encoding",
            value=encoding,
            expected=f"one of {', '.join(known)} …",
            nearest=nearest_name(encoding, known),
            where=Location(path),
        ) from problem
    return name


def _without_mark(head: bytes) -> str:
    """Guess UTF-8 if the bytes are valid; UTF-16 if every other one is zero; else the Windows encoding."""
    # Before UTF-8, which would accept zero bytes: Latin text in UTF-16 has one in every pair.
    even, odd = head[0::2].count(0), head[1::2].count(0)
    if 4 * (even + odd) > len(head) > 1:
        return "utf-16-le" if odd > even else "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open the file for its decompressed bytes, with clear errors."""
    compressed = path.suffix.lower() == ".gz"
    try:
        with open(path, "rb", opener=regular) as file:
            yield cast("IO[bytes]", gzip.GzipFile(fileobj=file)) if compressed else file
    except (gzip.BadGzipFile, EOFError, zlib.error) as problem:
        raise RigctlError("the file is damaged", expected="gzip", where=Location(path)) from problem
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise RigctlError(f"cannot read the file: {reason}", where=Location(path)) from problem


class Lines:
    """Reads the lines of an open file, counted from 1.

    Parameters
    ----------
    line: the number of the next line.
    """

    def __init__(self, path: Path, file: IO[bytes], form: TextForm) -> None:
        self._path = path
        self.line = 1
        file.read(form.mark)
        plain = form.encoding == "utf-8" and not form.returns
        self._file: IO[bytes] | io.BufferedReader = (
            file if plain else io.BufferedReader(_Utf8(file, form, path), 1 << 20)
        )

    def next(self) -> bytes:
        """Return the next line with its end; empty at the end of the file.

        Raises
        ------
        RigctlError
            the line is too long for a table.
        """
        line = self._file.readline(LONGEST_LINE)
        if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
            raise self._too_long()
        self.line += 1
        return line

    def skip(self, count: int) -> None:
        """Skip some lines."""
        for _ in range(count):
            self.next()

    def pieces(self) -> Iterator[tuple[int, bytes]]:
        """Yield whole lines, some MiB at a time, with the first one's number; blank stretches are omitted.

        Raises
        ------
        RigctlError
            a line is too long for a table, or a million of them are blank.
        """
        blank = 0
        while piece := self._file.read(PIECE):
            rest = self._file.readline(LONGEST_LINE)
            if len(rest) == LONGEST_LINE and not rest.endswith(b"\n"):
                self.line += piece.count(b"\n")
                raise self._too_long()
            piece += rest
            first, lines = self.line, piece.count(b"\n")
            self.line += lines
            if piece.strip():
                blank = 0
                yield first, piece.rstrip(b"\r\n")
            elif (blank := blank + lines) > _MOST_BLANK:
                raise RigctlError(
                    f"more than {_MOST_BLANK} blank lines", where=Location(self._path, first), expected="rows"
                )

    def _too_long(self) -> RigctlError:
        return RigctlError(
            f"the line is longer than {LONGEST_LINE >> 20} MiB",
            expected="rows of a table, each on a line",
            where=Location(self._path, self.line),
        )


class _Utf8(io.RawIOBase):
    """Converts text of another encoding to UTF-8 with line feeds while it is read."""

    def __init__(self, file: IO[bytes], form: TextForm, path: Path) -> None:
        self._file = file
        self._form = form
        self._path = path
        self._decoder = codecs.getincrementaldecoder(form.encoding)("replace" if form.guessed else "strict")
        self._left = b""
        self._ended = False

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill `buffer` partly; return the number of bytes, 0 at the end."""
        while not self._left and not self._ended:
            self._left = self._more()
        size = min(len(buffer), len(self._left))
        buffer[:size] = self._left[:size]
        self._left = self._left[size:]
        return size

    def _more(self) -> bytes:
        raw = self._file.read(1 << 18)
        self._ended = not raw
        try:
            text = self._decoder.decode(raw, final=self._ended)
        except UnicodeDecodeError as problem:
            raise not_text(self._path, self._form.encoding, None) from problem
        return (text.replace("\r", "\n") if self._form.returns else text).encode("utf-8")


def not_text(path: Path, encoding: str, line: int | None) -> RigctlError:
    """Return the error for bytes that are invalid in the encoding."""
    return RigctlError(
        f"the file is not {encoding.upper()} text",
        expected=encoding.upper(),
        hint="Say which encoding it is: --encoding cp1252, say",
        where=Location(path, line),
    )
