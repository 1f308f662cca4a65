"""`rigctl import`: dry run, several files, and a reusable mapping."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from commands import answer, call, refusal, told
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run

BOARD = ["--rig", "rigs/heater-board.yaml"]
GERMAN = (
    "Zeit;Temp oben (°C);Heizung;Notiz\n"
    "03.04.2026 12:00:0{0};2{0},5;0;\n"
    "03.04.2026 12:00:0{1};2{1},5;0;über\n"
)


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    Path("mon.csv").write_bytes(GERMAN.format(0, 1).encode("cp1252"))
    Path("tue.csv").write_bytes(GERMAN.format(3, 4).replace("03.04", "04.04").encode("utf-16"))
    return tmp_path


def test_a_dry_run_previews_the_import_and_writes_nothing() -> None:
    rows = ["time [s],heater_1 [%],temperature_1 [degC]"]
    rows += [f"{t},{0 if t < 40 else 50},{20 + max(t - 40, 0) / 10 if t != 7 else ''}" for t in range(100)]
    Path("log.csv").write_text("\n".join([*rows, "100,50,warm"]), encoding="utf-8")
    shown = call("import", "log.csv", *BOARD, "--dry-run", "--split", "command", "-o", "log.png")
    assert shown.exit_code == 0
    assert "channel temperature_1 [degC]" in shown.stdout
    assert any("\u2801" <= sign <= "\u28ff" for sign in shown.stdout)
    assert "log.csv:102:8: temperature_1: not a number, got 'warm'" in shown.stderr
    assert Path("log.png").read_bytes().startswith(b"\x89PNG")
    found = answer("import", "log.csv", *BOARD, "--dry-run")
    columns = {column["ours"]: column for column in found["columns"]}
    assert (columns["temperature_1"]["values"], columns["temperature_1"]["missing"]) == (99, 1)
    assert (columns["heater_1"]["low"], columns["heater_1"]["high"]) == (0.0, 50.0)
    assert (found["rows"], found["bad_rows"], len(found["records"])) == (100, 1, 1)
    assert not list(Path("runs").glob("2*"))
    Path("note.png").write_text("mine", encoding="utf-8")
    assert "a file of another kind exists already" in refusal(
        "import", "log.csv", *BOARD, "--dry-run", "-o", "note.png"
    )


def test_a_dry_run_also_previews_a_table_of_observations() -> None:
    shown = told("import", "data/hl32-strokes.csv", "--rig", "rigs/hl32-bench.yaml", "--dry-run")
    assert "other stroke [mm]" in shown


def test_a_mapping_is_saved_and_used_again() -> None:
    columns = ["--columns", "Zeit=time,Temp oben=temperature_1,Heizung=heater_1 [%],Notiz=-"]
    first = answer(
        "import", "mon.csv", *BOARD, *columns, "--zone", "Europe/Berlin", "--assume", "heater_2=0 %",
        "--save-mapping", "lab.yaml",
    )  # fmt: skip
    again = answer("import", "mon.csv", "tue.csv", *BOARD, "--mapping", "lab.yaml")
    one, both = open_run(first["path"]), open_run(again["path"])
    assert (one.header.started, one.header.assumed) == (both.header.started, both.header.assumed)
    assert both.records["name"].tolist() == ["mon", "tue"]
    assert both.records["start"].tolist() == [0.0, 86403.0]
    # saving the same mapping again changes nothing; another one would overwrite it
    answer("import", "mon.csv", *BOARD, "--mapping", "lab.yaml", "--save-mapping", "lab.yaml")
    assert "a different file exists" in refusal(
        "import", "mon.csv", *BOARD, *columns, "--save-mapping", "lab.yaml"
    )
    assert len(list(Path("runs").glob("2*"))) == 3  # it imported the file, and then refused
    dry = ["import", "mon.csv", *BOARD, *columns, "--save-mapping", "lab.yaml", "--dry-run", "--json"]
    assert call(*dry).stdout == ""  # it answered, and then refused: two documents


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("columns: {Zeit: time}\ncolums: {}\n", "did you mean 'columns'"),
        ("dates: first\n", "lab.yaml:1:8"),
        ("- Zeit\n", "lab.yaml:1:1: not a mapping"),
        ("delimiter: ab\n", "not a delimiter, got 'ab'"),
    ],
)
def test_a_wrong_mapping_is_reported(text: str, said: str) -> None:
    Path("lab.yaml").write_text(text, encoding="utf-8")
    assert said in refusal("import", "mon.csv", *BOARD, "--mapping", "lab.yaml")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--dates", "dayfirst"], "--dates: no such choice, got 'dayfirst'; expected one of iso, day-first"),
        (["--times", "mend"], "--times: no such choice"),
        (["--split", "phase"], "--split: no such way"),
        (["--resample", "10"], "the unit is missing"),
        (["--assume", "heater_2"], "--assume: not a value for a name"),
        (["--encoding", "utf8x"], "unknown encoding"),
        (["--decimal", ";"], "--decimal: no such choice"),
        (["--zone", "Europe/Berln"], "did you mean 'Europe/Berlin'"),
    ],
)
def test_a_wrong_option_is_reported(arguments: list[str], said: str) -> None:
    columns = ["--columns", "Zeit=time,Temp oben=temperature_1,Heizung=heater_1 [%],Notiz=-"]
    assert said in refusal("import", "mon.csv", *BOARD, *columns, *arguments)


def test_the_dry_run_with_json_prints_one_document() -> None:
    Path("log.csv").write_text("time [s],temperature_1 [degC]\n0,20\n1,21\n", encoding="utf-8")
    shown = call("import", "log.csv", *BOARD, "--dry-run", "--json")
    assert json.loads(shown.stdout)["rows"] == 2
