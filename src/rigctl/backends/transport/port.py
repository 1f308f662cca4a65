"""What a bench needs of a port, real or emulated, and what goes wrong on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class PortLost(Exception):
    """The port is gone, or nobody answers on it; it may come back."""


class NoAnswer(PortLost):
    """The port is there, and nobody has answered on it, or somebody who has begun anew."""


class Refused(Exception):
    """The device answered that it does not do it, or does something else."""


class Port(Protocol):
    """Bytes both ways. Times are s on the bench's clock."""

    @property
    def name(self) -> str:
        """What it is called in messages."""
        ...

    def write(self, data: bytes) -> None:
        """Send `data`; raises `PortLost`."""
        ...

    def read(self, until: float) -> bytes:
        """What has arrived, waiting for something until bench time `until`; raises `PortLost`."""
        ...

    def close(self) -> None:
        """Let it go; never raises."""
        ...


class OnPort(Protocol):
    """A device that has answered on a port."""

    @property
    def port(self) -> Port:
        """The port that it is on."""
        ...


#: opens the port; raises `PortLost` where it is not there, `RigctlError` where it never will be
Connect = Callable[[], Port]
