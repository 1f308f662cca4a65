"""The commands that make a device safe, and the state of its outputs when its port is closed.

Imports little, since every guard loads it when it starts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum


@dataclass(frozen=True)
class SafeOrder:
    """One exchange with a device, for its guard.

    Parameters
    ----------
    text: the bytes to be sent.
    reply: the patterns of the answer's lines.
    values: for places of these patterns, the texts of which the device must answer one.
    """

    text: bytes
    reply: tuple[str, ...] = ()
    values: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def shown(self) -> str:
        """The text as people read it."""
        return self.text.decode("utf-8", "replace").strip()


class Outputs(Enum):
    """The known state of a device's outputs when its port is closed."""

    UNTOUCHED = b"untouched"  #: nothing was commanded yet
    SAFE = b"safe"  #: the device has confirmed that they are safe
    DRIVEN = b"driven"  #: anything else: the guard continues


class Duty:
    """What a guard that may have to continue must know.

    Attributes
    ----------
    outputs: the known state of the device's outputs.
    identity: what the device answered when it was identified; None before that.
    """

    def __init__(self) -> None:
        self.outputs = Outputs.UNTOUCHED
        self.identity: Mapping[str, str] | None = None
