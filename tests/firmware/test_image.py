"""The shipped firmware images: intact, and equal to what the source compiles to."""

from __future__ import annotations

import subprocess
from hashlib import sha256
from pathlib import Path

import pytest

from firmware_build import FIRMWARE, needs_compiler
from rigctl.backends.emulated.image import BAUDS, FLASH, read_intel_hex, shipped_image
from rigctl.errors import RigctlError

IMAGES = FIRMWARE / "images"


def test_the_listed_checksums_are_those_of_the_images() -> None:
    sums = dict(reversed(line.split()) for line in (IMAGES / "SHA256SUMS").read_text("utf-8").splitlines())
    assert sums.keys() == {path.name for path in IMAGES.glob("*.hex")}
    for name, expected in sums.items():
        assert sha256((IMAGES / name).read_bytes()).hexdigest() == expected


@needs_compiler
def test_the_source_compiles_to_the_shipped_images_and_reports_flash_and_ram(tmp_path: Path) -> None:
    built = subprocess.run(
        ["make", "-C", str(FIRMWARE), f"BUILD={tmp_path}"], check=True, capture_output=True, text=True
    )
    assert built.stdout.count("flash") == built.stdout.count("RAM") == len(BAUDS)
    compiler = subprocess.run(["avr-gcc", "-dumpversion"], check=True, capture_output=True, text=True).stdout
    for baud in BAUDS:
        rebuilt = tmp_path / f"rigctl-uno-{baud}.hex"
        assert 0 < len(read_intel_hex(rebuilt)) < FLASH
        if compiler == (IMAGES / "COMPILER").read_text("utf-8"):
            assert rebuilt.read_bytes() == shipped_image(baud).read_bytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "without a program"),
        ("nonsense", "line 1 of a firmware image is damaged: no colon"),
        (":020000000C94\n", "line 1 of a firmware image is damaged: its length is wrong"),
        (":020000000C9400\n", "line 1 of a firmware image is damaged: its checksum is wrong"),
        (":02FFFF000C9460\n", "does not fit"),
    ],
)
def test_a_damaged_image_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "image.hex"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RigctlError, match=message):
        read_intel_hex(path)
    with pytest.raises(RigctlError, match="no firmware image for this speed"):
        shipped_image(9600)
