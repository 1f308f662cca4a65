"""A workbench in a separate process; the server passes messages to and from it.

Its computations neither block the server nor share its memory: closing the page ends the process, and a crash
of compiled equations ends only this process.

While a slider moves, pictures are requested faster than they can be computed: only the newest waiting request
counts. Everything else is done in the order of the requests.

Three threads: the main one reads the pipe and only queues (`take`); one computes pictures of a moving
slider, of which a newer request replaces one that waits (`_moving`); one carries out everything else in
order (`_waiting`). The condition `_arrival` protects both queues, `_sending` the pipe. A long computation
asks in between whether something newer waits (`_idle`), and gives up then.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rigctl.command_line import DataOptions
from rigctl.errors import RigctlError
from rigctl.json_values import parse_json
from rigctl.web.workbench.bode import Responses
from rigctl.web.workbench.describe import (
    opened_document,
    picture_frame,
    record_frame,
    series_of,
    state_document,
)
from rigctl.workbench import Asked, Picture, State, Workbench
from rigctl.workbench.session import Cancelled

logger = logging.getLogger(__name__)

#: most undo and redo steps accepted from a page
_RETRACED = 200
#: requests that may wait for the worker; each can hold a state of thousands of parameters
_MOST_WAITING = 100
#: before a message to the page: its text, or its bytes
TEXT, BYTES = b"t", b"b"


def attend(pipe: Connection, folder: str) -> None:
    """Handle messages from the pipe until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends this process
    os.chdir(folder)
    session = _Session(pipe)
    session.begin()
    while True:
        try:
            message = pipe.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)  # threads may still be simulating; their results are not needed
        session.read(message)


class _Session:
    """One page's workbench."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._sending = threading.Lock()
        self._bench: Workbench | None = None
        self._waiting: deque[Mapping[str, Any]] = deque()
        self._moving: Mapping[str, Any] | None = None
        self._shown: tuple[int, ...] = (0,)
        self._responses = Responses()
        self._arrival = threading.Condition()
        self._do: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "open": self._open,
            "show": self._show,
            "frequency": self._frequency,
            "settle": self._settle,
            "undo": self._undo,
            "redo": self._redo,
            "retrace": self._retrace,
            "keep": self._keep,
            "reload": self._reload,
        }

    def begin(self) -> None:
        """Start the two worker threads."""
        threading.Thread(target=self._follow_always, name="follow", daemon=True).start()
        threading.Thread(target=self._work_loop, name="work", daemon=True).start()

    def read(self, message: bytes) -> None:
        """Handle a message of a page; anything but a JSON object is refused without further effect."""
        try:
            request = parse_json(message)
        except (ValueError, RecursionError):
            request = None
        if isinstance(request, dict):
            self.take(request)
        else:
            self._problem({}, RigctlError("the message is not a JSON object").as_dict())

    def take(self, request: Mapping[str, Any]) -> None:
        """Put a message into the queue of its worker; it is refused if too many wait already."""
        with self._arrival:
            # Never queued, only replaced; and so never refused.
            follows = request.get("do") == "follow"
            refused = not follows and len(self._waiting) >= _MOST_WAITING
            if follows:
                self._moving = request
            elif not refused:
                self._waiting.append(request)
            self._arrival.notify_all()
        if refused:
            self._problem(request, RigctlError(f"{_MOST_WAITING} requests are waiting already").as_dict())

    def _follow_always(self) -> None:
        while True:
            with self._arrival:
                self._arrival.wait_for(lambda: self._moving is not None and self._bench is not None)
                request, self._moving = self._moving, None
            self._tried(self._follow, request or {})

    def _work_loop(self) -> None:
        while True:
            with self._arrival:
                self._arrival.wait_for(lambda: bool(self._waiting))
                request = self._waiting.popleft()
            self._tried(self._carry_out, request)

    def _tried(self, work: Callable[[Mapping[str, Any]], None], request: Mapping[str, Any]) -> None:
        try:
            work(request)
        except RigctlError as error:
            self._problem(request, error.as_dict())
        except Exception as fault:
            logger.exception("workbench: %s", request.get("do"))
            self._problem(request, RigctlError(f"a fault of rigctl itself: {fault!r}").as_dict())

    def _carry_out(self, request: Mapping[str, Any]) -> None:
        work = self._do.get(str(request.get("do")))
        if work is None:
            raise RigctlError("the workbench knows no such thing to do", value=str(request.get("do")))
        work(request)

    def _problem(self, request: Mapping[str, Any], error: Mapping[str, Any]) -> None:
        self._send_document(
            {"kind": "problem", "do": request.get("do"), "seq": request.get("seq"), "error": error}
        )

    def _send_document(self, document: Mapping[str, Any]) -> None:
        from rigctl.files.write import to_json

        self._send(TEXT + to_json(document, indent=None).encode("utf-8"))

    def _send(self, message: bytes) -> None:
        with self._sending:
            try:
                self._pipe.send_bytes(message)
            except OSError:  # the page has gone
                os._exit(0)

    def _progress(self, text: str) -> None:
        self._send_document({"kind": "progress", "text": text})

    @property
    def _open_bench(self) -> Workbench:
        if self._bench is None:
            raise RigctlError("no model is open yet")
        return self._bench

    def _open(self, request: Mapping[str, Any]) -> None:
        from rigctl.dataset import open_run
        from rigctl.model import load_model
        from rigctl.model.measured.assumed import assuming
        from rigctl.project import find_file, find_project
        from rigctl.web.project_files import plain_id, project_path

        named = str(request.get("model", ""))
        project_path(find_project().root, named)
        path = find_file(Path(named))
        assume = tuple(map(str, request.get("assume") or ()))
        choice = DataOptions(request.get("only") or None, request.get("hold_out") or None, assume)
        self._progress("Reading the records")
        names = [plain_id(str(name)) for name in request.get("runs") or ()]
        runs = list({run.id: run for run in map(open_run, names)}.values())
        if not runs:
            raise RigctlError("choose a run")
        if assume:
            model = load_model(path)
            runs = [assuming(run, model, assume) for run in runs]
        bench = Workbench.open(runs, path, choice, on_progress=self._progress, named=named)
        self._begin_with(bench)

    def _begin_with(self, bench: Workbench) -> None:
        self._shown = tuple(k for k in self._shown if k < len(bench.problem.records)) or (0,)
        with self._arrival:
            self._bench = bench
            self._arrival.notify_all()
        self._send_document(opened_document(bench) | {"shown": list(self._shown)})
        for k in self._shown:
            self._send(BYTES + record_frame(bench, k))
        self._responses.begin(self._shown)
        self._send_picture(bench.exact, self._header({}, bench.track.present))

    def _send_picture(self, picture: Picture, header: Mapping[str, Any]) -> None:
        bench, asked = self._open_bench, self._responses.asked
        self._send(BYTES + picture_frame(bench, picture, self._shown, header))
        # a picture that was begun before the response was asked for may lack its records
        if asked is not None and set(asked.records(bench)) <= set(picture.outputs):
            self._send(BYTES + self._responses.frame(bench, picture, asked, header))

    def _frequency(self, request: Mapping[str, Any]) -> None:
        """Show a frequency response from now on, or none."""
        bench = self._open_bench
        if not request.get("open"):
            self._responses.asked = None
            return
        source, channel = (str(request.get(key) or "") for key in ("input", "channel"))
        asked = Asked(source, channel, None if request.get("every") else self._shown[0])
        self._responses.asked = asked
        header = self._header(request, bench.track.present)
        self._send(BYTES + self._responses.frame(bench, bench.exact, asked, header))

    def _show(self, request: Mapping[str, Any]) -> None:
        bench = self._open_bench
        count = len(bench.problem.records)
        shown = tuple(int(k) for k in request.get("records") or () if 0 <= int(k) < count)
        self._shown = shown or (0,)
        self._responses.follow(self._shown)
        for k in self._shown:
            self._send(BYTES + record_frame(bench, k))
        self._send_picture(bench.exact, self._header(request, bench.track.present))

    def _follow(self, request: Mapping[str, Any]) -> None:
        bench = self._open_bench
        state = _state_of(bench, request)
        picture = bench.follow(state, self._drawn(bench))
        self._send_picture(picture, self._header(request, state))

    def _drawn(self, bench: Workbench) -> list[int]:
        """The records behind the curves that are shown; of a table all rows of a curve."""
        behind = [row for k in self._shown for row in series_of(bench.problem, k)]
        asked = self._responses.asked
        return behind + ([] if asked is None else list(asked.records(bench)))

    def _settle(self, request: Mapping[str, Any]) -> None:
        self._open_bench.step(_state_of(self._open_bench, request))
        self._picture_now(request)

    def _retrace(self, request: Mapping[str, Any]) -> None:
        """Restore the steps of a reloaded page."""
        bench = self._open_bench
        past, future = (
            [_state_of(bench, one) for one in list(request.get(name) or ())[-_RETRACED:]]
            for name in ("past", "future")
        )
        bench.retrace(_state_of(bench, request), past, future)
        self._picture_now(request)

    def _undo(self, request: Mapping[str, Any]) -> None:
        self._open_bench.undo()
        self._picture_now(request, moved=True)

    def _redo(self, request: Mapping[str, Any]) -> None:
        self._open_bench.redo()
        self._picture_now(request, moved=True)

    def _picture_now(self, request: Mapping[str, Any], *, moved: bool = False) -> None:
        """All records of the present state, quickly and then exactly; skipped if a newer request waits.

        After undo the page also needs the state.
        """
        bench = self._open_bench
        state = bench.track.present
        if moved:
            self._send_document({"kind": "state", "state": state_document(state)})
        header = self._header(request, state)
        at_once = bench.follow(state, self._drawn(bench), budget=math.inf)
        self._send_picture(at_once, header)
        try:
            # The quick picture is shown already; the exact one is worth its time only if nothing newer waits.
            exact = bench.settle(state, wanted=self._idle)
        except Cancelled:
            return
        for k in self._shown:  # the readings that count, and their noise, can depend on the model
            self._send(BYTES + record_frame(bench, k))
        self._send_picture(exact, header)

    def _idle(self) -> bool:
        """Whether no waiting request can change the state."""
        with self._arrival:
            return self._moving is None and not self._waiting

    def _header(self, request: Mapping[str, Any], state: State) -> dict[str, Any]:
        bench = self._open_bench
        return {
            "seq": request.get("seq"),
            "sent": request.get("sent"),
            "command": bench.command(state),
            "undo": len(bench.track.past),
            "redo": len(bench.track.future),
        }

    def _keep(self, request: Mapping[str, Any]) -> None:
        bench = self._open_bench
        changed = bench.keep(bench.track.present, on_progress=self._progress)
        self._send_document({"kind": "kept", **changed.document()})
        self._begin_with(bench.reopened(on_progress=self._progress))

    def _reload(self, _: Mapping[str, Any]) -> None:
        """Handle a new version of the model's file, made by a job."""
        self._begin_with(self._open_bench.reopened(on_progress=self._progress))


def _state_of(bench: Workbench, request: Mapping[str, Any]) -> State:
    """The state from a page: the values that differ from the model's, and the effects that are on.

    Raises
    ------
    RigctlError
        a name is unknown, or a value no finite number.
    """
    values = {}
    for name, value in dict(request.get("values") or {}).items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise RigctlError(f"{name}: a finite number is needed", value=str(value))
        values[str(name)] = float(value)
    known = {switch.name for switch in bench.switches}
    on = {str(name) for name in request.get("on") or ()}
    if on - known:
        raise RigctlError("there is no such effect", value=", ".join(sorted(on - known)))
    return State(bench.start.moved(values).values, frozenset(on))
