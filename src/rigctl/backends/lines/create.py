"""Make a bench whose device is spoken to in lines."""

from __future__ import annotations

from rigctl.backends.lines.bench import LineBench
from rigctl.backends.lines.guard import Orders
from rigctl.backends.lines.setting import Setter
from rigctl.backends.serial.port import Port
from rigctl.clock import Clock
from rigctl.rig import Lines, Rig


def line_bench(rig: Rig, lines: Lines, clock: Clock, url: str, baud: int) -> LineBench:
    """A bench on a serial port, not yet open.

    Where it drives anything, a guard holds the port, so that outputs become safe even when this process ends
    or hangs.
    """
    ends = lines.send_ends.encode("utf-8")
    safe = tuple(text.encode("utf-8") + ends for _, text in Setter(rig, lines).safe_commands())

    def connect() -> Port:
        if safe:
            from rigctl.backends.lines.guard_port import GuardedPort

            return GuardedPort(Orders(url, baud, lines.frame, safe, lines.watchdog), clock)
        from rigctl.backends.serial.pyserial_port import PyserialPort

        return PyserialPort(url, baud, clock, lines.frame)

    return LineBench(rig, lines, clock, connect, kind="serial")
