"""Names that Windows reserves for devices in every folder, whatever follows them: ``con.yaml``."""

from __future__ import annotations

from pathlib import PurePath
from typing import Final

_RESERVED: Final = frozenset(
    ["con", "prn", "aux", "nul", "conin$", "conout$"]
    + [f"{device}{number}" for device in ("com", "lpt") for number in "0123456789¹²³"]
)


def is_reserved(name: str) -> bool:
    """Whether a file or folder of this name is a device on Windows."""
    return name.partition(".")[0].rstrip().casefold() in _RESERVED


def device_named(path: str) -> str | None:
    """The device that Windows opens for a path, in whatever folder; None for a file."""
    name = path.replace("\\", "/").rpartition("/")[2]
    return name if is_reserved(name) else None


def reserved_part(path: PurePath) -> str | None:
    """The first part of a path that is a device on Windows; None if it has none."""
    return next((part for part in path.parts if is_reserved(part)), None)
