"""One text for all spellings of an address: the key of locks, and of the files of guards.

The same device may be called ``localhost:502`` and ``tcp://127.0.0.1:502``, ``/dev/serial/by-id/…`` and
``/dev/ttyACM0``, or ``TCPIP::bench::5025::SOCKET`` and ``socket://192.168.0.21:5025``.
"""

from __future__ import annotations

import os
import re
import sys
from hashlib import sha256
from ipaddress import IPv6Address, ip_address
from urllib.parse import urlsplit

_MODBUS_PORT, _OPCUA_PORT = 502, 4840  # the standard ports
_OURS = ("serial", "modbus", "visa", "opcua", "python", "emulated")
_VISA_SOCKET = re.compile(r"TCPIP\d*::(?P<host>[^:]+|\[.+\])::(?P<port>\d+)::SOCKET", re.IGNORECASE)
_VISA_SERIAL = re.compile(r"ASRL(?P<device>.+?)(::INSTR)?", re.IGNORECASE)


def address_key(kind: str, url: str) -> str:
    """Return the key of an address, e.g. ``tcp 192.168.0.20 502`` or ``port /dev/ttyACM0``.

    Parameters
    ----------
    kind: as of an `Address`: ``serial``, ``modbus``, ``visa``, ``opcua``, ``python`` or that of a plug-in.
    url: the address as it was given.
    """
    url = url.strip()
    # Each kind has its own spellings; where two kinds reach the same device (a socket, a serial port), their
    # keys are equal on purpose: a lock on one has to exclude the other.
    if kind == "visa" or (kind == "python" and "::" in url):
        return _visa(url)
    if kind == "opcua":
        return _opcua(url)
    if kind == "modbus" and (found := modbus_tcp_address(url)) is not None:
        return _tcp(*found)
    if kind not in _OURS and "://" not in url and not _is_device(url):
        where = modbus_tcp_address(url)
        return f"{kind} {url}" if where is None else f"{kind} {_host(where[0])} {where[1]}"
    return _serial(url)


def modbus_tcp_address(url: str) -> tuple[str, int] | None:
    """Return host and port of a Modbus device; None if it is on a serial line."""
    host, colon, port = url.removeprefix("tcp://").rpartition(":")
    if colon and port.isdigit() and "/" not in host:
        return host.strip("[]"), int(port)
    return (url.removeprefix("tcp://"), _MODBUS_PORT) if url.startswith("tcp://") else None


def is_serial_line(kind: str, url: str) -> bool:
    """Return whether an address is that of a serial line, here or behind a server of ports (RFC 2217)."""
    url = url.strip()
    if kind == "visa":
        return _VISA_SERIAL.fullmatch(url) is not None
    if kind == "modbus":
        return modbus_tcp_address(url) is None
    return kind in ("serial", "emulated") and not url.startswith(("socket://", "loop://"))


def file_name(key: str) -> str:
    """Return a file name for a key: its end in readable form, and a checksum."""
    name = "".join(letter if letter.isalnum() else "-" for letter in key).strip("-")[-40:]
    return f"{name}-{sha256(key.encode('utf-8', 'replace')).hexdigest()[:8]}"


def _tcp(host: str, port: int) -> str:
    return f"tcp {_host(host)} {port}"


def _host(host: str) -> str:
    """Return the numerical address of a host; the name if it is not known."""
    host = host.strip("[]").casefold()
    if host == "localhost":
        host = "127.0.0.1"
    try:
        address = ip_address(host)
    except ValueError:
        return _looked_up(host)
    if isinstance(address, IPv6Address):
        address = address.ipv4_mapped or (ip_address("127.0.0.1") if address.is_loopback else address)
    return str(address)


def _looked_up(name: str) -> str:
    import socket

    try:
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(name, None)}
    except (OSError, UnicodeError):
        return name.rstrip(".")
    # IPv4 first, as numbers: the same one whatever the order of the answer
    addresses = [ip_address(text.partition("%")[0]) for text in found]
    addresses.sort(key=lambda address: (address.version, int(address)))
    return _host(str(addresses[0])) if addresses else name


def _serial(url: str) -> str:
    """Return the key of a serial port of this computer, or of a pyserial URL."""
    if "://" in url:
        try:
            parts = urlsplit(url)
            host, port, scheme = parts.hostname, parts.port, parts.scheme.casefold()
        except ValueError:  # no address: whoever opens it says so
            return url
        if not host or not port:
            return url
        return _tcp(host, port) if scheme == "socket" else f"{scheme} {_host(host)} {port}"
    if sys.platform == "win32":
        return f"port {url.removeprefix(chr(92) * 2 + '.' + chr(92)).upper()}"
    return f"port {os.path.realpath(url)}"


def _is_device(url: str) -> bool:
    """Return whether an address is a serial port of this computer, by its name."""
    return url.startswith("/") or re.fullmatch(r"(\\\\\.\\)?COM\d+", url, re.IGNORECASE) is not None


def _visa(name: str) -> str:
    """Return the key of a VISA resource; sockets and serial lines are those of the other backends."""
    socket = _VISA_SOCKET.fullmatch(name)
    if socket is not None:
        return _tcp(socket["host"], int(socket["port"]))
    serial = _VISA_SERIAL.fullmatch(name)
    if serial is not None:
        device = serial["device"]
        return _serial(f"COM{device}" if device.isdigit() and sys.platform == "win32" else device)
    parts = [part.upper() for part in name.split("::")]
    if parts[-1] in ("INSTR", "RAW"):
        parts.pop()
    board = re.fullmatch(r"([A-Z]+?)(\d*)", parts[0])
    bus, number = (board[1], board[2] or "0") if board is not None else (parts[0], "")
    if bus == "TCPIP" and len(parts) > 1:
        device = parts[2].casefold() if len(parts) > 2 else "inst0"
        return f"visa tcpip {_host(parts[1])} {device}"
    rest = [_number(part) for part in parts[1:]]
    if bus == "USB" and len(rest) == 3:
        rest.append("0")  # the default interface
    return " ".join(["visa", bus.casefold() + number, *rest])


def _number(part: str) -> str:
    """Return a part of a resource name; numbers, which may be hexadecimal, in decimal."""
    try:
        return str(int(part, 0))
    except ValueError:
        return part.lstrip("0") if part.isdigit() else part


def _opcua(url: str) -> str:
    """Return the key of an endpoint."""
    try:
        parts = urlsplit(url)
        port = parts.port or _OPCUA_PORT
    except ValueError:  # no address: whoever opens it says so
        return url
    path = parts.path.rstrip("/")
    return f"opcua {_host(parts.hostname or '')} {port}{' ' + path if path else ''}"
