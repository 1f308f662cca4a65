"""`rigctl import` and `rigctl export` at the command line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from commands import answer, call, refusal, told

TEXT = "time [s],record,position [mm]\n0,0,1\n1,0,2\n0,1,3\n"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "strokes.csv"
    path.write_text(TEXT, encoding="utf-8")
    return path


def test_export_and_import_round_trip(file: Path) -> None:
    arguments = ("import", str(file), "--rig", "rigs/hl32-bench.yaml")
    document = answer(*arguments)
    assert (document["records"], document["rows"], document["left_out"]) == (2, 3, 0)
    assert Path(document["path"]).name == document["run"]
    assert answer("export", document["run"])["rows"] == 3
    assert Path(f"{document['run']}.csv").read_text(encoding="utf-8") == TEXT

    assert "-strokes" in told(*arguments)
    assert "a.parquet: 3 rows" in told("export", "latest", "-o", "a.parquet")


def test_bad_rows_are_reported_on_stderr(file: Path) -> None:
    file.write_text(TEXT + "x,1,4\n" * 30, encoding="utf-8")
    arguments = ("import", str(file), "--rig", "rigs/hl32-bench.yaml", "--json")
    assert "not a number" in refusal(*arguments)
    result = call(*arguments, "--keep-good")
    assert json.loads(result.stdout)["left_out"] == 30
    assert "strokes.csv:5:1: time: not a number" in result.stderr
    assert "10 more rows" in result.stderr


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (
            b"Zeit;Druck;positon\n0;1;2\n",
            "log.csv:1:6: 2 columns are unknown: Druck, positon \\(position\\?\\);.*"
            "Say what each of them is: --columns 'Druck=-,positon=position \\[mm\\]'",
        ),
        (
            b"time [s],oil_temp [degC],foo\n0,1,2\n",
            "2 columns are unknown: oil_temp \\(oil_temperature\\?\\), foo;.*'oil_temp=oil_tem.*,foo=-'",
        ),
        (b"time [s],\xd6l [degC]\n0,1\n", "log.csv:1:10: unknown column, got 'Öl'; expected one of .*'Öl=-'"),
        (
            b"time [s],position [mm]\n12:30,1\n",
            "log.csv:2:1: time: hours and minutes, or .*got '12:30'.*h:min",
        ),
        (b"time [s],position [mm]\n", "log.csv: there is nothing to import; expected rows of values"),
    ],
)
def test_missing_columns_of_foreign_files_are_reported(file: Path, content: bytes, says: str) -> None:
    log = file.with_name("log.csv")
    log.write_bytes(content)
    assert re.search(says, refusal("import", str(log), "--rig", "rigs/hl32-bench.yaml"))


@pytest.mark.parametrize("command", ["import", "export"])
def test_the_help_shows_an_example(command: str) -> None:
    assert f"Example: rigctl {command}" in told(command, "--help")
