"""Checks that a serial port has the same USB adapter after a loss of contact.

Names such as ``/dev/ttyACM0`` and ``COM3`` depend on the order in which adapters are detected: after a fault
of a hub the name may refer to another bench with a device of the same kind.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress

from rigctl.backends.transport.port import Connect, Port
from rigctl.backends.transport.serial_ports import PortsUnlisted, system_ports
from rigctl.errors import RigctlError


def usb_serial_numbers() -> dict[str, str]:
    """Return the USB serial numbers of this computer's serial ports that have one, by name of the device.

    Where the system cannot list its ports, no number is known: no run depends on that list.
    """
    with suppress(PortsUnlisted):
        return {port.device: port.serial_number for port in system_ports() if port.serial_number}
    return {}


def same_adapter(
    connect: Connect, device: str, numbers: Callable[[], dict[str, str]] = usb_serial_numbers
) -> Connect:
    """Return `connect` with a check that refuses to reopen the port if its USB adapter is a different one.

    The check precedes the opening of the port, which would restart an Arduino.

    Parameters
    ----------
    connect: opens the port.
    device: its name, possibly a link; anything other than a serial port of this computer is always accepted.
    numbers: returns the USB serial numbers by name of the device.
    """
    known: str | None = None

    def connect_again() -> Port:
        nonlocal known
        by_device = numbers()
        found = by_device.get(device) or by_device.get(os.path.realpath(device))
        if known is not None and found is not None and found != known:
            elsewhere = [name for name, number in by_device.items() if number == known]
            raise RigctlError(
                "another USB adapter is on this port than before",
                value=f"{device}, serial number {found}",
                expected=f"serial number {known}" + (f", which is {elsewhere[0]} now" if elsewhere else ""),
            )
        port = connect()
        known = known or found
        return port

    return connect_again
