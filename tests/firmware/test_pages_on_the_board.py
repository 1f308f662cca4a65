"""The documentation of the board agrees with its behaviour."""

from __future__ import annotations

import re
import subprocess
import sys
from binascii import crc_hqx
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from board_emulation import Emulation
from doc_page import blocks
from firmware_build import FIRMWARE
from rigctl.rig import Rig

if TYPE_CHECKING:
    from board_chip import Chip

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def emulation(uno_rig: Rig, tmp_path: Path) -> Iterator[Emulation]:
    made = Emulation(uno_rig, tmp_path / "ttyRIG")
    yield made
    made.close()


def test_the_pyvisa_script_does_what_the_page_shows(emulation: Emulation, tmp_path: Path) -> None:
    page = (DOCS / "how-to" / "talk-to-the-board-with-pyvisa.md").read_text(encoding="utf-8")
    (script,) = [block.text for block in blocks(page) if block.note.startswith("file:")]
    done = subprocess.run(
        [sys.executable, "-c", script, str(emulation.name)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    shown = [line[4:] for line in page.splitlines() if line.startswith("    ")]
    told = shown[shown.index("$ python read_the_bench.py ttyRIG") + 1 :]
    assert _without_digits(done.stdout.splitlines()) == _without_digits(told)
    assert "open for 250.0 ms" in done.stdout
    assert done.stdout.startswith("RIGCTL,RIG-UNO,0,1.1.1\n")


def _without_digits(lines: list[str]) -> list[str]:
    return [re.sub(r"\d+\.\d", "0", line) for line in lines]


def test_the_reference_names_every_command_and_error() -> None:
    page = (DOCS / "reference" / "board-protocol.md").read_text(encoding="utf-8")
    source = (FIRMWARE / "rigctl_uno" / "commands.c").read_text(encoding="utf-8")
    headers = re.findall(r'\{"([^"]+)", \w+, (?:true|false)\}', source)
    assert len(headers) > 20
    named = re.findall(r"`([^`]+)`", page)
    missing = [h for h in headers if not any(re.split(r"[ …]", name)[0] == h for name in named)]
    assert not missing
    errors = (FIRMWARE / "rigctl_uno" / "errors.c").read_text(encoding="utf-8")
    for text in re.findall(r'PSTR\("([^"]+)"\)', errors):
        assert text in page or text == "Tripped"
    trips = (FIRMWARE / "rigctl_uno" / "trips.c").read_text(encoding="utf-8")
    for text in re.findall(r'PSTR\("([^"]+)"\)', trips):
        assert text in page


def test_the_checksums_in_the_reference_are_correct(chip: Chip) -> None:
    page = (DOCS / "reference" / "board-protocol.md").read_text(encoding="utf-8")
    asked, answered = re.findall(r"^    [→←] (.*)$", page, re.MULTILINE)
    assert chip.ask(asked) == answered
    for line in (asked, answered):
        body, _, checksum = line.rpartition("*")
        assert int(checksum, 16) == crc_hqx(body.encode("ascii"), 0), f"{crc_hqx(body.encode(), 0):04X}"
