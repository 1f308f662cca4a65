"""Compiled modules kept on disk: made once, found by every later process, never trusted blindly.

A module is a folder in the user's cache: its source, the machine code that numba keeps beside it, and a list
of checksums. It is built in a folder of its own and put in place by one rename, so that another process sees
all of it or nothing. Its name holds everything it depends on; a checksum that does not fit means that it is
built again.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import logging
import os
import shutil
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

logger = logging.getLogger(__name__)

#: names another place for the cache than the user's own
CACHE_VARIABLE = "RIGCTL_CACHE_DIR"

_MANIFEST = "checksums.json"
_MAIN = "compiled.py"
#: modules of one kind; the ones that were used longest ago are deleted. Kinds are counted apart: many
#: new models must not push out the kernels, which all of them need and which take longest to compile.
_KEPT = 256
_LOCK_SECONDS = 300.0
_loading = threading.RLock()


def cache_root() -> Path:
    """The folder of the compiled modules."""
    from platformdirs import user_cache_path

    chosen = os.environ.get(CACHE_VARIABLE)
    return (Path(chosen) if chosen else user_cache_path("rigctl", appauthor=False)) / "engine"


def load_compiled(
    name: str, files: Mapping[str, str], *, before_compiling: Callable[[], None] | None = None
) -> ModuleType:
    """The module whose source is ``files["compiled.py"]``, from the cache if it is there.

    Parameters
    ----------
    name: names the module among its kind.
    files: its source and whatever lies beside it.
    before_compiling: called when it is not in the cache and will take time.

    A cache that cannot be written costs a warning in the log and the time to compile, nothing else.
    """
    identity = hashlib.sha256(json.dumps([environment(), sorted(files.items())]).encode()).hexdigest()[:24]
    module_name = f"rigctl_compiled_{name}_{identity}"
    with _loading:
        if module_name in sys.modules:
            return sys.modules[module_name]
        folder = cache_root() / f"{name}-{identity}"
        try:
            module = _from_cache(module_name, folder)
            if module is None:
                with _one_builder(folder):
                    module = _from_cache(module_name, folder)
                    if module is None:
                        _announce(before_compiling)
                        module = _build(module_name, folder, files)
        except OSError as problem:
            logger.warning("the cache of compiled models in %s cannot be used: %s", folder.parent, problem)
            _announce(before_compiling)
            with tempfile.TemporaryDirectory(prefix="rigctl-") as temporary:
                module = _write_and_import(module_name, Path(temporary), files)
        return module


@cache
def environment() -> list[str]:
    """What machine code depends on besides its source: versions, the processor, the code that emits it."""
    import llvmlite
    import llvmlite.binding
    import numba

    here = Path(__file__).parent
    emitters = [here / "straight_line.py", *sorted((here / "kernels").glob("*.py"))]
    features = llvmlite.binding.get_host_cpu_features().flatten()
    return [
        sys.implementation.cache_tag,
        numba.__version__,
        llvmlite.__version__,
        llvmlite.binding.get_process_triple(),
        llvmlite.binding.get_host_cpu_name(),
        hashlib.sha256(features.encode()).hexdigest(),
        *(hashlib.sha256(path.read_bytes()).hexdigest() for path in emitters),
    ]


def _announce(before_compiling: Callable[[], None] | None) -> None:
    if before_compiling is not None:
        before_compiling()


def _from_cache(module_name: str, folder: Path) -> ModuleType | None:
    """The module in `folder`, or None when there is none that is whole."""
    if not folder.is_dir():
        return None
    if _is_whole(folder):
        try:
            module = _import_whole(module_name, folder)
        except Exception as problem:  # noqa: BLE001 - whatever is wrong with a cached file, it is made anew
            logger.warning("the compiled module %s is damaged and is built again: %r", folder, problem)
        else:
            return module
    else:
        logger.warning("the compiled module %s is damaged and is built again", folder)
    _remove(folder)
    return None


def _import_whole(module_name: str, folder: Path) -> ModuleType:
    if os.access(folder, os.W_OK):
        module = _import(module_name, folder)
        os.utime(folder)
        return module
    # numba ignores machine code in a folder that it could not write to
    with tempfile.TemporaryDirectory(prefix="rigctl-") as temporary:
        copy = Path(shutil.copytree(folder, Path(temporary) / folder.name))
        copy.chmod(0o700)
        return _import(module_name, copy)


def _build(module_name: str, folder: Path, files: Mapping[str, str]) -> ModuleType:
    building = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}")
    building.mkdir(parents=True)
    try:
        module = _write_and_import(module_name, building, files)
        _write_manifest(building)
        try:
            building.replace(folder)
        except OSError:
            # another process was faster and its module is as good
            if not folder.is_dir():
                raise
    finally:
        shutil.rmtree(building, ignore_errors=True)
    _prune(folder.parent, folder.name.rpartition("-")[0])
    return module


def _write_and_import(module_name: str, folder: Path, files: Mapping[str, str]) -> ModuleType:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return _import(module_name, folder)


def _import(module_name: str, folder: Path) -> ModuleType:
    """Import the folder's module; numba finds its machine code beside it, or compiles and leaves it there."""
    specification = importlib.util.spec_from_file_location(module_name, folder / _MAIN)
    if specification is None or specification.loader is None:
        raise OSError(f"no module in {folder}")
    module = importlib.util.module_from_spec(specification)
    # numba looks a function's module up by name when it loads its machine code
    sys.modules[module_name] = module
    try:
        with _cache_beside_source():
            specification.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


@contextmanager
def _cache_beside_source() -> Iterator[None]:
    """Let numba keep machine code beside its source, whatever place a user chose for other programs."""
    import numba

    config: Any = numba.config
    chosen = config.CACHE_DIR
    config.CACHE_DIR = ""
    try:
        yield
    finally:
        config.CACHE_DIR = chosen


@contextmanager
def _one_builder(folder: Path) -> Iterator[None]:
    """Let other processes that need the same module wait for this one rather than compile it too."""
    from filelock import FileLock, Timeout

    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.with_name(f".{folder.name}.lock"))
    try:
        lock.acquire(timeout=_LOCK_SECONDS)
    except Timeout:
        logger.warning("another process has been compiling %s for long; compiling it here too", folder.name)
    try:
        yield
    finally:
        lock.release()


def _checksums(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != _MANIFEST and path.suffix != ".pyc"
    }


def _write_manifest(folder: Path) -> None:
    (folder / _MANIFEST).write_text(json.dumps(_checksums(folder), indent=1), encoding="utf-8", newline="\n")


def _is_whole(folder: Path) -> bool:
    try:
        expected = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
        return bool(expected == _checksums(folder))
    except (OSError, ValueError):
        return False


def _remove(folder: Path) -> None:
    """Delete a folder that another process may be reading: out of the way first, then away."""
    aside = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}")
    folder.replace(aside)
    shutil.rmtree(aside, ignore_errors=True)


def _prune(root: Path, kind: str) -> None:
    """Delete modules of this kind not used for long, and what killed processes left half built or locked."""
    day_ago = time.time() - 86_400.0
    try:
        by_use = sorted(root.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        left_behind = [path for path in by_use if path.name[0] == "." and path.stat().st_mtime < day_ago]
    except OSError:
        return  # another process is tidying up; it will do
    modules = [path for path in by_use if path.name.rpartition("-")[0] == kind]
    for path in modules[_KEPT:] + left_behind:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with suppress(OSError):
                path.unlink()
