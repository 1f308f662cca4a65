"""Fetch a result of an earlier command, or compute it and keep it."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from rigctl.engine.result_cache.coding import Damaged, decode, encode
from rigctl.engine.result_cache.content import Opaque, digest
from rigctl.engine.result_cache.store import Store, results_folder

logger = logging.getLogger(__name__)

T = TypeVar("T")

#: packages whose code may contribute to a kept result
_PACKAGES = (
    "analysis",
    "effects",
    "engine",
    "expressions",
    "families",
    "fmu",
    "foreign",
    "model",
    "monitoring",
    "noise",
    "physics",
)
_LIBRARIES = ("llvmlite", "numba", "numpy", "scipy")


@dataclass
class Tally:
    """Numbers of results that this process has reused and computed."""

    reused: int = 0
    made: int = 0


TALLY = Tally()
_off = [0]


@contextmanager
def switched_off() -> Iterator[None]:
    """Neither use nor keep results within the block."""
    _off[0] += 1
    try:
        yield
    finally:
        _off[0] -= 1


def cached(kind: str, of: object, result: type[T], make: Callable[[], T]) -> T:
    """Return the result of `make`, or that of an earlier command which computed the same.

    Every result is converted to the stored form and back, even if it is not stored: the memory layout and
    type of its numbers, on which the last bit of a sum may depend, are then the same in both cases.

    Parameters
    ----------
    kind: names the computation: what `make` does with `of`.
    of: everything on which the result depends besides the code (see `content.digest`).
    result: its type: a dataclass whose fields are numbers, words, arrays, and collections and dataclasses of
        them.
    make: computes it; an exception that it raises is propagated, and nothing is kept.
    """
    folder = None if _off[0] else results_folder()
    name = None if folder is None else _name(kind, of)
    if folder is None or name is None:
        return _plain(result, *_coded(make()))
    store = Store(folder)
    stored = store.read(name)
    if stored is not None:
        try:
            value = decode(result, *stored)
        except Damaged as problem:
            logger.info("the kept result %s does not fit and is made again: %s", name, problem)
        else:
            TALLY.reused += 1
            logger.info("reused %s", name)
            return value
    tree, arrays = _coded(make())
    store.write(name, tree, arrays)
    TALLY.made += 1
    return _plain(result, tree, arrays)


def _coded(value: object) -> tuple[Any, list[np.ndarray]]:
    arrays: list[np.ndarray] = []
    return encode(value, arrays), arrays


def _plain(result: type[T], tree: Any, arrays: list[np.ndarray]) -> T:
    return decode(result, tree, iter(arrays))


def _name(kind: str, of: object) -> str | None:
    """The result's name; None if it depends on a value without readable content."""
    try:
        return f"{kind}-{digest(_code(), kind, of)[:40]}"
    except Opaque as problem:
        logger.info("a result (%s) is not kept: %s", kind, problem)
        return None


@cache
def _code() -> str:
    """Identifies the computation: the version of the method, the code itself, the libraries and the
    processor."""
    from importlib.metadata import version

    from rigctl.engine.cache import environment
    from rigctl.method_version import METHOD_VERSION

    code_hash = hashlib.sha256()
    root = Path(__file__).parents[2]
    for path in sorted(path for package in _PACKAGES for path in (root / package).rglob("*.py")):
        code_hash.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    libraries = [f"{name} {version(name)}" for name in _LIBRARIES]
    return digest(METHOD_VERSION, code_hash.hexdigest(), libraries, environment())
