from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from dataset.strokes import measure_strokes, sample
from rigctl.dataset import RunWriter, open_run, verify
from rigctl.dataset.recording import samples_file as samples_module
from rigctl.dataset.recording.finalise import finalise
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
