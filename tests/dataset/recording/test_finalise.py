from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from dataset.strokes import STARTED, measure_strokes, sample
from rigctl.dataset import RunWriter, open_run, verify
from rigctl.dataset.annotations import append_annotations, say
from rigctl.dataset.recording import finalise as finalise_module
from rigctl.dataset.recording import samples_file as samples_module
from rigctl.dataset.recording import writer as writer_module
from rigctl.dataset.recording.finalise import finalise, recovered_history
from rigctl.dataset.recording.journal import read_journal
from rigctl.dataset.recording.log import read_lines
from rigctl.dataset.recording.writer_lock import lock_folder
from rigctl.errors import ExitCode, RigctlError


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def unclosed(writer: RunWriter) -> Path:
    """A folder as a kill leaves it: a record open, the log's last line torn, no tables."""
    measure_strokes(writer, records=2)
    writer.open_record(3.0, "stroke", {"oil": (313.15, "degC")}, "2/record", 100.0)
    writer.append(sample(3.0, 2))
    writer.append(sample(3.01, 2))
    writer.flush()
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    with (writer.folder / "log.jsonl").open("ab") as log:
        log.write(b'{"time": 3.2, "kind": "rec')
    with (writer.folder / "samples.journal").open("ab") as journal:
        journal.write(b"torn")
    return writer.folder


def test_finalising_identical_folders_gives_identical_bytes(unclosed: Path, tmp_path: Path) -> None:
    twin = tmp_path / "twin" / unclosed.name
    shutil.copytree(unclosed, twin)
    finalise(unclosed)
    finalise(twin)
    assert contents(unclosed) == contents(twin)


def test_a_run_left_by_a_kill_is_finalised_as_interrupted(unclosed: Path) -> None:
    finalise(unclosed)
    run = open_run(unclosed)
    assert run.info["status"] == "interrupted"
    assert "without closing" in run.info["reason"]
    assert run.info["lost_bytes"] == 4
    assert run.records["outcome"].tolist() == ["complete", "complete", "interrupted"]
    assert run.records["end"].tolist() == [0.5, 1.5, 3.01]
    assert run.usable == (0, 1)
    assert run.signals("time", 2).tolist() == [3.0, 3.01]


STAGES = ("samples.parquet", "records.parquet", "events.parquet", "run.json", "journal")


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize("when", ["before", "after"])
def test_finalising_can_be_interrupted_at_any_stage_and_repeated(
    unclosed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, when: str
) -> None:
    twin = tmp_path / "twin" / unclosed.name
    shutil.copytree(unclosed, twin)
    finalise(twin)
    interrupt_at(monkeypatch, stage, when)
    with pytest.raises(KeyboardInterrupt):
        finalise(unclosed)
    monkeypatch.undo()
    finalise(unclosed)
    found, expected = contents(unclosed), contents(twin)
    assert found.keys() == expected.keys()
    assert {name for name in found if found[name] != expected[name]} == set()
    assert verify(unclosed).condition.value == "whole"
    assert open_run(unclosed).signals("time").tolist() == open_run(twin).signals("time").tolist()


def interrupt_at(monkeypatch: pytest.MonkeyPatch, stage: str, when: str) -> None:
    """Stop with an exception before or after a file is put in its place."""
    if stage == "journal":
        replaced, name = Path.rename, "rename"  # it is torn, so it is kept
    else:
        replaced, name = Path.replace, "replace"

    def wrapped(path: Path, *args: object, **kwargs: object) -> object:
        target = Path(str(args[0])).name if name == "replace" else path.name
        hit = target == ("samples.journal" if stage == "journal" else stage)
        if hit and when == "before":
            raise KeyboardInterrupt
        done = replaced(path, *args, **kwargs)  # type: ignore[operator]
        if hit:
            raise KeyboardInterrupt
        return done

    monkeypatch.setattr(Path, name, wrapped)


def test_the_journal_is_kept_when_the_new_file_does_not_read_back_correctly(
    unclosed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = iter(range(100))
    monkeypatch.setattr(samples_module, "_checksum", lambda _: str(next(calls)))
    with pytest.raises(RigctlError, match="read back") as caught:
        finalise(unclosed)
    assert caught.value.exit_code is ExitCode.FAILED
    assert (unclosed / "samples.journal").exists()
    assert not (unclosed / "samples.parquet").exists()
    assert not list(unclosed.glob(".*"))


def test_a_run_without_a_sample_has_empty_tables(writer: RunWriter) -> None:
    run = open_run(writer.close("aborted", "before it began"))
    assert (len(run.samples()), len(run.records), run.usable) == (0, 0, ())
    assert run.samples().columns.tolist() == list(run.layout.columns)


def test_a_kill_before_the_journal_has_its_first_frame_is_a_run_without_samples(
    writer: RunWriter, make_run: Callable[..., Path]
) -> None:
    writer.close("finished")
    path = make_run("20261121-100000-other", records=0)
    (path / "samples.parquet").unlink()
    (path / "samples.journal").write_bytes(b"RIGJ")
    assert verify(path).condition.value == "recovered"
    assert open_run(path).info["rows"] == 0


def test_many_samples_are_divided_into_row_groups(writer: RunWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    import pyarrow.parquet as pq

    monkeypatch.setattr(samples_module, "GROUP_ROWS", 16)
    measure_strokes(writer, records=3)
    folder = writer.close("finished")
    assert pq.ParquetFile(folder / "samples.parquet").metadata.num_row_groups == 4
    run = open_run(folder)
    assert [len(run.record(index).time) for index in range(3)] == [20, 20, 20]
    assert run.signals("position", 1).tolist() == pytest.approx([0.001 * row for row in range(20)])


# --- what is missing from a run that came to its end ---------------------------------------------------


@pytest.fixture
def no_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are closed, but their tables not made yet; rows are flushed between records only."""
    monkeypatch.setattr(RunWriter, "_make_tables", lambda _: None)
    monkeypatch.setattr(writer_module, "monotonic", lambda: 0.0)


def kill(writer: RunWriter) -> Path:
    """What the system does to a program that is killed: its files are closed, its locks are gone."""
    writer.flush()
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    return writer.folder


def cut_out(folder: Path, *numbers: int) -> bytes:
    """Remove whole frames of a journal; return its content."""
    path = folder / "samples.journal"
    content = path.read_bytes()
    for frame in reversed([read_journal(path).frames[number] for number in numbers]):
        content = content[: frame.start - 32] + content[frame.start + frame.length :]
    path.write_bytes(content)
    return content


def spoil_first_frame(folder: Path) -> None:
    path = folder / "samples.journal"
    content = bytearray(path.read_bytes())
    content[60] ^= 1
    path.write_bytes(content)


def files_of(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("samples.*"))


@pytest.mark.usefixtures("no_tables")
@pytest.mark.parametrize(
    ("cut", "lost", "told", "damaged"),
    [
        ([5], 20, "20 samples, of record 2 are lost", [2]),  # what is missing at the end has no gap
        ([2], 1, "1 sample is lost", []),  # between two records
        ([1, 3], 40, "40 samples, of record 0, 1 are lost", [0, 1]),
        ([3, 4], 21, "21 samples, of record 1 are lost", [1]),
    ],
)
def test_frames_that_are_missing_are_counted_and_their_journal_is_kept(
    writer: RunWriter, cut: list[int], lost: int, told: str, damaged: list[int]
) -> None:
    """Each record follows one row of its own; what is left of the journal reads without an error."""
    measure_strokes(writer)
    folder = writer.close("finished")
    left = cut_out(folder, *cut)
    info = finalise(folder)
    assert info["reason"] == f"files of the run were damaged while it was in progress: {told}"
    assert (info["status"], info["lost_rows"], info["rows"]) == ("finished", lost, 63 - lost)
    assert info["complete_records"] == 3 - len(damaged)
    outcomes = open_run(folder).records["outcome"].tolist()
    assert [index for index, outcome in enumerate(outcomes) if outcome == "damaged"] == damaged
    assert files_of(folder) == ["samples.journal.damaged-0", "samples.parquet"]
    assert (folder / "samples.journal.damaged-0").read_bytes() == left


@pytest.mark.usefixtures("no_tables")
def test_one_missing_sample_damages_its_record(writer: RunWriter) -> None:
    writer.open_record(0.0, "stroke", {}, "1", 100.0)
    for row in range(3):
        writer.append(sample(0.1 * row, 0))
        writer.flush()
    writer.close_record(1.0, "complete")
    folder = writer.close("finished")
    cut_out(folder, 1)
    info = finalise(folder)
    assert (info["lost_rows"], info["complete_records"]) == (1, 0)
    assert "1 sample, of record 0 is lost" in info["reason"]
    assert files_of(folder) == ["samples.journal.damaged-0", "samples.parquet"]


@pytest.mark.usefixtures("no_tables")
@pytest.mark.parametrize("frames", [[], [5]])
def test_a_lost_line_of_the_log_is_told(writer: RunWriter, frames: list[int]) -> None:
    measure_strokes(writer)
    writer.event(5.0, "note", message="an oil leak")
    folder = writer.close("finished")
    cut_out(folder, *frames)
    path = folder / "log.jsonl"
    path.write_bytes(path.read_bytes().replace(b"oil leak", b"oil lake"))
    info = finalise(folder)
    one = "1 line of its log"
    told = f"20 samples, of record 2 and {one} are lost" if frames else f"{one} is lost"
    assert info["reason"] == f"files of the run were damaged while it was in progress: {told}"
    assert len(info["damaged_lines"]) == 1
    assert info["complete_records"] == 3 - len(frames)
    assert ("samples.journal.damaged-0" in files_of(folder)) is bool(frames)


@pytest.mark.usefixtures("no_tables")
def test_damage_does_not_replace_the_reason_of_a_run_that_failed(writer: RunWriter) -> None:
    measure_strokes(writer)
    folder = writer.close("failed", "the oil was too hot")
    cut_out(folder, 5)
    info = finalise(folder)
    assert (info["reason"], info["lost_rows"]) == ("the oil was too hot", 20)


def test_a_whole_run_has_lost_nothing(make_run: Callable[..., Path]) -> None:
    info = open_run(make_run()).info
    assert (info["format"], info["reason"]) == (2, None)
    assert (info["lost_rows"], info["lost_bytes"], info["damaged_lines"]) == (0, 0, [])
    assert "absences" not in info


# --- several sessions ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_tables")
def test_damage_of_an_earlier_session_is_not_told_of_the_last(writer: RunWriter) -> None:
    measure_strokes(writer)
    folder = kill(writer)
    cut_out(folder, 5)
    later = RunWriter.reopen(folder)
    measure_strokes(later, records=1)
    later.close("finished")
    info = finalise(folder)
    assert (info["status"], info["reason"], info["lost_rows"]) == ("finished", None, 20)
    assert files_of(folder) == ["samples.journal.damaged-0", "samples.parquet"]
    assert open_run(folder).records["outcome"].tolist() == ["complete", "complete", "damaged", "complete"]


@pytest.mark.usefixtures("no_tables")
def test_damage_of_the_last_session_names_its_own_records(writer: RunWriter) -> None:
    """Where the first frame of its journal is damaged as well, its place in time is that in the log."""
    measure_strokes(writer, records=1)
    kill(writer)
    for session in (1, 2):
        later = RunWriter.reopen(writer.folder)
        measure_strokes(later, records=2)
        if session == 1:
            kill(later)
    later.close("finished")
    spoil_first_frame(writer.folder)
    cut_out(writer.folder, 3)
    began = [line["offset"] for line in read_lines(writer.folder / "log.jsonl") if line and "offset" in line]
    info = finalise(writer.folder)
    assert "20 samples, of record 4 are lost" in info["reason"]
    run = open_run(writer.folder)
    assert run.record(3).time[0] == pytest.approx(began[2] + 0.1)
    assert began[2] > began[1] > 1.0
    assert files_of(writer.folder) == ["samples.journal.damaged-2", "samples.parquet"]


@pytest.mark.usefixtures("no_tables")
def test_samples_are_kept_where_the_log_has_only_its_first_line(writer: RunWriter) -> None:
    """A kill at the very start, and a file system that lost the rest of the log."""
    writer.append(sample(0.5))
    folder = kill(writer)
    spoil_first_frame(folder)
    path = folder / "log.jsonl"
    path.write_bytes(path.read_bytes().split(b"\n")[0] + b"\n")
    info = finalise(folder)
    assert (info["status"], info["rows"], info["sessions"]) == ("interrupted", 1, [])
    assert open_run(folder).signals("time").tolist() == [0.5]
    assert files_of(folder) == ["samples.journal.damaged-0", "samples.parquet"]


# --- imports, absences, logs of earlier versions -------------------------------------------------------


def test_a_bench_s_time_begins_with_the_run_and_a_file_s_with_its_first_row(
    runs: Path, make_header: Callable[..., Any]
) -> None:
    for source, duration in (("bench", 107.5), ("import", 7.5)):
        writer = RunWriter.create(runs, make_header(f"20261121-093000-{source}", source=source))
        writer.event(101.5, "note", message="later")
        writer.event(101.2, "note", message="earlier")
        for time in (100.0, 107.5):
            writer.append(sample(time))
        run = open_run(writer.close("finished"))
        assert run.info["duration"] == duration
        assert run.info["ended"] == (STARTED + timedelta(seconds=duration)).isoformat()
        notes = run.events.loc[run.events["kind"] == "note", "message"].tolist()
        assert notes == (["later", "earlier"] if source == "import" else ["earlier", "later"])


def test_an_import_without_a_row_lasts_as_long_as_its_events(
    runs: Path, make_header: Callable[..., Any]
) -> None:
    writer = RunWriter.create(runs, make_header(source="import"))
    writer.event(3.0, "note", message="empty")
    assert open_run(writer.close("finished")).info["duration"] == 3.0


def test_absences_of_a_device_are_in_run_json(writer: RunWriter) -> None:
    writer.event(1.0, "gap", device="meter", lost="pause", message="meter: gone")
    writer.event(4.0, "note", back="meter", message="meter: back")
    writer.event(5.0, "gap", device="meter", lost="continue", message="meter: gone")
    assert open_run(writer.close("finished")).info["absences"] == [
        {"device": "meter", "lost": "pause", "begin": 1.0, "end": 4.0},
        {"device": "meter", "lost": "continue", "begin": 5.0, "end": None},
    ]


@pytest.mark.usefixtures("no_tables")
@pytest.mark.parametrize("source", ["bench", "import"])
def test_a_record_without_samples_is_incomplete_in_logs_that_do_not_count_them(
    runs: Path, make_header: Callable[..., Any], source: str
) -> None:
    """Logs of earlier versions. A record that was too short for two samples may well have none."""
    writer = RunWriter.create(runs, make_header(source=source))
    for number, lasts in enumerate((0.5, 0.5, 0.25)):
        writer.open_record(10.0 + number, "stroke", {}, f"{number}", 4.0)
        if number == 0:
            writer.append(sample(10.0, 0))
        writer.close_record(10.0 + number + lasts, "complete")
    writer.open_record(20.0, "stroke", {}, "3", 4.0)
    folder = kill(writer)
    path = folder / "log.jsonl"
    lines = [line for line in read_lines(path) if line is not None]
    older = [{key: value for key, value in line.items() if key != "rows"} for line in lines]
    path.write_bytes(b"".join(json.dumps(line).encode() + b"\n" for line in older))
    assert finalise(folder)["lost_rows"] == (1 if source == "bench" else 0)
    outcomes = ["complete", "damaged" if source == "bench" else "complete", "complete", "interrupted"]
    assert open_run(folder).records["outcome"].tolist() == outcomes
    assert [entry.outcome for entry in recovered_history(folder).records] == outcomes


def test_an_annotation_that_arrives_meanwhile_is_in_the_tables(
    unclosed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another program adds it, which needs no lock."""
    write, added = finalise_module.write_table, []

    def meanwhile(path: Path, table: object) -> None:
        write(path, table)  # type: ignore[arg-type]
        if path.name == "records.parquet" and not added:
            added.append(path)
            append_annotations(unclosed, [say("exclude", "operator leant on the bench", 0)])

    monkeypatch.setattr(finalise_module, "write_table", meanwhile)
    finalise(unclosed)
    assert open_run(unclosed).usable == (1,)
    assert verify(unclosed).condition.value == "whole"


# --- the history of a run that is resumed --------------------------------------------------------------


def test_the_history_of_a_closed_run_is_only_read(make_run: Callable[..., Path]) -> None:
    folder = make_run()
    with lock_folder(folder):  # another program makes its tables
        assert [entry.outcome for entry in recovered_history(folder).records] == ["complete"] * 3


@pytest.mark.usefixtures("no_tables")
def test_the_history_of_a_run_that_was_killed_again_has_all_its_samples(writer: RunWriter) -> None:
    measure_strokes(writer, records=1)
    kill(writer)
    later = RunWriter.reopen(writer.folder)
    measure_strokes(later, records=1)
    kill(later)
    assert [entry.outcome for entry in recovered_history(writer.folder).records] == ["complete"] * 2
    assert files_of(writer.folder) == ["samples.parquet"]


@pytest.mark.usefixtures("no_tables")
def test_the_history_of_a_run_without_a_file_of_samples_has_no_complete_record(writer: RunWriter) -> None:
    measure_strokes(writer)
    (kill(writer) / "samples.journal").unlink()
    assert [entry.outcome for entry in recovered_history(writer.folder).records] == ["damaged"] * 3
