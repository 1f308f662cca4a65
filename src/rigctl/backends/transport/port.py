"""The interface of a port, real or emulated, and its errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class PortLost(Exception):
    """The port is gone, or there is no answer; this may be temporary."""


class NoAnswer(PortLost):
    """The port exists, but there was no answer, or the device has restarted."""


class AnotherDevice(PortLost):
    """Another device answers on the port, which must not be commanded."""


class NotConfirmed(PortLost):
    """The right device answers, but has not confirmed that its outputs are safe."""


class Refused(Exception):
    """The device refused the command, or did something other than what was commanded."""


class Port(Protocol):
    """A port that transmits bytes in both directions. Times are in s on the bench's clock."""

    @property
    def name(self) -> str:
        """The name of the port in messages."""
        ...

    def write(self, data: bytes) -> None:
        """Send `data`; raises `PortLost`."""
        ...

    def read(self, until: float) -> bytes:
        """Return what has arrived, waiting until bench time `until`; raises `PortLost`."""
        ...

    def close(self) -> None:
        """Close the port; never raises."""
        ...


class OnPort(Protocol):
    """A connected device on a port."""

    @property
    def port(self) -> Port:
        """The port of the device."""
        ...


#: opens the port; raises `PortLost` if it does not exist at present, `RigctlError` if a retry cannot help
Connect = Callable[[], Port]
