"""An error in a rig file that involves several parts of it."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.errors import RigctlError


@dataclass(frozen=True)
class Problem:
    """An error in the file: its location, as keys from the top, and the message."""

    keys: tuple[str | int, ...]
    error: RigctlError
    of_key: bool = False
