"""Faulty measured data, or a faulty choice of them, get clear messages from the commands."""

from __future__ import annotations

import random
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from commands import MODEL, answer, call, create_strokes, refusal, told
from rigctl.analysis import fitting
from rigctl.cli.main import main
from rigctl.errors import ExitCode

RIG = ("--rig", "rigs/hl32-bench.yaml")
TIME, RECORD, OIL, SUPPLY, POSITION, HEATER, VALVE, RELIEF = range(8)
EVERY = tuple(range(8))
Row = list[str]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with two strokes at 20 degC as a file of samples: whole.csv."""
    folder = create_strokes(tmp_path_factory.mktemp("bad-data"), "20 degC", seed=3)
    with chdir(folder):
        told("export", "latest", "-o", "whole.csv")
        shutil.rmtree("runs")
    return folder


@pytest.fixture(autouse=True)
def without_runs(inside: None) -> Iterator[None]:
    """No test sees the runs of another."""
    yield
    shutil.rmtree("runs", ignore_errors=True)


def write(
    columns: tuple[int, ...] = EVERY,
    edit: Callable[[Row, int], Row | None] = lambda row, _: row,
    rename: tuple[str, str] = ("", ""),
) -> str:
    """A file of the first two strokes with some of the columns, rows changed or (None) lost."""
    heading, *rows = (line.split(",") for line in Path("whole.csv").read_text("utf-8").splitlines())
    assert heading[OIL].startswith("oil")
    edited = [edit(row, k) for k, row in enumerate(row for row in rows if row[RECORD] in ("0", "1"))]
    lines = [heading, *(row for row in edited if row is not None)]
    text = "\n".join(",".join(line[column] for column in columns) for line in lines)
    Path("data.csv").write_text(text.replace(*rename) + "\n", "utf-8", newline="\n")
    return "data.csv"


def imported(*columns_and_edit: object) -> str:
    return str(answer("import", write(*columns_and_edit), *RIG)["run"])  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def position_only(bench: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The answers of compare and diagnose for a run with the position only."""
    with chdir(bench):
        run = imported((TIME, RECORD, POSITION, VALVE, RELIEF))
        asked = (run, "--model", MODEL)
        return answer("compare", *asked, "--no-fit"), answer("diagnose", *asked)


def test_unrecorded_channels_are_not_judged_and_listed_as_needed_by_untestable_effects(
    position_only: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    compared, found = position_only
    assert set(compared["channels"]) == {"position"}
    said = "not recorded: oil_temperature, supply_pressure; the model is judged without them"
    assert said in compared["notes"]
    needs = {one["effect"]: one["needs"] for one in found["untestable"]}
    assert needs["pressure_gain"] == "the channel supply_pressure"
    assert needs["thermocouple_lag"] == "the channel oil_temperature"
    assert "too weak for a verdict" in " ".join(found["evidence"])


def test_answers_have_the_documented_names(
    position_only: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    compared, diagnosed = position_only
    page = (Path(__file__).parents[2] / "docs" / "reference" / "json-answers.md").read_text("utf-8")
    of_model = documented(page, "| for each model |")
    assert set(documented(page, "| top level |")) - {"rivals"} | set(of_model) <= set(compared)
    assert set(of_model) <= set(compared["models"][0])
    for field, one in (
        ("tests", compared["tests"]["chi2"]),
        ("channels", compared["channels"]["position"]),
        ("where", compared["where"][0]),
        ("trends", compared["trends"][0]),
        ("slots", compared["slots"][0]),
    ):
        assert set(of_model[field]) - {"score", "plane", "chi2", "inputs"} <= set(one)
    of_diagnosis = documented(page, "| field |")
    assert set(of_diagnosis) <= set(diagnosed)
    # of a parameter; and a word that a field may hold
    inner = {"value", "unit", "std", "unusual", "record", "depends_on", "over_range"}
    assert set(of_diagnosis["ranking"]) - inner <= set(diagnosed["ranking"][0])


def documented(page: str, head: str) -> dict[str, list[str]]:
    """Of a table of the page: the names in each row's second cell, by the names in its first."""
    found = {}
    for line in page.partition(head)[2].partition("\n\n")[0].splitlines()[2:]:
        first, second = line.strip("| ").split(" | ", 1)
        for name in re.findall(r"`(\w+)`", first):
            found[name] = re.findall(r"`(\w+)`", second)
    return found


def test_a_run_without_any_channel_of_the_model_is_refused() -> None:
    run = imported((TIME, RECORD, VALVE, RELIEF, HEATER))
    said = refusal("compare", run, "--model", MODEL)
    assert "has no channel that the model 'hl32-textbook' predicts, got 'none'" in said
    assert "expected one of oil_temperature, supply_pressure, position" in said
    said = refusal("compare", imported(), "--model", "models/hl32-oil.yaml")
    assert "predicts, got 'oil_temperature, supply_pressure, position'" in said
    assert "expected one of kinematic_viscosity" in said


@pytest.mark.parametrize(
    ("columns", "absent"),
    [
        ((TIME, RECORD, POSITION, RELIEF), "'valve [1]'"),
        ((TIME, RECORD, POSITION, VALVE), "'relief_valve [bar]'"),
        ((TIME, RECORD, POSITION), "'valve [1]' and 'relief_valve [bar]'"),
    ],
)
def test_a_run_without_the_columns_of_commands_is_refused(columns: tuple[int, ...], absent: str) -> None:
    run = imported(columns)
    assert f"expected {absent} too" in refusal("compare", run, "--model", MODEL)
    assert f"expected {absent} too" in refusal("model", "fit", MODEL, run)


def test_records_with_gaps_and_irregular_sampling_are_compared_as_they_are() -> None:
    """Lost samples, a gap of 150 ms, lost readings and jittered times: the model still agrees."""
    chance = random.Random(1)

    def lost(row: Row, number: int) -> Row | None:
        if number % 37 == 0 or 500 < number < 515:
            return None
        row[TIME] = repr(float(row[TIME]) + chance.uniform(0.0, 0.004))
        row[OIL] = "" if number % 11 == 0 else row[OIL]
        return row

    file = write(EVERY, lost)
    done = call("import", file, *RIG)
    assert done.exit_code == 0, done.output
    assert "values are missing" in done.output
    assert "gaps in time in 1 of 2 records; the longest: 0.1" in done.output
    document = answer("compare", "latest", "--model", MODEL)
    assert document["adequate"] is True, document
    notes = "\n".join(document["notes"])
    assert "gaps in time in 1 of 2 records: what happened in them is not judged" in notes
    assert re.search(r"oil_temperature is missing in 6\d of 717 samples: they are left out", notes)


def test_time_that_goes_back_within_a_record_is_a_bad_row() -> None:
    file = write(EVERY, lambda row, k: ["0.5", *row[1:]] if k == 100 else row)
    said = refusal("import", file, *RIG)
    assert "data.csv:102: time: it does not increase within a record, got '0.5 s'; expected more than" in said
    assert "nothing was imported: 1 bad row" in said
    assert answer("import", file, *RIG, "--keep-good")["left_out"] == 1


def test_a_channel_that_never_changes_gets_its_noise_from_the_rig_file() -> None:
    run = imported(EVERY, lambda row, _: [*row[:OIL], "20", *row[SUPPLY:]])
    document = answer("compare", run, "--model", MODEL, "--no-fit")
    assert any("oil_temperature never changes" in note for note in document["notes"])
    assert any("only guessed for oil_temperature" in note for note in document["notes"])
    channel = document["channels"]["oil_temperature"]
    assert (channel["r2"], channel["noise_source"]) == (None, "rig")


@pytest.mark.parametrize(
    ("unit", "says"),
    [
        ("[bar]", "data.csv:1:62: position: wrong dimension, got 'bar'; expected a length, e.g. '100 mm'"),
        ("[mn]", "data.csv:1:62: unknown unit, got 'mn'"),
        ("", "data.csv:1:62: position: the unit is missing"),
    ],
)
def test_a_missing_or_unsuitable_unit_of_a_column_is_refused(unit: str, says: str) -> None:
    assert says in refusal("import", write(rename=(" [mm]", f" {unit}")), *RIG)


def test_nan_readings_are_counted_and_left_out_and_infinite_ones_refused() -> None:
    run = imported(EVERY, lambda row, k: [*row[:POSITION], "nan" if k % 7 == 0 else row[POSITION], *row[5:]])
    document = answer("compare", run, "--model", MODEL, "--no-fit")
    assert "position is missing in 108 of 752 samples: they are left out" in document["notes"]
    said = refusal(
        "import", write(EVERY, lambda row, k: [*row[:4], "inf" if not k else row[4], *row[5:]]), *RIG
    )
    assert "data.csv:2:" in said
    assert "position: not a number, got 'inf'; expected a finite number" in said


def first(count: int) -> Callable[[Row, int], Row | None]:
    """The first samples of the first stroke, all of the second."""
    return lambda row, k: None if row[RECORD] == "0" and k >= count else row


def test_records_with_too_few_samples_are_left_out() -> None:
    run = imported(EVERY, first(4))
    assert (
        f"1 record of {run} left out: fewer than 5 samples"
        in answer("compare", run, "-m", MODEL, "--no-fit")["notes"]
    )
    run = imported(EVERY, lambda row, k: row if k < 4 else None)
    said = refusal("compare", run, "--model", MODEL)
    assert f"no record of {run} can be used: of 1 record 0 are incomplete or excluded" in said
    assert "1 have no value or fewer than 5 samples" in said


def test_too_many_samples_are_thinned_with_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    run = imported()
    monkeypatch.setattr("rigctl.model.measured.read._MOST_SAMPLES", 300)
    monkeypatch.setattr("rigctl.model.measured.read._LEAST_OF_A_RECORD", 180)
    document = answer("compare", run, "--model", MODEL)
    said = "more than 300 samples: one in 3 is looked at, of no record fewer than 180"
    assert said in document["notes"]
    assert document["adequate"] is True
    assert document["tests"]["chi2"]["freedom"] < 3 * 2 * 188


@pytest.mark.parametrize("command", ["compare", "diagnose"])
def test_contradictory_selections_of_records_are_refused(command: str) -> None:
    run = imported()
    asked = (command, run, "--model", MODEL)
    low, high = "supply < 25 bar", "supply > 25 bar"
    assert f"no record is held out by this of those that '{low}' leaves" in refusal(
        *asked, "--only", low, "--hold-out", high
    )
    assert f"this holds every record out of those that '{low}' leaves" in refusal(
        *asked, "--only", low, "--hold-out", low
    )
    assert "no record is chosen by this, got 'supply > 90 bar'; expected" in refusal(
        *asked, "--only", "supply > 90 bar"
    )
    assert "this holds every record out: nothing is left to fit on" in refusal(
        *asked, "--hold-out", "record > 0"
    )


def test_a_misspelt_model_is_reported_with_the_nearest_name() -> None:
    said = refusal("compare", imported(), "--model", "models/hl32-textbok.yaml")
    assert (
        "there is no such file, got 'models/hl32-textbok.yaml'; did you mean 'models/hl32-textbook.yaml'?"
        in said
    )


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (["compare", "--model", MODEL], "nothing was saved"),
        (["diagnose", "--model", MODEL], "nothing was saved"),
        (["diagnose", "--model", MODEL, "--apply"], "the steps saved so far are kept"),
        (["model", "fit", MODEL], "nothing was saved"),
    ],
)
def test_ctrl_c_prints_what_was_not_done_and_exits_as_interrupted(
    command: list[str], says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    run = imported()
    monkeypatch.setattr(fitting, "read_measurements", interrupted)
    monkeypatch.setattr(sys, "argv", ["rigctl", *command, run])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == ExitCode.INTERRUPTED
    assert capsys.readouterr().err.endswith(f"rigctl: Stopped; {says}\n")
