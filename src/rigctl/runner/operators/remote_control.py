"""Control of a run from another terminal: requests in `control.jsonl`, a heartbeat in `state.json`.

Both files are in the run's folder. A client appends a line and waits until the heartbeat acknowledges it.
They serve every client alike: `rigctl pause` and `off`, the served page, a script.

`control.jsonl` is only appended to, by any number of clients, with one `write` for each line; `state.json` is
only written by the run, and replaced as a whole. Neither side trusts the other's text: lines may be cut off,
too long, or not meant for rigctl at all.
"""

from __future__ import annotations

import getpass
import json
import os
import platform
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from rigctl.dataset.recording.writer_lock import STATE_NAME, read_state
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular
from rigctl.files.write import replace_file, to_json
from rigctl.json_values import parse_json
from rigctl.runner.operators.appended_lines import LONGEST_LINE, AppendedLines
from rigctl.runner.operators.requests import Order, Request

if TYPE_CHECKING:
    from rigctl.runner.snapshot import View

CONTROL_NAME = "control.jsonl"
#: s of wall time between two checks of the file
_POLL = 0.2
#: s of wall time between two heartbeats
_BEAT = 1.0
#: s for which a heartbeat waits, on Windows, for a reader of the last one; the run waits too
_PATIENCE = 0.05
_LAST_PATIENCE = 0.5


class ControlFile:
    """The run's side: reads requests, writes the heartbeat. A failure of either never disturbs the run."""

    def __init__(self, folder: Path) -> None:
        self._lines = AppendedLines(folder / CONTROL_NAME)  # requests to an earlier session are past
        self._state = folder / STATE_NAME
        self._next_poll = self._next_beat = 0.0
        self._acknowledged: deque[dict[str, str]] = deque(maxlen=20)
        self._view: View | None = None

    def poll(self) -> Sequence[Order]:
        """Requests since the last call."""
        now = time.monotonic()
        if now < self._next_poll:
            return ()
        # Less often than the loop asks: each look is a call of the file system.
        self._next_poll = now + _POLL
        with suppress(OSError):
            orders = map(_read_order, self._lines.read())
            return tuple(order for order in orders if order is not None)
        return ()

    def acknowledge(self, order: Order, message: str) -> None:
        """Acknowledge a request at once."""
        # Keys and lock have no id: nobody waits for their acknowledgement in the file.
        if order.id:
            self._acknowledged.append({"id": order.id, "message": message})
            self._beat()

    def publish(self, view: View) -> None:
        """Write the heartbeat when it is due, and whenever the state or the question has changed."""
        before = self._view
        # What others wait for must not be late by a heartbeat.
        changed = before is None or (view.state, view.asked) != (before.state, before.asked)
        self._view = view
        if changed or time.monotonic() >= self._next_beat:
            self._beat()

    def close(self) -> None:
        """A last heartbeat, with the final state."""
        self._beat(_LAST_PATIENCE)

    def _beat(self, patience: float = _PATIENCE) -> None:
        self._next_beat = time.monotonic() + _BEAT
        state: dict[str, Any] = {"host": platform.node(), "pid": os.getpid()}
        if self._view is not None:
            state |= summary(self._view)
        state["acknowledged"] = list(self._acknowledged)
        draft = self._state.with_suffix(".tmp")
        with suppress(OSError):  # a full disk, or a reader that holds the file for long: the next one will do
            draft.write_text(to_json(state) + "\n", encoding="utf-8", newline="\n")
            replace_file(draft, self._state, patience)


def summary(view: View) -> dict[str, Any]:
    """The content of the heartbeat, as plain data."""
    return {
        "run": view.run,
        "state": view.state,
        "time": round(view.time, 3),
        "path": view.path,
        "label": view.label,
        "record": view.record,
        "records_done": view.records_done,
        "records_total": view.records_total,
        "progress": round(view.progress, 4),
        "time_left": None if view.time_left is None else round(view.time_left, 1),
        "alarms": [alarm.message for alarm in view.alarms],
        "question": view.question,
        "asked": view.asked,
        "remote": view.remote,
        "message": view.message,
        "unconfirmed": view.unconfirmed,
    }


def send(folder: Path, request: Request, *, timeout: float = 10.0, at: str = "another terminal") -> str:
    """Send a request to the run in `folder` and wait for its answer.

    Parameters
    ----------
    timeout: s of wall time.
    at: origin of the request, for the run's events.

    Returns
    -------
    Its answer, one sentence.

    Raises
    ------
    RigctlError
        no run is in progress there, or it does not answer within `timeout` s of wall time.
    """
    state = read_state(folder)
    if state is None or not state.fresh or state.fields.get("state") in ("finished", "failed", "aborted"):
        raise RigctlError(
            "no run is in progress",
            value=folder.name,
            hint="'rigctl runs list' shows which there are",
            exit_code=ExitCode.FAILED,
        )
    order_id = uuid4().hex
    # The id ties the acknowledgement to this request, as others may send the same one at the same time.
    line = {"id": order_id, "request": request.value, "source": sender(at)}
    write_line(folder, line, "request")
    return _await_answer(folder, order_id, timeout)


def write_line(folder: Path, line: Mapping[str, str], called: str) -> None:
    """Add a line to the file that a run reads; `called` names it in an error.

    Raises
    ------
    RigctlError
        the line is longer than a run reads, or the file cannot be written.
    """
    written = json.dumps(line, ensure_ascii=False).encode("utf-8", "replace") + b"\n"
    if len(written) > LONGEST_LINE:
        raise RigctlError(
            f"the {called} is too long", value=f"{len(written)} bytes", expected=f"at most {LONGEST_LINE}"
        )
    try:
        with open(folder / CONTROL_NAME, "ab", opener=regular) as file:
            file.write(written)
    except OSError as problem:
        raise RigctlError(
            f"cannot write the {called}: {problem.strerror}",
            where=Location(folder / CONTROL_NAME),
            exit_code=ExitCode.FAILED,
        ) from problem


def _await_answer(folder: Path, order_id: str, timeout: float) -> str:
    give_up = time.monotonic() + timeout
    while time.monotonic() < give_up:
        state = read_state(folder)
        for entry in state.fields.get("acknowledged", ()) if state is not None else ():
            if entry.get("id") == order_id:
                return str(entry.get("message", ""))
        time.sleep(0.05)
    raise RigctlError(
        f"the run has not answered for {timeout:g} s",
        value=folder.name,
        hint="Its program may hang or be gone; 'rigctl off' brings the bench to its safe state",
        exit_code=ExitCode.FAILED,
    )


def _read_order(line: bytes) -> Order | None:
    """A request, or None for any other line: everybody with write access to the folder can add lines."""
    try:
        fields = parse_json(line)
        return Order(
            Request(fields["request"]),
            source=str(fields.get("source", "another terminal"))[:200],
            id=str(fields.get("id", ""))[:64],
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def sender(at: str) -> str:
    """The user making the request, for the run's events."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):  # a user without a name, as in a container
        user = "somebody"
    return f"{user} at {at}"
