"""The firmware images: Intel HEX files that come with the package."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import RigctlError
from rigctl.files.regular import read_text
from rigctl.files.shipped import shipped

FLASH = 32 * 1024  #: size of the ATmega328P's flash memory, bytes
BAUDS = (115200, 500000)  #: baud rates of the images


def shipped_image(baud: int) -> Path:
    """Return the image built for a baud rate.

    Raises
    ------
    RigctlError
        there is no image for it.
    """
    if baud not in BAUDS:
        raise RigctlError(
            "no firmware image for this speed", value=f"{baud} baud", expected=" or ".join(map(str, BAUDS))
        )
    return shipped("firmware", "images", f"rigctl-uno-{baud}.hex")


def read_intel_hex(path: Path) -> bytes:
    """Return the flash content from address 0 that a file defines; gaps are filled with 0xFF.

    Raises
    ------
    RigctlError
        the file cannot be read, a line is damaged (with its number), or it does not fit.
    """
    try:
        lines = read_text(path, "ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RigctlError("cannot read this firmware image", value=path.as_posix(), hint=str(error)) from None
    flash = bytearray(b"\xff" * FLASH)
    base = end = 0
    for number, line in enumerate(lines, 1):
        try:
            kind, address, data = _parse(line)
        except ValueError as error:
            raise RigctlError(f"line {number} of a firmware image is damaged: {error}", value=line) from None
        if kind in (2, 4):
            base = int.from_bytes(data, "big") << (4 if kind == 2 else 16)
        elif kind == 0:
            start = base + address
            if start + len(data) > FLASH:
                raise RigctlError("a firmware image does not fit the board", value=path.as_posix())
            flash[start : start + len(data)] = data
            end = max(end, start + len(data))
    if not end:
        raise RigctlError("a firmware image without a program", value=path.as_posix())
    return bytes(flash[:end])


def _parse(line: str) -> tuple[int, int, bytes]:
    """Return type, address and data of the record ``:LLAAAATT…CC``."""
    if not line.startswith(":"):
        raise ValueError("no colon")
    record = bytes.fromhex(line[1:].strip())
    if len(record) < 5 or len(record) != record[0] + 5:
        raise ValueError("its length is wrong")
    if sum(record) & 0xFF:
        raise ValueError("its checksum is wrong")
    return record[3], int.from_bytes(record[1:3], "big"), record[4:-1]
