"""A mistake of a rig file that only the whole file shows."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.errors import RigctlError


@dataclass(frozen=True)
class Problem:
    """Something wrong in the file: where, as keys from the top, and what."""

    keys: tuple[str | int, ...]
    error: RigctlError
    of_key: bool = False
