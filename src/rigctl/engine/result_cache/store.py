"""The folder of kept results: one file each, complete or absent, within a limited total size.

In: a name, which is the hash of all that a result depends on, with a tree of plain values and arrays.
Out: the same, or nothing. Nothing is ever invalidated: what depends on something else has another name,
and the least recently used go when there is no room.

A cache must not be able to do harm. A file holds JSON and numbers, never pickles; one that is damaged, or
that another user could have written, counts as absent. Failing to write costs only time. Several
processes use the folder without locks, because a file appears by one rename.
"""

from __future__ import annotations

import io
import json
import logging
import os
import tempfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.engine.cache import cache_root
from rigctl.engine.result_cache.coding import DTYPES, Damaged
from rigctl.files.private import is_private, private_folder
from rigctl.files.regular import read_bytes

logger = logging.getLogger(__name__)

#: environment variable with another folder than the one in the user's cache; ``off`` keeps nothing
RESULTS_VARIABLE = "RIGCTL_RESULTS"
OFF = "off"

#: largest total size of all results, and of one of them, in bytes
ROOM, ROOM_OF_ONE = 512 * 2**20, 64 * 2**20
#: share of the total size that is freed when old results are deleted
_SLACK = 0.1
#: share of the total size that a process writes before it looks again for what to delete: listing thousands
#: of files after each result took a twentieth of a diagnosis
_UNCOUNTED = 0.02
#: bytes that this process has written since it last looked, by folder
_written: dict[Path, int] = {}
#: version of the file format; another version has another name
_LAYOUT = 1
_MEMBERS = ("tree", "numbers", "counts", "marks")
_DAY = 86_400.0


def results_folder() -> Path | None:
    """The folder of results; None if none are kept."""
    chosen = os.environ.get(RESULTS_VARIABLE)
    if chosen == OFF:
        return None
    return Path(chosen) if chosen else cache_root().parent / "results"


@dataclass(frozen=True)
class Store:
    """A folder of results, which several processes may use at once.

    A file appears by one atomic rename. A damaged, foreign or missing one counts as absent, and so does one
    that others could have written; a folder that cannot be written costs only a line in the log.
    """

    folder: Path
    room: int = ROOM
    room_of_one: int = ROOM_OF_ONE

    def read(self, name: str) -> tuple[Any, Iterator[np.ndarray]] | None:
        """The tree and the arrays kept under `name`, or None."""
        path = self._path(name)
        try:
            if path.stat().st_size > self.room_of_one:
                return None
            private_folder(self.folder)
            if not is_private(path):
                raise PermissionError("other users can change it")
            content = _unpack(read_bytes(path), name)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as problem:
            logger.info("the kept result %s is not readable and is made again: %r", path, problem)
            return None
        with suppress(OSError):
            os.utime(path)  # mark it as recently used
        return content

    def write(self, name: str, tree: Any, arrays: list[np.ndarray]) -> None:
        """Keep a tree and its arrays under `name`, unless they are too large."""
        if sum(array.nbytes for array in arrays) > self.room_of_one:
            return
        content = _pack(name, tree, arrays)
        if len(content) > min(self.room_of_one, self.room):
            return
        try:
            private_folder(self.folder)
            _put(self._path(name), content)
        except OSError as problem:  # a full or read-only disk, or on Windows a file that is being read
            logger.info("a result could not be kept in %s: %s", self.folder, problem)
            return
        written = _written.get(self.folder, self.room) + len(content)  # at first it looks at once
        if written > _UNCOUNTED * self.room:
            self._tidy()
            written = 0
        _written[self.folder] = written

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npz"

    def _tidy(self) -> None:
        """Delete the least recently used results if there is no room, and what killed processes left."""
        known, total = [], 0
        with suppress(OSError):
            for entry in os.scandir(self.folder):
                with suppress(OSError):
                    facts = entry.stat()
                    if entry.name.endswith(".npz") and not entry.name.startswith("."):
                        known.append((facts.st_mtime, facts.st_size, entry.path))
                        total += facts.st_size
                    elif entry.name.endswith(".tmp") and facts.st_mtime < time.time() - _DAY:
                        Path(entry.path).unlink()
        if total <= self.room:
            return
        for _, size, path in sorted(known):
            with suppress(OSError):
                Path(path).unlink()
            total -= size
            if total <= (1.0 - _SLACK) * self.room:
                return


def _put(path: Path, content: bytes) -> None:
    """Write beside the file and rename: a reader sees all of it or nothing."""
    handle, written = tempfile.mkstemp(prefix=".", suffix=".tmp", dir=path.parent)
    temporary = Path(written)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def _pack(name: str, tree: Any, arrays: list[np.ndarray]) -> bytes:
    """An uncompressed .npz: the tree as JSON, and the arrays' numbers, those of one kind in a row."""
    shapes = [[DTYPES.index(array.dtype.str), list(array.shape)] for array in arrays]
    text = json.dumps({"layout": _LAYOUT, "name": name, "arrays": shapes, "tree": tree})
    members = [np.frombuffer(text.encode(), dtype=np.uint8)]
    for kind in DTYPES:
        same = [array.ravel() for array in arrays if array.dtype.str == kind]
        members.append(np.concatenate([np.empty(0, dtype=kind), *same]))
    into = io.BytesIO()
    with zipfile.ZipFile(into, "w", zipfile.ZIP_STORED) as file:
        for label, member in zip(_MEMBERS, members, strict=True):
            with file.open(f"{label}.npy", "w", force_zip64=True) as stream:
                np.save(stream, member, allow_pickle=False)
    return into.getvalue()


def _unpack(content: bytes, name: str) -> tuple[Any, Iterator[np.ndarray]]:
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        if any(info.compress_type != zipfile.ZIP_STORED for info in file.infolist()):
            raise Damaged("what is compressed may be larger than there is room for")
    with np.load(io.BytesIO(content), allow_pickle=False) as file:  # verifies the file's checksums
        header = json.loads(file["tree"].tobytes().decode())
        numbers = [file[label] for label in _MEMBERS[1:]]
    if header["layout"] != _LAYOUT or header["name"] != name:
        raise Damaged("it is another result")
    if [array.dtype.str for array in numbers] != list(DTYPES) or any(array.ndim != 1 for array in numbers):
        raise Damaged("its numbers are of another kind")
    arrays, offsets = [], [0] * len(DTYPES)
    for kind, shape in header["arrays"]:
        count = int(np.prod(shape, dtype=np.int64))
        piece = numbers[kind][offsets[kind] : offsets[kind] + count]
        offsets[kind] += count
        arrays.append(piece.reshape(shape).copy())
    return header["tree"], iter(arrays)
