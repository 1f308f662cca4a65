from __future__ import annotations

import errno
import hashlib
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

import rigctl.dataset.recording.writer as writer_module
from dataset.strokes import LAYOUT, STARTED, measure_strokes, sample
from rigctl.dataset import RunHeader, RunWriter, open_run, verify
from rigctl.dataset.recording.journal import read_journal
from rigctl.dataset.recording.log import read_lines
from rigctl.errors import ExitCode, RigctlError
from rigctl.plan.measured import MeasuredValue


def rows_on_disk(writer: RunWriter) -> int:
    found = read_journal(writer.folder / "samples.journal")
    return found.rows(len(writer.header.layout.columns))


def test_a_closed_run_has_five_files_and_passes_verification(writer: RunWriter) -> None:
    measure_strokes(writer)
    folder = writer.close("finished")
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["events.parquet", "log.jsonl", "records.parquet", "run.json", "samples.parquet"]
    assert verify(folder).condition.value == "whole"
    assert writer.close("finished") == folder  # idempotent


def test_run_json_has_the_metadata_measures_and_files_of_the_run(writer: RunWriter) -> None:
    measure_strokes(writer, records=2)
    writer.measure(MeasuredValue("viscosity", 3.2e-5, "cSt"))
    info = json.loads((writer.close("failed", "heat timed out") / "run.json").read_text(encoding="utf-8"))
    assert info["id"] == "20261121-093000-stroke"
    assert (info["status"], info["reason"]) == ("failed", "heat timed out")
    assert info["procedure"]["text"] == "procedure: stroke\n"
    assert info["procedure"]["sha256"] == hashlib.sha256(b"procedure: stroke\n").hexdigest()
    assert info["backend"] == {"kind": "simulated", "firmware": "1.2"}
    assert (info["operator"], info["clock"], info["seed"]) == ("Ada", "virtual", 7)
    assert (info["started"], info["ended"]) == (STARTED.isoformat(), "2026-11-21T09:30:01.500000+00:00")
    assert (info["records"], info["complete_records"], info["rows"]) == (2, 2, 42)
    assert info["calibrations"]["position"]["date"] == "2026-01-02"
    assert info["measures"][0]["name"] == "viscosity"
    assert info["measures"][0]["value"] == pytest.approx(32.0)
    assert set(info["files"]) == {"samples.parquet", "records.parquet", "events.parquet", "log.jsonl"}


def test_samples_are_in_display_units_with_unit_kind_and_calibration(writer: RunWriter) -> None:
    import pyarrow.parquet as pq

    measure_strokes(writer, records=1)
    schema = pq.read_schema(writer.close("finished") / "samples.parquet")
    assert tuple(schema.names) == LAYOUT.columns
    facts = schema.field("position").metadata
    assert (facts[b"unit"], facts[b"kind"], facts[b"quantity"]) == (b"mm", b"channel", b"position")
    assert len(facts[b"calibration"]) == 12
    assert schema.field("valve").metadata[b"kind"] == b"command"
    frame = open_run(writer.folder).samples()
    assert frame.attrs["units"]["oil_temperature"] == "degC"
    assert frame["oil_temperature"].tolist() == pytest.approx([40.0] * 21)
    assert frame["position"].tolist()[-1] == pytest.approx(19.0)
    assert frame["record"].tolist() == [-1] + [0] * 20


def test_rows_and_blocks_keep_their_order(writer: RunWriter) -> None:
    writer.append(sample(0.0))
    writer.append_block(np.array([sample(0.1), sample(0.2)]))
    writer.append(sample(0.3))
    writer.append_block(np.empty((0, 7)))
    assert open_run(writer.close("finished")).signals("time").tolist() == [0.0, 0.1, 0.2, 0.3]


def test_missing_values_stay_missing(writer: RunWriter) -> None:
    writer.append(sample(0.0, position=math.nan))
    frame = open_run(writer.close("finished")).samples()
    assert frame["position"].isna().tolist() == [True]


def test_a_row_is_written_to_disk_within_half_a_second(
    writer: RunWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = writer_module.monotonic()
    monkeypatch.setattr(writer_module, "monotonic", lambda: now)
    writer.flush()
    writer.append(sample(0.0))
    assert rows_on_disk(writer) == 0
    monkeypatch.setattr(writer_module, "monotonic", lambda: now + 0.5)
    writer.append(sample(0.1))
    assert rows_on_disk(writer) == 2
    writer.append(sample(0.2))
    monkeypatch.setattr(writer_module, "monotonic", lambda: now + 1.0)
    writer.event(0.3, "note", message="any call lets waiting rows go")
    assert rows_on_disk(writer) == 3
    writer.close("finished")


def test_a_record_that_is_closed_is_on_disk(writer: RunWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "monotonic", lambda: 0.0)
    measure_strokes(writer, records=1)
    assert rows_on_disk(writer) == 21
    assert read_lines(writer.folder / "log.jsonl")[-1]["outcome"] == "complete"
    writer.close("finished")


def test_the_journal_is_synced_to_disk_between_records_and_at_their_end(
    writer: RunWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = writer_module.monotonic()
    synced = []
    monkeypatch.setattr(writer._journal, "sync", lambda: synced.append(now))

    def at(seconds: float) -> None:
        nonlocal now
        now += seconds
        monkeypatch.setattr(writer_module, "monotonic", lambda: now)

    at(9.0)
    writer.append(sample(9.0))
    assert len(synced) == 0
    at(1.0)
    writer.append(sample(10.0))
    assert len(synced) == 1
    writer.open_record(10.0, "stroke", {}, "1", 100.0)
    at(20.0)
    writer.append(sample(30.0, 0))
    assert len(synced) == 1
    writer.close_record(30.0, "complete")
    assert len(synced) == 2
    measure_strokes(writer)
    assert len(synced) == 2
    writer.close("finished")


def test_both_files_of_a_run_are_synced_to_disk_at_its_end(
    writer: RunWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a power failure a moment later must not lose."""
    files = {writer._journal._file.fileno(): "journal", writer._log._file.fileno(): "log"}
    synced = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(files.get(descriptor)))
    writer.flush(sync=True)
    assert synced == ["journal", "log"]
    writer.close("finished")


def test_records_carry_sweep_values_and_measures_in_their_units(writer: RunWriter) -> None:
    measure_strokes(writer, records=2)
    run = open_run(writer.close("finished"))
    assert run.records["oil"].tolist() == [20.0, 30.0]
    assert run.records["supply"].tolist() == [30.0, 30.0]
    assert run.records["stroke"].tolist() == [20.0, 20.0]
    assert run.records["stroke_passed"].tolist() == [True, True]
    assert run.records["start"].tolist() == [0.1, 1.1]
    assert run.records.attrs["units"]["supply"] == "bar"
    assert run.record(1).sweep == pytest.approx({"oil": 303.15, "supply": 30e5})
    assert run.record(1).measures == pytest.approx({"stroke": 0.02})


def test_a_sweep_variable_named_like_a_column_gets_a_separate_column(writer: RunWriter) -> None:
    writer.open_record(0.0, "stroke", {"rate": (2.0, "1"), "name": (1.0, "1")}, "1", 100.0)
    writer.measure(MeasuredValue("rate", 5.0, "Hz"))
    writer.close_record(1.0, "complete")
    run = open_run(writer.close("finished"))
    assert run.records[["rate", "rate_", "rate__", "name_"]].to_numpy().tolist() == [[100.0, 2.0, 5.0, 1.0]]
    assert run.record(0).sweep == {"rate": 2.0, "name": 1.0}
    assert run.record(0).measures == {"rate": 5.0}


def test_events_have_their_record_and_are_in_the_order_of_time(writer: RunWriter) -> None:
    writer.event(0.0, "state", state="running")
    writer.open_record(1.0, "stroke", {}, "1", 100.0)
    writer.event(1.5, "step", path="1/2", message="extend for 1.05 s")
    writer.event(1.2, "command", actuator="valve", value=1.0, uncertainty=0.0)
    writer.close_record(2.0, "complete")
    events = open_run(writer.close("finished")).events
    rows = events[["time", "kind", "record", "path", "message"]].to_numpy().tolist()
    assert [row[:3] for row in rows] == [
        [0.0, "session", -1],
        [0.0, "state", -1],
        [1.0, "record", 0],
        [1.2, "command", 0],
        [1.5, "step", 0],
        [2.0, "record", 0],
        [2.0, "end", -1],
    ]
    assert rows[4][3:] == ["1/2", "extend for 1.05 s"]
    assert json.loads(events["data"][3])["actuator"] == "valve"


def test_two_runs_of_one_second_have_separate_folders(runs: Path, make_header: object) -> None:
    header: RunHeader = make_header()  # type: ignore[operator]
    writers = [RunWriter.create(runs, header) for _ in range(3)]
    ids = [writer.close("finished").name for writer in writers]
    assert ids == [header.id, f"{header.id}-2", f"{header.id}-3"]
    assert [open_run(run_id, runs).id for run_id in ids] == ids
    assert not list(runs.glob(".*"))


def test_a_run_id_taken_at_the_last_moment_is_replaced_by_the_next_free_one(
    runs: Path, make_header: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    header: RunHeader = make_header()  # type: ignore[operator]
    taken = runs / header.id
    taken.mkdir(parents=True)
    (taken / "precious").write_text("data", encoding="utf-8")
    answers = iter([header.id, f"{header.id}-2"])
    monkeypatch.setattr(writer_module, "free_run_id", lambda *_: next(answers))
    writer = RunWriter.create(runs, header)
    assert writer.id == f"{header.id}-2"
    assert [path.name for path in taken.iterdir()] == ["precious"]
    writer.close("finished")


def test_a_folder_that_cannot_be_created_is_reported(tmp_path: Path, make_header: object) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    with pytest.raises(RigctlError, match="cannot make a folder for the run") as caught:
        RunWriter.create(blocked / "runs", make_header())  # type: ignore[operator]
    assert caught.value.exit_code is ExitCode.USAGE


def test_a_start_without_a_time_zone_is_refused(make_header: object) -> None:
    with pytest.raises(ValueError, match="time zone"):
        make_header(started=STARTED.replace(tzinfo=None))  # type: ignore[operator]


class BrokenDisk:
    """A file that accepts no data while `full`."""

    full = True

    def __init__(self, file: object) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return int(self._file.write(data))  # type: ignore[attr-defined]

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


def fill_disk(writer: RunWriter) -> tuple[BrokenDisk, BrokenDisk]:
    disks = BrokenDisk(writer._journal._file), BrokenDisk(writer._log._file)
    writer._journal._file, writer._log._file = disks  # type: ignore[assignment]
    return disks


def test_a_full_disk_is_reported_once_and_written_data_are_kept(writer: RunWriter) -> None:
    measure_strokes(writer, records=2)
    fill_disk(writer)
    writer.append(sample(5.0))
    with pytest.raises(RigctlError, match="No space left") as caught:
        writer.flush()
    assert caught.value.exit_code is ExitCode.FAILED
    for _ in range(3):  # the cleanup continues undisturbed
        writer._due = 0.0
        writer.append(sample(6.0))
        writer.event(6.0, "state", state="safe")
    with pytest.raises(RigctlError, match="No space left"):
        writer.close("failed", "disk full")
    verdict = verify(writer.folder)
    assert verdict.condition.value == "recovered"
    run = open_run(writer.folder)
    assert (run.info["status"], run.info["rows"], len(run.usable)) == ("interrupted", 42, 2)


def test_rows_kept_in_memory_are_written_when_the_disk_has_room_again(writer: RunWriter) -> None:
    disks = fill_disk(writer)
    writer.append(sample(0.0))
    with pytest.raises(RigctlError):
        writer.flush()
    writer.append(sample(0.1))
    writer.open_record(0.2, "stroke", {}, "1", 100.0)
    writer.append(sample(0.2, 0))
    writer.close_record(0.3, "failed")
    for disk in disks:
        disk.full = False
    run = open_run(writer.close("failed", "disk full"))
    assert run.signals("time").tolist() == [0.0, 0.1, 0.2]
    assert run.records["outcome"].tolist() == ["failed"]
    assert run.info["reason"] == "disk full"


def test_opening_a_second_record_or_closing_none_is_an_error(writer: RunWriter) -> None:
    with pytest.raises(ValueError, match="no record is open"):
        writer.close_record(0.0, "complete")
    writer.open_record(0.0, "stroke", {}, "1", 100.0)
    with pytest.raises(ValueError, match="record 0 is still open"):
        writer.open_record(0.0, "stroke", {}, "1", 100.0)
    writer.close("finished")


def test_the_same_session_gives_the_same_bytes(runs: Path, make_header: object) -> None:
    contents = []
    for _ in range(2):
        writer = RunWriter.create(runs, make_header())  # type: ignore[operator]
        measure_strokes(writer)
        contents.append((writer.close("finished") / "samples.parquet").read_bytes())
    assert contents[0] == contents[1]
