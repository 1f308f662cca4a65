"""What makes a device safe, and what becomes of it when its port is let go.

Light on purpose: every guard starts with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


@dataclass(frozen=True)
class SafeOrder:
    """One command that makes safe: its bytes, the lines of its answer, and the value they must repeat."""

    text: bytes
    reply: tuple[str, ...] = ()
    value: str = ""


class Outputs(Enum):
    """What is known of a device's outputs when its port is let go."""

    UNTOUCHED = b"untouched"  #: nothing was commanded here yet
    SAFE = b"safe"  #: the device has confirmed that they are safe
    DRIVEN = b"driven"  #: something else was commanded since: its guard goes on


class Duty:
    """What a bench knows of its device's outputs, for the guard that may have to go on."""

    def __init__(self) -> None:
        self.outputs = Outputs.UNTOUCHED
