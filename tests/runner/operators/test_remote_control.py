"""Requests and heartbeat through files, as another terminal sees them."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.runner.operators.remote_control import CONTROL_NAME, ControlFile, send, write_line
from rigctl.runner.operators.requests import Order, Request
from rigctl.runner.snapshot import View


@pytest.fixture
def control(tmp_path: Path) -> ControlFile:
    file = ControlFile(tmp_path)
    file.publish(View("a-run", "running", 1.0))
    return file


def serve(control: ControlFile, answer: str, stop: threading.Event) -> None:
    while not stop.is_set():
        for order in control.poll():
            control.acknowledge(order, f"{order.request.value}: {answer}")
        control.publish(View("a-run", "running", 1.0))
        time.sleep(0.01)


@pytest.fixture
def run(control: ControlFile) -> Iterator[None]:
    stop = threading.Event()
    thread = threading.Thread(target=serve, args=(control, "done", stop))
    thread.start()
    yield
    stop.set()
    thread.join()


@pytest.mark.usefixtures("run")
def test_a_request_waits_for_its_own_acknowledgement(tmp_path: Path) -> None:
    assert send(tmp_path, Request.PAUSE, timeout=60.0) == "pause: done"
    assert send(tmp_path, Request.CONTINUE, timeout=60.0) == "continue: done"


def test_a_run_that_does_not_answer_is_reported_by_name(control: ControlFile, tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="has not answered"):
        send(tmp_path, Request.ABORT, timeout=0.2)


def test_a_request_needs_a_run_in_progress(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="no run is in progress"):
        send(tmp_path, Request.ABORT)
    ended = ControlFile(tmp_path)
    ended.publish(View("a-run", "finished", 1.0))
    with pytest.raises(RigctlError, match="no run is in progress"):
        send(tmp_path, Request.ABORT)


def test_invalid_lines_are_skipped(tmp_path: Path) -> None:
    (tmp_path / CONTROL_NAME).write_text('{"request": "abort"}\n', encoding="utf-8")
    control = ControlFile(tmp_path)
    assert control.poll() == ()  # of an earlier session
    with (tmp_path / CONTROL_NAME).open("a", encoding="utf-8") as file:
        file.write('nonsense\n[]\n{"request": "explode"}\n\x00\n{"request": "pause", "id": 7}\n{"request"')
    control._next_poll = 0.0
    assert [(order.request, order.id) for order in control.poll()] == [(Request.PAUSE, "7")]
    with (tmp_path / CONTROL_NAME).open("a", encoding="utf-8") as file:
        file.write(': "continue"}\n')
    control._next_poll = 0.0
    assert [order.request for order in control.poll()] == [Request.CONTINUE]


@pytest.mark.parametrize(
    "before",
    ["[" * 4000 + "\n", "x" * 10_000 + "\n", "x" * 300_000 + "\n", "x" * 262_144 + "\n"],
    ids=["nested", "long", "very long", "as long as is read at once"],
)
def test_an_invalid_line_does_not_hide_the_request_after_it(tmp_path: Path, before: str) -> None:
    control = ControlFile(tmp_path)
    for part in (before[:-1], "\n" + '{"request": "abort"}\n'):
        with (tmp_path / CONTROL_NAME).open("a", encoding="utf-8", newline="\n") as file:
            file.write(part)
        orders = []
        for _ in range(3):
            control._next_poll = 0.0
            orders += control.poll()
    assert [order.request for order in orders] == [Request.ABORT]


def test_a_line_too_long_to_be_read_is_not_written(control: ControlFile, tmp_path: Path) -> None:
    write_line(tmp_path, {"text": "ä" * 2000}, "answer")
    with pytest.raises(RigctlError, match="the answer is too long"):
        write_line(tmp_path, {"text": "ä" * 2100}, "answer")
    assert len((tmp_path / CONTROL_NAME).read_bytes().splitlines()) == 1


def test_the_heartbeat_has_the_state_of_the_run(control: ControlFile, tmp_path: Path) -> None:
    control.publish(View("a-run", "paused", 2.5, path="3/heat", label="heat to 40 degC", question="Ready?"))
    state = json.loads((tmp_path / "state.json").read_text(encoding="utf-8"))
    assert (state["state"], state["path"], state["question"]) == ("paused", "3/heat", "Ready?")
    assert state["pid"] > 0


def test_a_deleted_folder_does_not_disturb_the_run(tmp_path: Path) -> None:
    control = ControlFile(tmp_path / "gone")
    control.publish(View("a-run", "running", 0.0))
    assert control.poll() == ()
    control.close()


def test_a_reader_of_the_heartbeat_on_windows_only_delays_its_update(
    control: ControlFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows cannot replace an open file: an acknowledgement used to be lost until the next heartbeat."""
    rename, refusals = Path.replace, iter([True, True])

    def refused(draft: Path, path: Path) -> Path:
        if next(refusals, False):
            problem = PermissionError(13, "Access is denied")
            problem.winerror = 5  # type: ignore[attr-defined, unused-ignore]
            raise problem
        return rename(draft, path)

    monkeypatch.setattr(Path, "replace", refused)
    control.acknowledge(Order(Request.PAUSE, "a test", "1"), "paused")
    told = json.loads((tmp_path / "state.json").read_text(encoding="utf-8"))
    assert told["acknowledged"] == [{"id": "1", "message": "paused"}]
