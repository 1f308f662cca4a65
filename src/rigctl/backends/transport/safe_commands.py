"""The commands that make a device safe, and the state of its outputs when its port is closed.

Imports little, since every guard loads it when it starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


@dataclass(frozen=True)
class SafeOrder:
    """One safe command: its bytes, the lines of its answer, and the value that they must contain."""

    text: bytes
    reply: tuple[str, ...] = ()
    value: str = ""


class Outputs(Enum):
    """The known state of a device's outputs when its port is closed."""

    UNTOUCHED = b"untouched"  #: nothing was commanded yet
    SAFE = b"safe"  #: the device has confirmed that they are safe
    DRIVEN = b"driven"  #: another command has been sent since: the guard continues


class Duty:
    """The known state of a device's outputs, for a guard that may have to continue."""

    def __init__(self) -> None:
        self.outputs = Outputs.UNTOUCHED
