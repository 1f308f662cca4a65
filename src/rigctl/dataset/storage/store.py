"""A runs folder at a storage address, and the folder of one run in it.

In: an address of `fsspec`, and requests. Out: listings, ``run.json`` of many runs at once, files.
Whatever a storage or its library may raise becomes one kind of error (`answering`), since a storage that
is silent must never be taken for one without runs.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any, Final, Self

from rigctl.dataset import run_json
from rigctl.dataset.day_folders import is_shard
from rigctl.dataset.run_id import LATEST, chosen_id
from rigctl.dataset.storage.failure import describe
from rigctl.errors import ExitCode, Location, RigctlError

#: time-outs of storage for a connection, and for the next bytes, s
CONNECTS_WITHIN: Final = 10.0
ANSWERS_WITHIN: Final = 20.0
#: attempts per request
_ATTEMPTS: Final = 3
_BLOCK: Final = 1 << 20


class StorageSilent(RigctlError):
    """A storage refuses, stalls, or sends an unexpected answer."""


#: fields of version marks of an object; the first that exists is used
_MARKS: Final = (
    "ETag",
    "etag",
    "md5Hash",
    "content_hash",
    "mtime",
    "LastModified",
    "last_modified",
    "created",
)


class Store:
    """A runs folder at an address of `fsspec`.

    Parameters
    ----------
    address: ``s3://bucket/runs``, ``memory://runs``, ``file:///data/runs``. Credentials are those of the
        storage's library: for S3 the usual environment variables and files of AWS.

    Raises
    ------
    RigctlError
        the library for such addresses is not installed.
    """

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")
        try:
            from fsspec.core import url_to_fs

            self.files, self._root = url_to_fs(self.address, **_options(address))
            if hasattr(self.files, "retries"):
                self.files.retries = 1  # its own errors, beside those of the library that it uses
        except ImportError as problem:
            raise RigctlError(
                f"the package for this storage is not installed: {problem}",
                value=address,
                hint="pip install 'rigctl[storage]'",
            ) from problem
        except ValueError as problem:
            raise RigctlError(f"not a storage address: {problem}", value=address) from problem

    @cached_property
    def arrow(self) -> Any:
        """The storage as an Arrow file system."""
        from pyarrow.fs import FSSpecHandler, PyFileSystem

        return PyFileSystem(FSSpecHandler(self.files))

    def folder(self, run_id: str) -> StoredFolder:
        """Return the folder of a run, which need not exist."""
        return StoredFolder(self, run_id)

    def ids(self) -> list[str]:
        """Return the names of the folders, oldest run first; one may be an upload that is not complete.

        Raises
        ------
        RigctlError
            the storage does not respond, or refuses.
        """
        with self.answering("list the runs"):
            try:
                entries = self.files.ls(self._root, detail=True)
            except FileNotFoundError:
                return []
        folders = [facts["name"] for facts in entries if facts["type"] == "directory"]
        names = [path.rstrip("/").rpartition("/")[2] for path in folders]
        return sorted(name for name in names if name and not name.startswith(".") and not is_shard(name))

    def newest(self) -> str | None:
        """Return the id of the newest complete run; None if there is none.

        Raises
        ------
        RigctlError
            the storage does not respond, or refuses.
        """
        complete = (name for name in reversed(self.ids()) if (self.folder(name) / run_json.NAME).size())
        return next(complete, None)

    def states(self) -> dict[str, tuple[int, str]]:
        """Return the length and version mark of each run's ``run.json``, from one listing; oldest run first.

        Raises
        ------
        RigctlError
            the storage does not respond, or refuses.
        """
        with self.answering("list the runs"):
            try:
                objects = self.files.find(self._root, detail=True)
            except (FileNotFoundError, NotADirectoryError):
                return {}
        states: dict[str, tuple[int, str]] = {}
        depth = len(_parts(self._root))
        for path, facts in objects.items():
            run_id, *rest = _parts(path)[depth:] or [""]
            if rest == [run_json.NAME] and not run_id.startswith(".") and not is_shard(run_id):
                mark = next((f"{name} {facts[name]}" for name in _MARKS if facts.get(name)), "")
                states[run_id] = (int(facts.get("size") or 0), mark)
        return dict(sorted(states.items()))

    def infos(self, ids: Iterable[str]) -> dict[str, tuple[int, dict[str, Any] | None]]:
        """Return ``run.json`` of each run, requested together, with its length; None if it is damaged.

        A run without one is omitted, since it is sent last.

        Raises
        ------
        RigctlError
            the storage does not respond, or refuses.
        """
        names = list(ids)
        if not names:
            return {}
        paths = [self.path(run_id, run_json.NAME) for run_id in names]
        with self.answering("read the runs"):
            # 'cat' of several paths would interpret '[' and '*' in them as patterns
            answers = self.files.cat_ranges(paths, None, None, on_error="return")
        infos: dict[str, tuple[int, dict[str, Any] | None]] = {}
        for run_id, content in zip(names, answers, strict=True):
            if isinstance(content, FileNotFoundError | NotADirectoryError):
                continue  # incomplete upload: not a run yet
            if isinstance(content, BaseException):
                with self.answering("read the runs"):
                    raise content
            try:
                info = run_json.read_text(content.decode("utf-8"), self.folder(run_id))
            except (RigctlError, UnicodeDecodeError):
                info = None
            infos[run_id] = (len(content), info)
        return infos

    def find(self, ref: str) -> StoredFolder:
        """Return the run with an id or an unambiguous start of one; ``latest`` for the newest.

        Raises
        ------
        RigctlError
            there is none, or the start is ambiguous.
        """
        ids = self.ids() if ref != LATEST else [name for name in [self.newest()] if name is not None]
        if not ids:
            raise RigctlError("there are no runs in this storage", value=self.address)
        return self.folder(chosen_id(ref, ids, shown=f"{self.address}/{ref}"))

    def path(self, run_id: str, name: str) -> str:
        """Return the library's path of a run's file."""
        return f"{self._root.rstrip('/')}/{run_id}/{name}"

    @contextmanager
    def answering(self, doing: str) -> Iterator[None]:
        """Turn an error of the storage into a one-sentence message."""
        try:
            yield
        except (RigctlError, FileNotFoundError, KeyboardInterrupt):
            raise
        except Exception as problem:
            # each storage library has its own errors
            why, hint = describe(problem)
            raise StorageSilent(
                f"cannot {doing}: {why}",
                hint=hint,
                where=Location(self.address),
                exit_code=ExitCode.FAILED,
            ) from problem


class StoredFolder:
    """The folder of one run in a `Store`, for reading."""

    def __init__(self, store: Store, name: str) -> None:
        self.store, self.name = store, name

    def __truediv__(self, name: str) -> StoredFile:
        """Return a file in it."""
        return StoredFile(self, name)

    def __fspath__(self) -> str:
        """Return its address."""
        return f"{self.store.address}/{self.name}"

    __str__ = __fspath__

    def __repr__(self) -> str:
        return f"StoredFolder({str(self)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, StoredFolder) and str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __deepcopy__(self, _: object) -> StoredFolder:
        return self

    @cached_property
    def info(self) -> dict[str, Any]:
        """``run.json``, as of the first request.

        Raises
        ------
        RigctlError
            it is missing or damaged, or the storage does not respond.
        """
        text = (self / run_json.NAME).read().decode("utf-8", errors="replace")
        return run_json.read_text(text, self)


class StoredFile:
    """One file of a run in a `Store`."""

    def __init__(self, folder: StoredFolder, name: str) -> None:
        self.folder, self.name = folder, name

    def __str__(self) -> str:
        """Return its address."""
        return f"{self.folder}/{self.name}"

    @property
    def _path(self) -> str:
        return self.folder.store.path(self.folder.name, self.name)

    def size(self) -> int | None:
        """Return the size in bytes; None if there is no such file."""
        store = self.folder.store
        with store.answering(f"look at {self.name} of {self.folder.name}"):
            try:
                return int(store.files.info(self._path)["size"])
            except FileNotFoundError:
                return None

    def read(self) -> bytes:
        """Return the whole content.

        Raises
        ------
        RigctlError
            there is none, or the storage does not respond.
        """
        store = self.folder.store
        with store.answering(f"read {self.name} of {self.folder.name}"):
            try:
                content: bytes = store.files.cat_file(self._path)
            except FileNotFoundError as problem:
                raise RigctlError("not a run: the file is missing in storage", value=str(self)) from problem
        return content

    def open(self) -> Any:
        """Open the file for reading in blocks.

        Raises
        ------
        RigctlError
            it is missing or has the wrong length, or the storage does not respond.
        """
        size, known = self.size(), self._known()
        if size is None or (known is not None and size != known):
            raise RigctlError(
                "the object is missing in storage" if size is None else "the object in storage is incomplete",
                value=str(self) if size is None else f"{size} bytes",
                expected=None if known is None else f"{known} bytes",
                hint=f"'rigctl runs upload {self.folder.name}' where it was recorded sends it again",
                exit_code=ExitCode.FAILED,
            )
        store = self.folder.store
        doing = f"read {self.name} of {self.folder.name}"
        with store.answering(doing):
            opened = store.files.open(self._path, "rb", block_size=_BLOCK, cache_type="readahead")
        return _OpenFile(opened, store, doing)

    def _known(self) -> int | None:
        """Return its size according to the run's ``run.json``."""
        facts = self.folder.info.get("files", {}).get(self.name)
        return None if facts is None else int(facts["bytes"])

    def facts(self) -> dict[str, Any] | None:
        """Return the size and SHA-256, read back from storage; None if there is no such file."""
        store, digest, size = self.folder.store, hashlib.sha256(), 0
        with store.answering(f"read {self.name} of {self.folder.name} back"):
            try:
                with store.files.open(self._path, "rb", block_size=_BLOCK, cache_type="readahead") as file:
                    while block := file.read(_BLOCK):
                        digest.update(block)
                        size += len(block)
            except FileNotFoundError:
                return None
        return {"sha256": digest.hexdigest(), "bytes": size}

    def create(self, content: bytes) -> bytes:
        """Write the file unless it exists, and return its content afterwards."""
        store = self.folder.store
        with store.answering(f"reserve the name {self.folder.name}"):
            store.files.makedirs(self._path.rpartition("/")[0], exist_ok=True)
            with suppress(FileExistsError):
                try:
                    store.files.pipe_file(self._path, content, mode="create")
                except (TypeError, ValueError, NotImplementedError, OSError):
                    if not store.files.exists(self._path):  # a storage without conditional writes
                        store.files.pipe_file(self._path, content)
        return self.read()

    def send(self, path: str) -> None:
        """Upload a local file."""
        store = self.folder.store
        with store.answering(f"send {self.name} of {self.folder.name}"):
            store.files.makedirs(self._path.rpartition("/")[0], exist_ok=True)
            store.files.put_file(path, self._path)


class _OpenFile:
    """An open file whose reads, each of which is a request, also fail with a one-sentence message."""

    def __init__(self, opened: Any, store: Store, doing: str) -> None:
        self._opened, self._store, self._doing = opened, store, doing

    def read(self, *length: int) -> bytes:
        """Return the next bytes."""
        with self._store.answering(self._doing):
            content: bytes = self._opened.read(*length)
        return content

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._opened, name)


def _options(address: str) -> dict[str, Any]:
    """Return options that turn a stall into an error within a minute, and disable cached listings."""
    if not address.startswith(("s3://", "s3a://")):
        return {"use_listings_cache": False}
    return {
        "use_listings_cache": False,
        # given here explicitly, since the library caches clients by their arguments
        "endpoint_url": os.environ.get("AWS_ENDPOINT_URL"),
        "config_kwargs": {
            "connect_timeout": CONNECTS_WITHIN,
            "read_timeout": ANSWERS_WITHIN,
            "retries": {"max_attempts": _ATTEMPTS - 1, "mode": "standard"},
        },
    }


def _parts(path: str) -> list[str]:
    """Return the names in a storage path, with or without a leading ``/``."""
    return [part for part in path.split("/") if part]
