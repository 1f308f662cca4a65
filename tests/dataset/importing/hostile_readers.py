"""Readers that fail as native libraries do on damaged files; used in separate processes by the tests."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any


def crash(path: Path, options: Any) -> Any:
    ctypes.string_at(0)


def never_end(path: Path, options: Any) -> Any:
    while True:
        pass


def eat(path: Path, options: Any) -> Any:
    eaten = []
    while True:
        eaten.append(bytearray(1 << 24))


def leave(path: Path, options: Any) -> Any:
    raise SystemExit(3)
