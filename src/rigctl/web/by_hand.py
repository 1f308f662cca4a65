"""The bench while no run is in progress: its readings, and single outputs moved by hand, on the page Live.

Each is a command of rigctl in a process of its own: `rigctl monitor` while the bench is watched, and `rigctl
jog … --for` for a movement, which ends by itself and leaves the outputs safe, whatever becomes of the page,
of the network or of this server: a command whose readings nobody takes any more ends. Nothing moves before
the window that has the controls has opened them, on a real bench by typing its name.

One command at a time has the bench (`_command`). A movement is asked for (`_next`), watching is ended,
and when its process is gone, the movement begins; when that is over, watching begins again. `_ended` is
the one place where one follows another. Requests come in threads of the server, readings in one thread
for each command, and `_mind` looks for windows that are gone: all of them change the state under one
lock, and none waits for a process while it holds it. See
docs/decisions/0180-by-hand-in-the-browser-by-commands.md.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from rigctl.child_process import module_command
from rigctl.command_line import command
from rigctl.errors import ExitCode, RigctlError, unknown_name
from rigctl.json_values import parse_json
from rigctl.web.lease import Lease
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import Site

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.routing import BaseRoute

    from rigctl.rig import Rig

#: s without a request after which a window counts as gone: a page asks several times a second
_GONE: Final = 5.0
_LOOK: Final = 0.25
#: s of the longest movement by one press
_LONGEST: Final = 10.0
#: samples and messages that are kept
_MOST_ROWS: Final = 6000
_MOST_MESSAGES: Final = 50
#: s that the end of the server waits for a command; it makes the outputs safe without being waited for, too
_PATIENCE: Final = 3.0
_ANOTHER: Final = "the bench, or the file that describes it, is not the one that was watched any more"


@dataclass
class _Command:
    """A command that has the bench, and what it has said so far."""

    words: Sequence[str]
    process: subprocess.Popen[str]
    answer: list[str] = field(default_factory=list)  #: lines that are no sample
    samples: int = 0
    asked_to_end: bool = False
    unheard: bool = False  #: its readings are not taken any more, at which it ends too

    @property
    def moves(self) -> bool:
        return self.words[0] == "jog"

    def end(self) -> None:
        """Ask it to end as Ctrl-C does; it is never killed, since it makes the outputs safe."""
        if self.asked_to_end or self.process.poll() is not None:
            return
        try:
            _interrupt(self.process)
        except OSError:  # on Windows without a console there is no Ctrl-C
            self.unheard = True  # closing the pipe here would wait for whoever reads it
        self.asked_to_end = True


def _interrupt(process: subprocess.Popen[str]) -> None:
    """Send what Ctrl-C does.

    Raises
    ------
    OSError
        it cannot be sent.
    """
    if sys.platform == "win32":
        import ctypes

        # os.kill would end the process at once if the event cannot be sent, in some versions of Python
        if not ctypes.windll.kernel32.GenerateConsoleCtrlEvent(signal.CTRL_BREAK_EVENT, process.pid):
            raise ctypes.WinError()
    else:
        process.send_signal(signal.SIGTERM)


class ByHand:
    """The project's bench, operated by hand by one window.

    Parameters
    ----------
    lease: the right to command, common with that to command runs.
    """

    def __init__(self, site: Site, lease: Lease) -> None:
        self._site = site
        self._lease = lease
        self._lock = threading.RLock()
        self._command: _Command | None = None
        self._next: Sequence[str] | None = None  # begins once the command has ended
        self._monitor: Sequence[str] = ()
        self._watched: tuple[Path | None, str] = (None, "")  # the file that describes the bench, and its hash
        self._opener = ""  # the window that has opened the controls
        self._asked: dict[str, float] = {}  # when each window asked last
        self._began = monotonic()
        self._rows: deque[list[float | None]] = deque(maxlen=_MOST_ROWS)
        self._outputs: Mapping[str, str] = {}
        self._alarms: Sequence[str] = ()
        self._messages: deque[tuple[float, str]] = deque(maxlen=_MOST_MESSAGES)
        self._unsafe: dict[Path | None, str] = {}  # what may still be on, of the bench of each rig file
        self._moved: dict[str, float] = {}  # when a movement of each output has ended
        self._leaving = False
        site.at_end.append(self._end)

    def routes(self) -> Sequence[BaseRoute]:
        """The routes; they come before those of a run, which may have any name."""
        return (
            get("/api/live/bench", self.state),
            post("/api/live/bench/watch", self.watch),
            post("/api/live/bench/open", self.open_controls),
            post("/api/live/bench/move", self.move),
            post("/api/live/bench/stop", self.stop, reserved=True),
            post("/api/live/bench/close", self.close),
        )

    # --- requests of a page -------------------------------------------------------------------------------

    def state(self, request: PageRequest) -> dict[str, Any]:
        """The bench, and what has been read since the time ``after``, s."""
        try:
            rig = self.rig()
        except RigctlError as problem:
            return {"rig": None, "why": str(problem), "unsafe": self._unconfirmed()}
        try:
            after = float(request.text("after", "-inf"))
        except ValueError:
            after = float("-inf")
        with self._lock:
            # The file that describes the bench has changed since the controls were opened: they may lead to
            # another one now.
            if self._command is not None and _file(rig) != self._watched:
                self._leave_another()
            if request.text("glance", "") != "1":  # a window that shows a run only looks whether all is safe
                self._asked[request.viewer] = monotonic()
            if self._lease.seen_by(request.viewer)["mine"]:  # without a socket, asking shows that it is there
                self._lease.take(request.viewer, over=False)
            doing = self._command
            return {
                "rig": rig.name,
                "real": _is_real(rig),
                "about": _about(rig),
                "knobs": _knobs(rig),
                "longest": _LONGEST,
                "watched": doing is not None,
                "moving": self._moving,
                "command": command(doing.words) if doing is not None else "",
                "open": bool(self._opener) and self._opener == request.viewer,
                "rows": [row for row in self._rows if row[0] is not None and row[0] > after],
                "outputs": dict(self._outputs),
                "alarms": list(self._alarms),
                "messages": [{"time": time, "text": text} for time, text in self._messages],
                "unsafe": self._unconfirmed(),
            }

    def watch(self, request: PageRequest) -> dict[str, Any]:
        """Begin to read the bench; its outputs are in their safe state."""
        rig = self.rig()
        with self._lock:
            self._lease.take(request.viewer, over=False)
            if self._command is not None:
                raise RigctlError(
                    "the bench is watched already, or just being left",
                    hint="Try again in some seconds",
                    exit_code=ExitCode.FAILED,
                )
            # A new beginning: nothing of an earlier watch may be shown as if it were of this one.
            self._asked = {request.viewer: monotonic()}
            self._began = monotonic()
            self._rows.clear()
            self._messages.clear()
            self._outputs, self._alarms, self._leaving = {}, (), False
            self._watched = _file(rig)
            self._monitor = ("monitor", "--rig", self._path(rig))
            self._start((*self._monitor, "--json"))
        threading.Thread(target=self._mind, name="bench by hand", daemon=True).start()
        return {"command": command(self._monitor)}

    def open_controls(self, request: PageRequest) -> dict[str, Any]:
        """Allow this window to move outputs: on a real bench only for its name, typed."""
        rig = self.rig()
        if _is_real(rig) and request.text("rig", "").strip() != rig.name:
            raise RigctlError(
                "the controls of a real bench are opened by its name", expected=f"'{rig.name}', as it stands"
            )
        with self._lock:
            self._lease.take(request.viewer, over=False)
            self._require_watched(rig)
            self._opener = request.viewer
        return {"open": True}

    def move(self, request: PageRequest) -> dict[str, Any]:
        """Move one output for a time; then all outputs are safe again."""
        rig = self.rig()
        name, value, duration = _movement(rig, request)
        with self._lock:
            self._lease.take(request.viewer, over=False)
            if not self._opener or self._opener != request.viewer:
                raise RigctlError("this window has not opened the controls", exit_code=ExitCode.FAILED)
            if self._moving:
                raise RigctlError("a movement is in progress", exit_code=ExitCode.FAILED)
            self._require_watched(rig)
            self._require_rest(rig, name)
            options = ("--for", duration, *self._monitor[1:])
            # Only noted: it begins when the command that has the bench now is gone, see `_ended`.
            self._next = ("jog", *options, "--readings", "--json", "--", name, value)
            if self._command is not None:
                self._command.end()
        moved = ("--", name, value) if value.startswith("-") else ()
        return {"command": command(("jog", *options, *moved) if moved else ("jog", name, value, *options))}

    def stop(self, request: PageRequest) -> dict[str, Any]:
        """End a movement now, from any window."""
        with self._lock:
            # From any window, also one without the controls: stopping needs no right.
            if self._next is not None and self._next[0] == "jog":
                self._next = None  # it has not begun
            if self._command is not None and self._command.moves:
                self._command.end()
        return {}

    def close(self, request: PageRequest) -> dict[str, Any]:
        """Leave the bench, from the window that operates it, or from any when that one is gone."""
        with self._lock:
            self._lease.take(request.viewer, over=False)
            self.leave()
            self._lease.give(request.viewer)
        return {}

    # --- inside -------------------------------------------------------------------------------------------

    def leave(self) -> None:
        """End what has the bench, without waiting for it; nothing begins after it."""
        with self._lock:
            self._next, self._opener, self._leaving = None, "", True
            if self._command is not None:
                self._command.end()

    def made_safe(self, rig: Rig) -> None:
        """Take back what was said of a bench whose outputs are confirmed to be safe now."""
        with self._lock:
            self._unsafe.pop(_file(rig)[0], None)

    def _unconfirmed(self) -> str:
        with self._lock:
            return "; ".join(self._unsafe.values())

    @property
    def _moving(self) -> bool:
        """Whether an output moves, or is about to."""
        return self._next is not None or (self._command is not None and self._command.moves)

    def _end(self) -> None:
        self.leave()
        doing = self._command
        if doing is not None:
            try:
                doing.process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                return  # it has no reader from now on, and ends by itself

    def rig(self) -> Rig:
        """The project's bench: the one that it names, or its only one.

        Raises
        ------
        RigctlError
            it has none, or several.
        """
        from rigctl.rig import load_rig

        root = self._site.require_project()
        self._site.refresh()
        if self._site.project.rig is not None:
            return load_rig(self._site.project.rig)
        paths = sorted((root / "rigs").glob("*.yaml"))
        if len(paths) != 1:
            raise RigctlError(
                "which bench is meant is not known",
                hint='rig = "rigs/NAME.yaml" in rigctl.toml says it',
                exit_code=ExitCode.FAILED,
            )
        return load_rig(paths[0])

    def _path(self, rig: Rig) -> str:
        """The file of a rig as commands are told, so that they open what the page shows."""
        assert rig.path is not None  # noqa: S101 - it was loaded
        root = self._site.project.root
        return (rig.path.relative_to(root) if rig.path.is_relative_to(root) else rig.path).as_posix()

    def _require_watched(self, rig: Rig) -> None:
        """Refuse a bench that is not watched, or being left; leave one whose file has changed.

        Its controls were opened by its name, and its file may now lead to a real bench.
        """
        if self._command is None or self._leaving:
            raise RigctlError("the bench is not watched", exit_code=ExitCode.FAILED)
        if _file(rig) != self._watched:
            self._leave_another()
            raise RigctlError(_ANOTHER, hint="Watch it anew", exit_code=ExitCode.FAILED)

    def _require_rest(self, rig: Rig, name: str) -> None:
        """Refuse to switch an output before its `min_interval`: each movement is a process of its own."""
        rest = rig.actuators[name].min_interval
        left = self._moved.get(name, -rest) + rest - monotonic() if rest > 0.0 else 0.0
        if left > 0.0:
            raise RigctlError(
                f"{name} was switched a moment ago",
                hint=f"Wait {left:.1f} s: its min_interval is {rest:g} s",
                exit_code=ExitCode.FAILED,
            )

    def _leave_another(self) -> None:
        if not self._command or not self._command.asked_to_end:
            self._say(_ANOTHER)
        self.leave()

    def _start(self, words: Sequence[str]) -> None:
        """Start a command in a process that no Ctrl-C of this server's terminal reaches."""
        group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
        process = subprocess.Popen(  # noqa: S603 - this program, no shell
            module_command("rigctl", *words),
            cwd=self._site.project.root,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            creationflags=group,
            start_new_session=not group,
        )
        self._command = doing = _Command(words, process)
        threading.Thread(target=self._listen, args=(doing,), name="readings", daemon=True).start()

    def _listen(self, doing: _Command) -> None:
        """Take what a command says until it ends, and start the next one."""
        assert doing.process.stdout is not None  # noqa: S101 - opened as pipes
        assert doing.process.stderr is not None  # noqa: S101
        errors = threading.Thread(target=self._hear, args=(doing,), daemon=True)
        errors.start()
        first: float | None = None
        for line in doing.process.stdout:
            sample = _sample(line)
            if sample is None:
                doing.answer.append(line)
                continue
            if first is None:  # each command counts from its own beginning
                first = monotonic() - self._began - float(sample["time"])
            doing.samples += 1
            with self._lock:
                if not doing.moves:  # it has brought the outputs to their safe state
                    self._unsafe.pop(self._watched[0], None)
                self._rows.append([first + float(sample["time"]), *sample["channels"].values()])
                self._outputs = sample["commands"]
                self._alarms = sample["alarms"]
            if doing.unheard:
                break
        doing.process.stdout.close()
        doing.process.wait()
        errors.join(_PATIENCE)
        doing.process.stderr.close()
        with self._lock:
            self._ended(doing)

    def _hear(self, doing: _Command) -> None:
        assert doing.process.stderr is not None  # noqa: S101
        for line in doing.process.stderr:
            if line.strip():
                self._say(line.strip().removeprefix("rigctl: "))

    def _say(self, text: str) -> None:
        with self._lock:
            self._messages.append((monotonic() - self._began, text))

    def _ended(self, doing: _Command) -> None:
        """What follows a command: the movement that was asked for, or watching again after one."""
        # Taken before anything else, so that whatever happens below, no movement is left to begin later.
        self._command, following, self._next = None, self._next, None
        self._outputs = {}
        answer = _answer(doing)
        if (why := answer.get("reason") or answer.get("error", {}).get("message")) and not doing.asked_to_end:
            self._say(str(why))
        if self._rows:  # no line across the time in which nothing is read
            self._rows.append([monotonic() - self._began, *[None] * (len(self._rows[-1]) - 1)])
        # First whether the bench is safe; only then whether something follows. After a movement without
        # confirmation, or a command that has failed, nothing does, and the controls are closed.
        unsafe = _unsafe(doing, answer) if doing.moves else ""
        if unsafe:
            self._unsafe[self._watched[0]] = unsafe
        elif doing.samples and "unconfirmed" in answer:
            self._unsafe.pop(self._watched[0], None)
        if doing.moves and doing.samples:
            self._moved[doing.words[-2]] = monotonic()
        if unsafe or (not doing.moves and not doing.asked_to_end):
            self._opener = ""  # it has failed, and its messages say why
        elif following is not None and self._is_still_watched():
            self._start(following)
        elif self._opener:  # watching again, after a movement or one that was stopped before it began
            self._start((*self._monitor, "--json"))

    def _is_still_watched(self) -> bool:
        """Whether the bench is still the one that was watched, just before a movement of it begins."""
        try:
            if _file(self.rig()) == self._watched:
                return True
        except RigctlError as problem:
            self._say(str(problem))
        self._leave_another()
        return False

    def _mind(self) -> None:
        """Leave the bench when the windows are gone, and close the controls of one that is."""
        while True:
            threading.Event().wait(_LOOK)
            with self._lock:
                if self._command is None:
                    return
                now = monotonic()
                # Nobody looks any more, or the window with the controls has gone or lost the lease: the bench
                # is left, safe.
                self._asked = {viewer: at for viewer, at in self._asked.items() if now - at < _GONE}
                commands = bool(self._lease.seen_by(self._opener)["mine"]) if self._opener else False
                if not self._asked or (self._opener and not (self._opener in self._asked and commands)):
                    self.leave()


def _file(rig: Rig) -> tuple[Path | None, str]:
    return rig.path and rig.path.resolve(), rig.sha256


def _is_real(rig: Rig) -> bool:
    from rigctl.runner.bench_access import UNREAL

    return rig.kind not in UNREAL


def _about(rig: Rig) -> dict[str, Any]:
    """The description of the bench for plots, as that of a run."""
    from rigctl.web.feed import columns_of

    columns = columns_of(rig, rig.layout)
    for channel in columns["channels"]:
        channel["set_point"] = None  # outputs come as words
    return {"run": rig.name, "procedure": "", "rig": "", "backend": {"kind": rig.kind}, **columns}


def _knobs(rig: Rig) -> list[dict[str, Any]]:
    """What can be moved from here: what a person turns at the bench cannot."""
    from rigctl.rig.setting import POSITIONS
    from rigctl.units import parse_unit

    knobs = []
    for name, actuator in rig.actuators.items():
        if actuator.by == "operator":
            continue
        safe = rig.safe_state.get(name)
        unit = parse_unit(actuator.display_unit)
        ends = [None if end is None else unit.from_si(end) for end in (actuator.low, actuator.high)]
        words = [word for word, value in POSITIONS.get(actuator.kind, {}).items() if value != safe]
        knobs.append({"name": name, "positions": words, "unit": actuator.display_unit, "ends": ends})
    return knobs


def _movement(rig: Rig, request: PageRequest) -> tuple[str, str, str]:
    """The output, its value and the duration of a movement that is asked for.

    Raises
    ------
    RigctlError
        no such output, a value that it cannot take, or a time that is too long, with that to the level.
    """
    from rigctl.steps.approach import approach_time

    name, value, seconds = request.text("actuator"), request.text("value"), request.body.get("seconds")
    known = [knob["name"] for knob in _knobs(rig)]
    if name not in known:
        raise unknown_name("output", name, known)
    described = rig.actuators[name]
    way = approach_time(float(rig.safe_state.get(name, 0.0)), described.read(value), described.max_rate)
    if not isinstance(seconds, int | float) or isinstance(seconds, bool) or not 0.0 < seconds <= _LONGEST:
        wanted = f"more than 0 s, at most {_LONGEST:g} s"
        raise RigctlError("how long the output is moved", value=str(seconds), expected=wanted)
    if way + seconds > _LONGEST:  # jog counts from the arrival at the level
        raise RigctlError(
            "how long the output is moved",
            value=f"{way:.3g} s to its level, at its max_rate, and {seconds:g} s there",
            expected=f"at most {_LONGEST:g} s in all",
        )
    return name, value, f"{seconds:g} s"


def _sample(line: str) -> dict[str, Any] | None:
    if not line.startswith('{"time"'):
        return None
    try:
        sample = parse_json(line)
    except ValueError:
        return None
    return sample if isinstance(sample, dict) else None


def _answer(doing: _Command) -> dict[str, Any]:
    """How a command says that it has ended; empty if it does not."""
    try:
        answer = parse_json("".join(doing.answer))
    except ValueError:
        return {}
    return answer if isinstance(answer, dict) else {}


def _unsafe(doing: _Command, answer: Mapping[str, Any]) -> str:
    """The outputs that may still be on after a movement; empty where all are confirmed to be safe."""
    if not answer and doing.samples:  # without a sample nothing was commanded
        return f"{doing.words[-2]} (the program that moved it has ended without a word)"
    return str(answer.get("unconfirmed") or "")
