"""A serial device in memory: a port for a line-based bench, and a device that answers from a table."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Protocol

from rigctl.backends.lines.bench import LineBench
from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock, VirtualClock
from rigctl.errors import RigctlError
from rigctl.rig import Rig


class Device(Protocol):
    """The device at the other end of the line."""

    def take(self, data: bytes) -> bytes:
        """Take the bytes sent, and return the answer; empty until a line is complete."""
        ...


class FakeDevice:
    """Answers lines by a table of patterns; the first that fits the whole line counts.

    Parameters
    ----------
    answers: maps a regular expression to the answer, or to a function of the match that returns it. Lines
        that match no expression are not answered.
    end: line terminator, in both directions.

    Attributes
    ----------
    sent: every complete line received, without the terminator.
    """

    def __init__(self, answers: Mapping[str, str | Callable[[re.Match[str]], str]], end: str = "\n") -> None:
        self.sent: list[str] = []
        self._answers = [(re.compile(pattern), answer) for pattern, answer in answers.items()]
        self._end = end.encode("ascii")
        self._begun = b""

    def take(self, data: bytes) -> bytes:
        """The answers to the lines that these bytes complete."""
        *lines, self._begun = (self._begun + data).split(self._end)
        return b"".join(self._answer(line.decode("utf-8", "replace").strip()) for line in lines)

    def _answer(self, line: str) -> bytes:
        self.sent.append(line)
        for pattern, answer in self._answers:
            match = pattern.fullmatch(line)
            if match is not None:
                text = answer if isinstance(answer, str) else answer(match)
                return text.encode("utf-8") + self._end
        return b""


class FakeSerial:
    """A `Port` to a device in memory, on a virtual clock; each answer takes `delay` s.

    Attributes
    ----------
    gone: the plug is pulled; may be set at any time.
    mute: the device does not answer any more; may be set at any time.
    delay: s from a line to its answer; may be changed at any time.
    closed: whether the bench has closed it.
    """

    name = "a device in memory"

    def __init__(self, device: Device, clock: Clock, delay: float = 0.01) -> None:
        self.device = device
        self.clock = clock
        self.delay = delay
        self.gone = False
        self.mute = False
        self.closed = False
        self._coming: list[tuple[float, bytes]] = []

    def check(self) -> None:
        """Open it; raises `PortLost` if the plug is pulled."""
        self._present()
        self.closed = False

    def write(self, data: bytes) -> None:
        """Send to the device."""
        self._present()
        if not self.mute:
            answer = self.device.take(data)
            if answer:
                self._coming.append((self.clock.now() + self.delay, answer))

    def send_unasked(self, data: bytes) -> None:
        """Let the device send unsolicited data."""
        self._coming.append((self.clock.now(), data))

    def read(self, until: float) -> bytes:
        """Bytes received by bench time `until`, s."""
        self._present()
        if not self._coming or self._coming[0][0] > until:
            self.clock.sleep_until(until)
            return b""
        when, data = self._coming.pop(0)
        self.clock.sleep_until(when)
        return data

    def close(self) -> None:
        """Close it."""
        self.closed = True

    def _present(self) -> None:
        if self.gone:
            raise PortLost("the plug is pulled")


def line_bench(rig: Rig, device: Device | FakeSerial, clock: Clock | None = None) -> LineBench:
    """The bench of a rig file with `lines:`, with a device in memory behind it; not opened yet.

    Raises
    ------
    RigctlError
        the rig file describes no line-based device.
    """
    if rig.backend.lines is None:
        raise RigctlError(f"the rig '{rig.name}' describes no device of lines", expected="'lines:' in it")
    if isinstance(device, FakeSerial):
        port = device
        clock = clock or port.clock
    else:
        clock = clock or VirtualClock()
        port = FakeSerial(device, clock)

    def connect() -> FakeSerial:
        port.check()
        return port

    return LineBench(rig, rig.backend.lines, clock, connect, kind="serial")
