from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rigctl.dataset import RunHeader, RunWriter, find_run, list_runs
from rigctl.errors import RigctlError

RunMaker = Callable[..., Path]


@pytest.fixture
def three(make_run: RunMaker) -> list[Path]:
    names = ("20261120-080000-heat", "20261121-093000-stroke", "20261121-093000-stroke-2")
    return [make_run(name, records=1, rows=2) for name in names]


def test_a_run_is_found_by_id_start_path_and_latest(three: list[Path], runs: Path) -> None:
    assert find_run("20261121-093000-stroke", runs) == three[1]
    assert find_run("20261120", runs) == three[0]
    assert find_run(three[2]) == three[2].resolve()
    assert find_run(three[2] / "run.json") == three[2].resolve()
    assert find_run("latest", runs) == three[2]


def test_numbered_runs_of_one_second_stay_in_order(make_run: RunMaker, runs: Path) -> None:
    made = [make_run(records=0) for _ in range(12)]
    assert [summary.folder for summary in list_runs(runs)] == made
    assert find_run("latest", runs) == made[-1]


def test_runs_of_one_second_are_in_the_order_in_which_they_began(
    runs: Path, make_header: Callable[..., RunHeader]
) -> None:
    began = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)
    for name, after in (("strokes", 0.2), ("another", 0.4), ("heater", 0.1)):
        header = make_header(f"20261121-093000-{name}", started=began + timedelta(seconds=after))
        RunWriter.create(runs, header).close("finished")
    names = [summary.id.rpartition("-")[2] for summary in list_runs(runs)]
    assert names == ["heater", "strokes", "another"]


def test_an_ambiguous_start_of_an_id_lists_the_candidates(three: list[Path], runs: Path) -> None:
    with pytest.raises(RigctlError, match="several runs") as caught:
        find_run("20261121", runs)
    assert "20261121-093000-stroke-2" in str(caught.value.expected)


def test_an_unknown_run_is_reported_with_the_nearest(three: list[Path], runs: Path) -> None:
    with pytest.raises(RigctlError, match="no such run") as caught:
        find_run("20261120-080000-haet", runs)
    assert caught.value.nearest == "20261120-080000-heat"


def test_a_wrong_start_or_procedure_names_the_newest_that_is_near(three: list[Path], runs: Path) -> None:
    for ref, nearest in (("20261129", "20261121-093000-stroke-2"), ("haet", "20261120-080000-heat")):
        with pytest.raises(RigctlError, match="no such run") as caught:
            find_run(ref, runs)
        assert caught.value.nearest == nearest
    with pytest.raises(RigctlError) as caught:
        find_run("nothing like it", runs)
    assert caught.value.nearest is None


@pytest.mark.parametrize("ref", ["latest", "", "x"])
def test_without_runs_the_message_says_how_to_make_one(runs: Path, ref: str) -> None:
    with pytest.raises(RigctlError, match="there are no runs"):
        find_run(ref, runs)
    assert list_runs(runs) == []


def test_listing_runs_reads_only_run_json(three: list[Path], runs: Path) -> None:
    for folder in three:
        for path in folder.iterdir():
            if path.name != "run.json":
                path.unlink()
    rows = [(run.status, run.procedure, run.records, run.rows) for run in list_runs(runs)]
    assert rows == [("finished", "stroke", 1, 3)] * 3


def test_running_unclosed_and_damaged_runs_are_listed_as_such(
    writer: RunWriter, make_run: RunMaker, runs: Path
) -> None:
    assert [run.status for run in list_runs(runs)] == ["running"]
    writer._lock.release()
    assert [run.status for run in list_runs(runs)] == ["unclosed"]
    (make_run("20261122-000000-a") / "run.json").write_text("{", encoding="utf-8")
    assert [run.status for run in list_runs(runs)] == ["unclosed", "damaged"]


def test_other_folders_are_not_listed_as_runs(three: list[Path], runs: Path) -> None:
    (runs / "notes").mkdir()
    (runs / "README.md").write_text("", encoding="utf-8")
    (runs / ".new-abc").mkdir()
    (runs / ".new-abc" / "run.json").write_text("{}", encoding="utf-8")
    assert [run.folder for run in list_runs(runs)] == three
