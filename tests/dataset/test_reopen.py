from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import pytest

from dataset.strokes import LAYOUT, STARTED, measure_strokes, sample
from rigctl.dataset import RunWriter, open_run, verify
from rigctl.errors import RigctlError
from rigctl.rig import Layout


def kill(writer: RunWriter) -> None:
    """What the system does to a program that is killed: its files are closed, its locks are gone."""
    writer._journal.close()
    writer._log.close()
    writer._lock.release()


@pytest.fixture
def killed(writer: RunWriter) -> Path:
    measure_strokes(writer, records=1)
    writer.open_record(1.0, "stroke", {}, "1/record", 100.0)
    writer.append(sample(1.0, 1, 0.7))
    writer.flush()
    kill(writer)
    return writer.folder


def test_a_resumed_run_keeps_its_data_and_appends_new_records(killed: Path, make_header: object) -> None:
    later = make_header("other", started=STARTED + timedelta(hours=1), operator="Grace")  # type: ignore[operator]
    writer = RunWriter.reopen(killed, later)
    assert writer.id == killed.name
    assert writer.open_record(0.5, "stroke", {}, "1/record", 100.0) == 2
    writer.append(sample(0.5, 2))
    writer.close_record(0.6, "complete")
    run = open_run(writer.close("finished"))
    assert run.records["outcome"].tolist() == ["complete", "interrupted", "complete"]
    assert run.records["session"].tolist() == [0, 0, 1]
    assert run.usable == (0, 2)
    assert run.signals("time", 1).tolist() == [1.0]
    assert run.signals("time", 2).tolist() == [3600.5]
    assert run.record(2).start == 3600.5
    assert [session["operator"] for session in run.info["sessions"]] == ["Ada", "Grace"]
    assert [session["status"] for session in run.info["sessions"]] == ["interrupted", "finished"]
    assert (run.info["status"], run.info["rows"]) == ("finished", 23)
    assert verify(killed).condition.value == "whole"


def test_time_continues_even_when_the_calendar_clock_went_back(killed: Path, make_header: object) -> None:
    earlier = make_header(started=STARTED - timedelta(days=1))  # type: ignore[operator]
    writer = RunWriter.reopen(killed, earlier)
    writer.append(sample(0.0))
    times = open_run(writer.close("finished")).signals("time")
    assert times.tolist()[-2:] == [1.0, 2.0]


def test_a_run_can_be_resumed_after_several_kills(killed: Path) -> None:
    for _ in range(3):
        writer = RunWriter.reopen(killed)
        writer.append(sample(0.0))
        writer.flush()
        kill(writer)
    assert verify(killed).condition.value == "recovered"
    assert verify(killed).condition.value == "whole"
    run = open_run(killed)
    assert run.signals("time").tolist()[-4:] == [1.0, 2.0, 3.0, 4.0]
    assert len(run.info["sessions"]) == 4


def test_a_kill_while_a_session_is_joined_to_the_run_duplicates_nothing(
    killed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.dataset.recording import finalise as finalise_module

    writer = RunWriter.reopen(killed)
    writer.append(sample(0.0))

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(finalise_module, "write_table", die)
    with pytest.raises(KeyboardInterrupt):
        writer.close("finished")
    monkeypatch.undo()
    assert (killed / "samples.journal").exists()
    assert verify(killed).condition.value == "recovered"
    assert open_run(killed).info["rows"] == 23


def test_a_finished_run_cannot_be_resumed(writer: RunWriter) -> None:
    writer.close("finished")
    with pytest.raises(RigctlError, match="the run is finished"):
        RunWriter.reopen(writer.folder)
    assert verify(writer.folder).condition.value == "whole"


def test_resuming_on_another_rig_is_refused(killed: Path, make_header: object) -> None:
    other = Layout(LAYOUT.channels[:2], LAYOUT.commands, ("s", "1", "degC", "bar", "1", "1"))
    with pytest.raises(RigctlError, match="channels or units have changed") as caught:
        RunWriter.reopen(killed, make_header(layout=other))  # type: ignore[operator]
    assert "position" in str(caught.value.expected)


def test_a_run_in_progress_is_not_taken_over(writer: RunWriter) -> None:
    with pytest.raises(RigctlError, match="in progress"):
        RunWriter.reopen(writer.folder)
    writer.append(sample(0.0))
    assert open_run(writer.close("finished")).info["rows"] == 1
