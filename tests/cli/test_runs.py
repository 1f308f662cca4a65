"""`rigctl runs`: the catalogue at the command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from dataset.strokes import LAYOUT, STARTED, measure_strokes
from rigctl.cli.main import app
from rigctl.dataset import RunHeader, RunWriter, Source, open_run
from rigctl.errors import RigctlError
from systems import needs_posix

FIRST, SECOND = "20261121-093000-stroke", "20261121-100000-stroke"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder with two runs: one finished, one failed."""
    monkeypatch.chdir(tmp_path)
    for run_id, status, reason in ((FIRST, "finished", None), (SECOND, "failed", "too hot [bold]")):
        header = RunHeader(run_id, Source("stroke"), Source("bench [red]"), LAYOUT, STARTED)
        writer = RunWriter.create(tmp_path / "runs", header)
        measure_strokes(writer)
        writer.close(status, reason)
    return tmp_path


def text(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["runs", *arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.stdout


def answer(*arguments: str, code: int = 0) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(text(*arguments, "--json", code=code))
    return document


def test_list_shows_runs_in_order_with_status_records_and_rows(project: Path) -> None:
    shown = text("list")
    assert shown.index(FIRST) < shown.index(SECOND)
    runs = answer("list")["runs"]
    assert [(run["id"], run["status"], run["records"], run["rows"]) for run in runs] == [
        (FIRST, "finished", 3, 63),
        (SECOND, "failed", 3, 63),
    ]
    assert [run["id"] for run in answer("list", "--last", "1")["runs"]] == [SECOND]


def test_an_empty_project_says_how_to_make_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "rigctl simulate" in text("list")
    assert answer("list") == {"runs": []}
    assert answer("verify") == {"runs": [], "broken": 0}
    assert "no runs" in text("verify")


def test_show_prints_user_text_without_interpreting_markup(project: Path) -> None:
    shown = text("show", "latest")
    for part in (SECOND, "failed: too hot [bold]", "bench [red]", "oil [degC]", "stroke [mm]"):
        assert part in shown
    document = answer("show", FIRST)
    assert document["status"] == "finished"
    assert [record["oil"] for record in document["records"]] == [20.0, 30.0, 40.0]
    assert {name: document["record_units"][name] for name in ("oil", "stroke")} == {
        "oil": "degC",
        "stroke": "mm",
    }


def test_verify_reports_broken_runs_with_exit_code_1(project: Path) -> None:
    assert answer("verify")["broken"] == 0
    (project / "runs" / FIRST / "samples.parquet").unlink()
    document = answer("verify", code=1)
    assert [run["condition"] for run in document["runs"]] == ["broken", "whole"]
    assert "samples.parquet: the file is missing" in text("verify", FIRST, code=1)
    assert answer("verify", SECOND)["runs"][0]["condition"] == "whole"


def test_a_run_in_progress_is_shown_as_such(project: Path) -> None:
    header = RunHeader("20261122-000000-x", Source("stroke"), Source("bench"), LAYOUT, STARTED)
    writer = RunWriter.create(project / "runs", header)
    assert answer("show", "latest")["status"] == "running"
    assert "20261122-000000-x: in progress" in text("verify", "latest")
    writer.close("finished")


def test_an_excluded_record_can_be_included_again(project: Path) -> None:
    assert "excluded" in text("exclude", FIRST, "0", "2", "--reason", "air [red]")
    assert open_run(project / "runs" / FIRST).usable == (1,)
    assert "air [red]" in text("show", FIRST)
    assert answer("exclude", FIRST, "2", "--undo", "--reason", "fine")["excluded"] is False
    assert open_run(project / "runs" / FIRST).usable == (1, 2)


@pytest.mark.parametrize("arguments", [["annotate", "latest", " "], ["exclude", FIRST, "0", "--reason", ""]])
def test_an_empty_note_or_reason_is_refused(project: Path, arguments: list[str]) -> None:
    with pytest.raises(RigctlError, match=r"is empty; expected (some words|reason)"):
        text(*arguments)


def test_annotate_adds_notes_to_runs_and_records(project: Path) -> None:
    text("annotate", "latest", "new seals [bold]", "--record", "1")
    assert "(record 1): new seals [bold]" in text("show")
    assert answer("annotate", "latest", "hot day")["note"] == "hot day"
    assert answer("list")["runs"][1]["notes"] == 2


def test_sql_queries_records_and_runs(project: Path) -> None:
    document = answer(
        "sql", "SELECT run, sum(record) AS s, now() AS t, NULL AS n FROM records GROUP BY 1 ORDER BY 1"
    )
    assert document["columns"] == ["run", "s", "t", "n"]
    assert document["rows"][0][:2] == [FIRST, 3]
    assert FIRST in text("sql", "SELECT id FROM runs")


LONG_ANSWER = "SELECT range AS number, 'a' || range AS name FROM range(3000)"


def test_a_long_answer_is_whole_in_a_pipe(project: Path) -> None:
    lines = text("sql", LONG_ANSWER).splitlines()
    assert (lines[0], lines[1], lines[-1]) == ("number  name", "0       a0", "2999    a2999")
    assert len(lines) == 3001


@needs_posix("a pseudo-terminal")
def test_a_terminal_shows_the_first_rows_of_a_long_answer(project: Path) -> None:
    ours, theirs = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", "runs", "sql", LONG_ANSWER],
        cwd=project,
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=subprocess.PIPE,
    ) as process:
        os.close(theirs)
        shown = b""
        with suppress(OSError):  # Linux ends the output of a closed terminal with an error
            while piece := os.read(ours, 65536):
                shown += piece
        os.close(ours)
        assert process.stderr is not None
        said = process.stderr.read()
    assert b"a999" in shown
    assert b"a1000" not in shown
    assert b"The first 1000 of 3000 rows are shown. Redirect the output, or use '--json', to get all." in said


@pytest.mark.parametrize(("statement", "code"), [("SELECT count(*) FROM samples", 0), ("SELEC", 2)])
def test_a_query_leaves_nothing_else_on_stderr(project: Path, statement: str, code: int) -> None:
    """The database's bindings reported a hundred leaked objects at the end of every `runs sql`."""
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "runs", "sql", statement],
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert "nanobind" not in done.stderr
    assert done.stderr.count("\n") == (code != 0)


@pytest.mark.parametrize(
    ("arguments", "nearest"),
    [
        (["show", "20261121-093000-strike"], FIRST),
        (["sql", "SELECT * FROM recrods"], "records"),
        (["sql", "SELECT positon FROM samples"], "position"),
    ],
)
def test_a_mistyped_name_is_reported_with_the_nearest(
    project: Path, arguments: list[str], nearest: str
) -> None:
    with pytest.raises(RigctlError) as caught:
        text(*arguments)
    assert caught.value.nearest == nearest


@pytest.mark.parametrize("command", ["list", "show", "verify", "annotate", "exclude", "sql"])
def test_every_command_shows_an_example(command: str) -> None:
    assert f"rigctl runs {command}" in text(command, "--help")
