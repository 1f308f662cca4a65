"""Makes a bench on a serial port from a rig file and the options of a command."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.arduino.bench import ArduinoBench
from rigctl.backends.arduino.wiring import wiring_of
from rigctl.backends.options import read_flag, refuse_unknown
from rigctl.backends.protocol import Backend
from rigctl.backends.transport.adapter import same_adapter
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig
from rigctl.rig.rates import BAUDS

OPTIONS = ("port", "baud", "inputs", "outputs", "clear_trips")
OF_LINES = ("port", "baud")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a bench on a serial port, not yet open: rigctl's board, or the rig file's line-based device.

    Parameters
    ----------
    rig: its ``backend`` part has the defaults of port and baud rate.
    clock: real.
    options: any of
        ``port`` (a device or a pyserial URL), ``baud``;
        ``inputs``, ``outputs`` (the wiring, see `wiring_of`);
        ``clear_trips`` (on or off).

    Raises
    ------
    RigctlError
        an option is unknown or wrong, or no port is given.
    """
    address, lines = address_of(rig, options), rig.backend.lines
    if lines is not None:
        from rigctl.backends.lines.create import line_bench

        return line_bench(rig, lines, clock, address)
    clear = read_flag("clear_trips", options.get("clear_trips"), default=False)
    return ArduinoBench(
        rig,
        clock,
        same_adapter(lambda: address.open(clock), address.url),
        wiring_of(rig, options),
        kind="serial",
        baud=address.settings["baud"],
        clear_trips=clear,
    )


def address_of(rig: Rig, options: Mapping[str, object]) -> Address:
    """Return the port and its baud rate.

    Raises
    ------
    RigctlError
        an option is unknown or wrong, or no port is given.
    """
    lines = rig.backend.lines
    refuse_unknown("option of the serial backend", options, OPTIONS if lines is None else OF_LINES)
    port = options.get("port") or rig.backend.port
    if not isinstance(port, str):
        raise RigctlError("which port is the bench on?", expected="e.g. '--port /dev/ttyACM0'")
    baud = options.get("baud") or rig.backend.baud or BAUDS["serial"]
    if not isinstance(baud, int) or isinstance(baud, bool):
        raise RigctlError("not a baud rate", value=str(baud), expected="e.g. 115200")
    return Address("serial", port, {"baud": baud, "frame": "8N1" if lines is None else lines.frame})
