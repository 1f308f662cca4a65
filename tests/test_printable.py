from __future__ import annotations

import unicodedata
from pathlib import PurePosixPath, PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.cli.tables import PrintableConsole
from rigctl.errors import Location, RigctlError
from rigctl.printable import printable, shown_path


@given(st.text())
def test_no_terminal_control_sequence_remains(text: str) -> None:
    shown = printable(text)
    assert len(shown) == len(text)
    assert not any(unicodedata.category(character)[0] == "C" for character in shown)


@pytest.mark.parametrize("text", ["p = 3 bar", "20 °C", "1\u202f000 rows", "öäü 圧力", "±"])
def test_printable_text_is_unchanged(text: str) -> None:
    assert printable(text) == text


def test_an_error_quotes_no_escape_sequence() -> None:
    error = RigctlError("unknown \x1b]0;title\x07name", value="\x1b[2J", where=Location(), hint="\u202etxt")
    assert "\x1b" not in str(error)
    assert "\u202e" not in str(error)


def test_a_table_shows_no_escape_sequence_of_a_cell(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.table import Table

    table = Table("rig\x1b[31m")
    table.add_row("bench\x1b[2J\x9b1m")
    PrintableConsole(width=60).print(table, "note \x1b]52;c;aGk=\x07")
    shown = capsys.readouterr().out
    assert "bench" in shown
    assert not any(sign in shown for sign in ("\x1b", "\x9b", "\x07"))


def test_a_path_is_shown_with_forward_slashes_on_every_system() -> None:
    assert shown_path(PureWindowsPath(r"C:\Grüße aus Köln\rigs\a.yaml")) == "C:/Grüße aus Köln/rigs/a.yaml"
    assert shown_path(PureWindowsPath(r"\\lab\share\runs")) == "//lab/share/runs"
    assert shown_path(PurePosixPath("rigs/a.yaml")) == "rigs/a.yaml"
    assert shown_path("s3://lab/runs") == "s3://lab/runs"
    assert shown_path(None) == ""
