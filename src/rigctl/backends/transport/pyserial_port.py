"""A port opened by pyserial: a device, or one of its URLs."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit

from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock
from rigctl.errors import RigctlError

#: pyserial URLs that only connect; of the others, 'spy://' writes a file, and 'alt://' uses any class
_SCHEMES = ("socket", "rfc2217", "hwgrep", "loop")
_LONGEST_WAIT = 0.5  # s of wall time in one read, so that a lost port is detected


class PyserialPort:
    """An open serial port, locked so that no other program can command the bench through it.

    Parameters
    ----------
    url: ``/dev/ttyACM0``, ``COM3``, ``socket://host:port``, …
    baud: bits per second.
    clock: the clock for waits; real for a real bench.
    frame: data bits, parity and stop bits.

    Raises
    ------
    PortLost
        the port does not exist at present.
    RigctlError
        it cannot be opened: no permission, in use, or not a port.
    """

    def __init__(self, url: str, baud: int, clock: Clock, frame: str = "8N1") -> None:
        import serial

        _require_plain(url)
        self.name = url
        self._clock = clock
        self._lost: tuple[type[BaseException], ...] = (serial.SerialException, OSError, TypeError)
        try:
            self._serial: Any = serial.serial_for_url(
                url,
                baudrate=baud,
                bytesize=int(frame[0]),
                parity=frame[1],
                stopbits=int(frame[2]),
                timeout=0,
                write_timeout=1.0,
                exclusive=True,
            )
        except ValueError as error:
            raise RigctlError("not a serial port", value=url, hint=str(error)) from None
        except (serial.SerialException, OSError) as error:
            raise _refusal(url, error) from None

    def write(self, data: bytes) -> None:
        """Send `data`."""
        try:
            self._serial.write(data)
        except self._lost as error:
            raise PortLost(f"{self.name}: {error}") from None

    def read(self, until: float) -> bytes:
        """Return what has arrived by bench time `until`, as soon as something has."""
        left = (until - self._clock.now()) / self._clock.speed
        try:
            self._serial.timeout = min(max(left, 0.0), _LONGEST_WAIT)
            first = self._first()
            if not first:
                return b""
            rest: bytes = self._serial.read(self._serial.in_waiting or 0)
        except self._lost as error:  # pyserial raises a TypeError if the port is closed meanwhile
            raise PortLost(f"{self.name}: {error}") from None
        return first + rest

    def _first(self) -> bytes:
        """Return the next byte, or nothing if none arrives in time."""
        try:
            first: bytes = self._serial.read(1)
        except self._lost as error:
            if _is_timeout(error):
                return b""
            raise
        return first

    def close(self) -> None:
        """Close the port."""
        with suppress(*self._lost):
            self._serial.close()


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> PyserialPort:
    """Open the port of an `Address`; its settings are ``baud`` and ``frame``."""
    return PyserialPort(url, settings["baud"], clock, settings["frame"])


def _is_timeout(error: BaseException) -> bool:
    """Whether nothing has arrived in time, which a driver of Windows may report as an error (ERROR_TIMEOUT).

    Only the text of pyserial's error has its number.
    """
    return "GetOverlappedResult" in str(error) and ", 1460)" in str(error)


def _require_plain(url: str) -> None:
    scheme, found, _ = url.partition("://")
    if found and scheme.lower() not in _SCHEMES:
        urls = ", ".join(f"{known}://" for known in _SCHEMES)
        raise RigctlError(
            "not a kind of port that is opened",
            value=url,
            expected=f"a device such as /dev/ttyACM0 or COM3, or {urls}",
        )
    if found:
        try:
            _ = urlsplit(url).port
        except ValueError:
            raise RigctlError(
                "no address", value=url, expected=f"{scheme}://HOST:PORT, with a port of 1 to 65535"
            ) from None


def _refusal(url: str, error: Exception) -> Exception:
    """Return `PortLost` if a retry may help, otherwise a `RigctlError`."""
    number = getattr(error, "errno", None)
    text = str(error)
    if os.name == "nt" and "PermissionError" in text:  # the system has no rights to a port, only one owner
        return RigctlError("somebody else has this port open", value=url, hint="Close the other program")
    if number == errno.EACCES or "PermissionError" in text:
        return RigctlError(
            "no right to open this port, or somebody else has it",
            value=url,
            hint="On Linux: 'sudo usermod -aG dialout $USER', then log in again",
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in text:
        return RigctlError("somebody else has this port open", value=url, hint="Close the other program")
    return PortLost(f"{url}: {text}")
