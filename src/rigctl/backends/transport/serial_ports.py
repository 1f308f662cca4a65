"""Lists the serial ports of this computer, the probable device on each, and whether it may be opened.

In: what pyserial says of the ports. Out: a `PortInfo` for each, with the command that gives access where
there is none. No port is opened, since many boards restart when theirs is; access is told from the file's
permissions, and the device from its USB numbers, which are a guess.

A list that fails is no reason to fail: drivers can break it in ways of their own (`PortsUnlisted`), and a
port that is named can be opened all the same.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

#: USB vendor and product ID (None: any product) -> what it most likely is.
#: Vendor IDs are those of usb.org, product IDs those documented by the manufacturers.
_KNOWN: Mapping[tuple[int, int | None], str] = MappingProxyType(
    {
        (0x2341, 0x0043): "Arduino Uno",
        (0x2341, 0x0001): "Arduino Uno",
        (0x2A03, 0x0043): "Arduino Uno",
        (0x2341, 0x0042): "Arduino Mega 2560",
        (0x2341, 0x0010): "Arduino Mega 2560",
        (0x2341, 0x8036): "Arduino Leonardo",
        (0x2341, 0x8037): "Arduino Micro",
        (0x2341, None): "Arduino",
        (0x2A03, None): "Arduino",
        (0x1A86, 0x7523): "CH340: an Uno or Nano of another maker",
        (0x1A86, 0x55D4): "CH9102: an Uno or ESP32 board of another maker",
        (0x1A86, None): "a WCH serial converter",
        (0x0403, 0x6001): "FT232R: an older Arduino, or a converter to RS-232 or RS-485",
        (0x0403, None): "an FTDI serial converter",
        (0x10C4, 0xEA60): "CP210x: an ESP32 board, or a converter to RS-232",
        (0x067B, None): "PL2303: a converter to RS-232",
        (0x16C0, 0x0483): "Teensy",
        (0x16D0, 0x0613): "an Arduino Uno of another maker",
        (0x2E8A, None): "Raspberry Pi Pico",
        (0x303A, None): "ESP32",
        (0x239A, None): "Adafruit board",
    }
)


@dataclass(frozen=True)
class PortInfo:
    """One serial port.

    Parameters
    ----------
    device: the name for opening it.
    description: the operating system's description.
    vendor, product: USB IDs; None for other ports.
    serial_number: USB serial number.
    guess: the probable device; empty if unknown.
    accessible: whether this user may open it.
    fix: how to get access otherwise.
    """

    device: str
    description: str
    vendor: int | None
    product: int | None
    serial_number: str | None
    guess: str
    accessible: bool
    fix: str = ""

    @property
    def usb(self) -> str:
        """Vendor and product in the usual notation."""
        return f"{self.vendor:04X}:{self.product:04X}" if self.vendor is not None else ""


class PortsUnlisted(Exception):
    """The system's list of serial ports fails, as with a broken driver; a named port can still be opened."""


def system_ports() -> list[Any]:
    """Return what pyserial knows of each serial port of this computer.

    Raises
    ------
    PortsUnlisted
        pyserial, or the system's functions that it calls, fail in whatever way.
    """
    try:
        from serial.tools.list_ports import comports  # calls the system even when it is imported

        return list(comports())
    except Exception as error:
        raise PortsUnlisted(f"{error or type(error).__name__}") from error


def list_ports() -> list[PortInfo]:
    """Return all serial ports of this computer: those on USB first, then by name.

    Raises
    ------
    PortsUnlisted
        the system's list fails.
    """
    found = []
    for port in system_ports():
        accessible, fix = access_to(port.device)
        found.append(
            PortInfo(
                device=port.device,
                description=port.description or "",
                vendor=port.vid,
                product=port.pid,
                serial_number=port.serial_number,
                guess=guess(port.vid, port.pid),
                accessible=accessible,
                fix=fix,
            )
        )
    return sorted(found, key=lambda port: (port.vendor is None, port.device))


def guess(vendor: int | None, product: int | None) -> str:
    """Return the probable device for a USB vendor and product ID; empty if unknown."""
    if vendor is None:
        return ""
    return _KNOWN.get((vendor, product)) or _KNOWN.get((vendor, None)) or ""


def access_to(device: str) -> tuple[bool, str]:
    """Return whether this user may read and write a port, and how to get access; the port is not opened."""
    if sys.platform == "win32" or os.access(device, os.R_OK | os.W_OK):
        return True, ""
    group = _group_of(device)
    if group is None:
        return False, f"sudo chmod a+rw {device}   (until it is plugged in again)"
    if _is_member(group):
        return False, f"log out and in again: you are in the group '{group}' since you logged in"
    return False, f"sudo usermod -aG {group} $USER   (then log out and in again)"


def missing_port_fix() -> str:
    """Return what to do if a board is plugged in and no port appears."""
    if sys.platform == "win32":
        return (
            "another cable; a yellow mark in Device Manager > Ports (COM & LPT) wants the driver of its chip"
        )
    if sys.platform == "darwin":
        return "another cable (some only charge); 'ls /dev/cu.*' before and after it is plugged in"
    return "another cable (some only charge); 'sudo dmesg | tail' says what the system sees of it"


def _group_of(device: str) -> str | None:
    """Return the group with access to a port; None if there is none."""
    if sys.platform == "win32":
        return None
    import grp
    import stat

    try:
        status = Path(device).stat()
        name = grp.getgrgid(status.st_gid).gr_name
    except (OSError, KeyError):
        return None
    usable = status.st_mode & stat.S_IRGRP and status.st_mode & stat.S_IWGRP
    return name if usable and name != "root" else None


def _is_member(group: str) -> bool:
    """Return whether the user's account is in a group, even if that requires a new login to take effect."""
    if sys.platform == "win32":
        return False
    import getpass
    import grp

    try:
        return getpass.getuser() in grp.getgrnam(group).gr_mem
    except (OSError, KeyError):
        return False
