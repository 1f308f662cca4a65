"""Machine code cached on disk: compiled once, verified by checksums, reused by later processes.

An entry is a folder in the user's cache: an object file, the names of its functions, and a list of checksums.
Only what nobody else could have written is loaded, since it is executed. An entry is built in a temporary
folder and renamed atomically, so that another process sees all of it or nothing. Its name is a hash of
everything on which the code depends; an entry with a wrong checksum is rebuilt.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from rigctl.engine.machine_code import MachineCode, loaded
from rigctl.files.cache_folder import cache_folder
from rigctl.files.private import is_private, private_folder
from rigctl.files.regular import read_bytes, read_text
from rigctl.json_values import parse_json

logger = logging.getLogger(__name__)

_MANIFEST = "checksums.json"
_CODE, _NAMES = "code.o", "names.json"
#: largest number of folders of one kind; those used longest ago are deleted. Kinds are counted separately:
#: many new models must not displace the kernels, which all of them need and which take longest to compile.
_KEPT = 1024
_LOCK_SECONDS = 300.0
_loading = threading.RLock()
#: the code loaded by this process, by the name of its folder
_loaded: dict[str, Mapping[str, int]] = {}


def cache_root() -> Path:
    """The folder of the compiled modules."""
    return cache_folder() / "engine"


def load_compiled(
    name: str,
    source: str,
    make: Callable[[], MachineCode],
    *,
    before_compiling: Callable[[], None] | None = None,
) -> Mapping[str, int]:
    """The addresses of compiled functions, from the cache if they are there.

    Parameters
    ----------
    name: the kind of code.
    source: distinguishes it from others of its kind.
    make: compiles it.
    before_compiling: called before a compilation, which takes time, if it is not in the cache.

    A cache that cannot be written costs only a warning in the log and the time to compile.
    """
    identity = hashlib.sha256(json.dumps([environment(), source]).encode()).hexdigest()[:24]
    folder = cache_root() / f"{name}-{identity}"
    with _loading:
        if folder.name not in _loaded:
            _loaded[folder.name] = _addresses(folder, make, before_compiling or _say_nothing)
        return _loaded[folder.name]


def _addresses(
    folder: Path, make: Callable[[], MachineCode], before_compiling: Callable[[], None]
) -> Mapping[str, int]:
    try:
        private_folder(folder.parent)
        addresses = _from_cache(folder)
        if addresses is None:
            with _one_builder(folder):
                addresses = _from_cache(folder)
                if addresses is None:
                    before_compiling()
                    addresses = loaded(_build(folder, make()))
    except OSError as problem:
        logger.warning("the cache of compiled models in %s cannot be used: %s", folder.parent, problem)
        before_compiling()
        addresses = loaded(make())
    return addresses


def _say_nothing() -> None:
    """Does nothing, by default."""


@cache
def environment() -> list[str]:
    """Everything besides the source on which machine code depends: versions, the processor, the code
    generator."""
    from importlib.metadata import version

    import llvmlite
    import llvmlite.binding

    folder = Path(__file__).parent
    emitters = [
        folder / "machine_code.py",
        folder / "straight_line.py",
        *sorted((folder / "kernels").glob("*.py")),
    ]
    features = llvmlite.binding.get_host_cpu_features().flatten()
    return [
        sys.implementation.cache_tag,
        version("numba"),
        llvmlite.__version__,
        llvmlite.binding.get_process_triple(),
        llvmlite.binding.get_host_cpu_name(),
        hashlib.sha256(features.encode()).hexdigest(),
        *(hashlib.sha256(path.read_bytes()).hexdigest() for path in emitters),
    ]


def _from_cache(folder: Path) -> Mapping[str, int] | None:
    """The functions in `folder`, or None if there are none that are intact."""
    if not folder.is_dir():
        return None
    if _is_intact(folder):
        try:
            addresses = loaded(_read(folder))
        except Exception as problem:  # noqa: BLE001 - whatever is wrong with a cached file, it is made anew
            logger.warning("the machine code in %s is damaged and is built again: %r", folder, problem)
        else:
            with suppress(OSError):  # a read-only cache is not cleaned by age
                os.utime(folder)
            return addresses
    else:
        logger.warning(
            "the machine code in %s is damaged, or could be changed by others, and is built again", folder
        )
    _remove(folder)
    return None


def _read(folder: Path) -> MachineCode:
    names = parse_json(read_text(folder / _NAMES))
    return MachineCode(read_bytes(folder / _CODE), tuple(names["defines"]), tuple(names["needs"]))


def _build(folder: Path, code: MachineCode) -> MachineCode:
    building = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}")
    building.mkdir(mode=0o700, parents=True)
    names = json.dumps({"defines": code.defines, "needs": code.needs})
    try:
        (building / _CODE).write_bytes(code.content)
        (building / _NAMES).write_text(names, encoding="utf-8", newline="\n")
        _write_manifest(building, folder.name)
        for file in building.iterdir():
            file.chmod(0o600)  # where the user's files are writable by a group by default
        try:
            building.replace(folder)
        except OSError:
            # another process was faster and its machine code is equivalent
            if not folder.is_dir():
                raise
    finally:
        shutil.rmtree(building, ignore_errors=True)
    _prune(folder.parent, folder.name.rpartition("-")[0])
    return code


@contextmanager
def _one_builder(folder: Path) -> Iterator[None]:
    """Let other processes that need the same machine code wait for this one rather than compile it too."""
    from filelock import FileLock, Timeout

    folder.parent.mkdir(parents=True, exist_ok=True)
    # a few permanent locks for all: one for each entry would have to be deleted while others wait for it
    lock = FileLock(folder.with_name(f".{folder.name[-2:]}.lock"))
    try:
        lock.acquire(timeout=_LOCK_SECONDS)
    except Timeout:
        logger.warning("another process has been compiling %s for long; compiling it here too", folder.name)
    try:
        yield
    finally:
        lock.release()


def _checksums(folder: Path, name: str) -> dict[str, str]:
    """The name of the entry, since another one could have been put in its place, and its files' checksums."""
    sums = {
        path.relative_to(folder).as_posix(): hashlib.sha256(read_bytes(path)).hexdigest()
        for path in sorted(folder.rglob("*"))
        if not path.is_dir() and path.name != _MANIFEST
    }
    return {"": name, **sums}


def _write_manifest(folder: Path, name: str) -> None:
    text = json.dumps(_checksums(folder, name), indent=1)
    (folder / _MANIFEST).write_text(text, encoding="utf-8", newline="\n")


def _is_intact(folder: Path) -> bool:
    """Whether it is as it was built, and only this user could have changed it."""
    try:
        if not all(map(is_private, (folder, *folder.iterdir()))):
            return False
        return bool(parse_json(read_text(folder / _MANIFEST)) == _checksums(folder, folder.name))
    except (OSError, ValueError):
        return False


def _remove(folder: Path) -> None:
    """Delete a folder that another process may be reading: rename it first, then delete it."""
    aside = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}")
    folder.replace(aside)
    shutil.rmtree(aside, ignore_errors=True)


def _prune(root: Path, kind: str) -> None:
    """Delete the entries of this kind beyond the most recent ones, and the remains of killed processes."""
    day_ago = time.time() - 86_400.0
    try:
        with os.scandir(root) as entries:
            used = {Path(entry.path): entry.stat().st_mtime for entry in entries}
    except OSError:
        return  # another process is cleaning up
    left_behind = [path for path, when in used.items() if path.name[0] == "." and when < day_ago]
    of_kind = sorted(
        (path for path in used if path.name.rpartition("-")[0] == kind), key=used.__getitem__, reverse=True
    )
    for path in of_kind[_KEPT:] + left_behind:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()
