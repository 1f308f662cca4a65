"""A run in progress, read for all windows that watch it.

One thread for each watched run reads its journal, its log and its heartbeat, which exist in any case. The run
is not affected. What a window cannot receive in time is dropped for that window, oldest first.

Three kinds of threads meet here. The feed's thread reads files and writes to the queue of each window;
the event loop takes from these queues (`Watcher.waiting`); requests join, leave and ask for snapshots.
The feed's lock protects its rows, events and list of windows; each window's own lock protects its queue,
so that a slow window holds nobody. Locks are taken in that order, the feed's first. Files are read
without any lock. See docs/decisions/0092-served-page-reads-the-journal.md.
"""

from __future__ import annotations

import logging
import math
import struct
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.recording import journal, log
from rigctl.dataset.recording.writer_lock import read_state
from rigctl.errors import RigctlError
from rigctl.runner.operators.remote_operator import PRESENCE_EVERY, awaits_person, send_presence
from rigctl.web.decimation import Thinning, envelope
from rigctl.web.recent_rows import KeptRows
from rigctl.web.set_points import SetPoints

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rigctl.dataset import RunHeader
    from rigctl.live.steps import PlanPlaces
    from rigctl.rig import Layout, Rig

logger = logging.getLogger(__name__)

#: s between two reads of the journal: 20 Hz
LOOK: Final = 0.05
#: s between two reads of the heartbeat
_STATE: Final = 0.2
#: s of samples shown to a window that opens later, and most rows
KEPT: Final = 900.0
_MOST_ROWS: Final = 150_000
#: events that are kept for it
_MOST_EVENTS: Final = 300
#: batches that may wait for a slow window: two seconds
_MOST_WAITING: Final = 40
#: s that a feed continues when nobody watches
_LINGER: Final = 15.0
#: s after which a window that polls, or is reloaded, is considered closed
_CLOSED: Final = 3.0
#: time after the start of a step within which its first reading is searched in the buffer, s
_FRESH: Final = 5.0
#: lines of the tree of steps
_TREE: Final = 16
ENDED: Final = ("finished", "failed", "aborted")
#: events that are not shown
_SILENT: Final = ("run", "session", "step", "command")
#: rows, columns, rows that are provisional, 1 to begin anew; s of the first row
_HEAD: Final = struct.Struct("<HHHHd")
_MOST_IN_ONE: Final = 60_000


class Watcher:
    """One window: its requested time span, and its queue of unsent data.

    Parameters
    ----------
    wake: called from another thread when there are data.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._batches: deque[bytes] = deque()
        self._told: dict[str, object] = {}
        self._events: deque[Mapping[str, Any]] = deque(maxlen=_MOST_EVENTS)
        self._thinning = Thinning(0.0)
        self._lock = threading.Lock()
        self.dropped = 0  #: number of batches dropped because the window was slow

    def begin(self, rows: NDArray[np.float64], window: float, width: int) -> None:
        """Show the last `window` s, for a plot of `width` pixels, and continue from there."""
        stretch = window / max(width, 1)
        with self._lock:
            self._batches.clear()
            self._thinning = Thinning(stretch if stretch > 0.02 else 0.0)
            if len(rows):
                rows = rows[rows[:, 0] >= rows[-1, 0] - window]
            thinned, provisional = self._thinning.take(rows)
            self._batches.append(batch(thinned[-_MOST_IN_ONE:], provisional, anew=True))
        self._wake()

    def take(self, rows: NDArray[np.float64]) -> None:
        """Pass on new rows; a window that does not take them in time loses the oldest."""
        with self._lock:
            thinned, provisional = self._thinning.take(rows)
            self._batches.append(batch(thinned[-_MOST_IN_ONE:], provisional))
            while len(self._batches) > _MOST_WAITING:
                self._batches.popleft()
                self.dropped += 1
        self._wake()

    def tell(self, kind: str, what: object) -> None:
        """Pass on a message of which only the newest counts."""
        with self._lock:
            self._told[kind] = what
        self._wake()

    def happened(self, events: list[Mapping[str, Any]]) -> None:
        """Pass on events."""
        with self._lock:
            self._events.extend(events)
        self._wake()

    def waiting(self) -> tuple[dict[str, object], list[bytes]]:
        """News since the last call: messages by kind, and batches of samples."""
        with self._lock:
            messages, self._told = self._told, {}
            if self._events:
                messages["events"] = list(self._events)
                self._events.clear()
            # The window is told, so that the page can say that some of it is left out.
            if self.dropped:
                messages["dropped"] = self.dropped
                self.dropped = 0
            batches = list(self._batches)
            self._batches.clear()
        return messages, batches


def batch(rows: NDArray[np.float64], provisional: int = 0, *, anew: bool = False) -> bytes:
    """Rows for a browser: a header, then each column as float32, time relative to the first row."""
    import numpy as np

    first = float(rows[0, 0]) if len(rows) else 0.0
    columns = rows.T.copy()
    if len(rows):
        columns[0] -= first
    head = _HEAD.pack(len(rows), columns.shape[0], provisional, int(anew), first)
    with np.errstate(over="ignore"):
        return head + columns.astype("<f4").tobytes()


@dataclass(frozen=True)
class Columns:
    """Converts rows of a journal for display: time of the run, and display units."""

    layout: Layout
    factors: NDArray[np.float64]
    offsets: NDArray[np.float64]

    @classmethod
    def of(cls, layout: Layout) -> Columns:
        """For a layout; the column of the record is left out."""
        import numpy as np

        from rigctl.units import parse_unit

        names = [name for name in layout.columns if name != "record"]
        units = [parse_unit(layout.unit(name)) for name in names]
        offsets = [
            0.0 if name in layout.differences else unit.offset
            for name, unit in zip(names, units, strict=True)
        ]
        return cls(layout, np.array([unit.factor for unit in units]), np.array(offsets))

    def shown(self, payload: bytes, offset: float) -> NDArray[np.float64]:
        """The rows of a frame; `offset` is the run's time when its session began, s."""
        import numpy as np

        width = len(self.layout.columns)
        rows = np.frombuffer(payload, dtype="<f8").reshape(-1, width)
        values = np.delete(rows, self.layout.columns.index("record"), axis=1)
        shown = (values - self.offsets) / self.factors
        shown[:, 0] = values[:, 0] + offset
        return shown


class Feed:
    """One run that is watched."""

    def __init__(self, folder: Path, header: RunHeader) -> None:
        self.folder = folder
        self.header = header
        self._columns = Columns.of(header.layout)
        self._journal = journal.JournalReader(folder / journal.NAME)
        self._log = log.LogReader(folder / log.NAME)
        self._rows = KeptRows(len(header.layout.columns) - 1, KEPT, _MOST_ROWS)
        self._events: deque[Mapping[str, Any]] = deque(maxlen=_MOST_EVENTS)
        self._state: dict[str, Any] = {}
        self._places: PlanPlaces | None = None
        self._set_points = SetPoints(_rig(header))
        self._lines: list[dict[str, Any]] = []  #: set-points, as last sent
        self._tree: tuple[str, list[dict[str, Any]]] = ("", [])
        self._watchers: list[Watcher] = []
        self._asked = monotonic()
        self._next_presence = 0.0  # wall time
        self._lock = threading.Lock()
        self.over = False  #: True once the thread has ended because nobody watches
        threading.Thread(target=self._open_plan, name="plan", daemon=True).start()
        self._thread = threading.Thread(target=self._work, name=f"feed {folder.name}", daemon=True)
        self._thread.start()

    def goes_on(self) -> bool:
        """Keep reading for a window that is about to join; return False if the thread has ended already."""
        with self._lock:
            self._asked = monotonic()
            return not self.over

    def join(self, watcher: Watcher, window: float, width: int) -> None:
        """Start to serve a window; called again to change its time span."""
        with self._lock:
            rows = self._rows.last(window)
            if watcher not in self._watchers:
                self._watchers.append(watcher)
                watcher.happened(list(self._events))
            watcher.begin(rows, window, width)
            if self._state:
                watcher.tell("state", self._state)
            watcher.tell("set_points", self._lines)
        self._asked = monotonic()

    def leave(self, watcher: Watcher) -> None:
        """Stop serving a window."""
        with self._lock, suppress(ValueError):
            self._watchers.remove(watcher)
        self._asked = monotonic()

    def snapshot(self, after: float, window: float, width: int) -> dict[str, Any]:
        """The data after a time, for a browser without sockets, which polls once a second."""
        self._asked = monotonic()
        with self._lock:
            rows = self._rows.last(window)
            status = {"state": self._state, "events": list(self._events), "set_points": self._lines}
        rows = envelope(rows[rows[:, 0] > after], window / max(width, 1))
        return {**status, "rows": rows}

    # --- the thread ---------------------------------------------------------------------------------------

    def _work(self) -> None:
        next_state, faulty = 0.0, False
        while True:
            began = monotonic()
            try:
                self._read_samples()
                if began >= next_state:
                    next_state = began + _STATE
                    self._read_events()
                    self._read_state()
                    self._tell_set_points()
            except (OSError, RigctlError, ValueError):
                pass  # half written or gone: the next poll may read it
            except Exception:  # an error in it must not freeze the windows
                # Logged once: the same fault would come twenty times a second.
                if not faulty:
                    logger.exception("reading %s", self.folder)
                faulty = True
            with self._lock:
                if not self._watchers and monotonic() - self._asked > _LINGER:
                    self.over = True
                    self._journal.close()
                    return
            threading.Event().wait(max(LOOK - (monotonic() - began), 0.005))

    def _read_samples(self) -> None:
        payloads = self._journal.poll()
        if not payloads:
            return
        # Times in a journal are those of its session; windows show those of the run.
        offset = float((self._journal.facts or {}).get("offset", 0.0))
        rows = self._columns.shown(b"".join(payloads), offset)
        with self._lock:
            self._rows.append(rows)
            watchers = list(self._watchers)
            for watcher in watchers:
                watcher.take(rows)

    def _read_events(self) -> None:
        lines = self._log.poll()
        for line in lines:
            self._set_points.take(line)
        events = [_event(line) for line in lines if line.get("kind") not in _SILENT]
        if not events:
            return
        with self._lock:
            self._events.extend(events)
            for watcher in self._watchers:
                watcher.happened(list(events))

    def _read_state(self) -> None:
        heartbeat = read_state(self.folder)
        if heartbeat is None:
            return
        state = dict(heartbeat.fields)
        self._show_presence(state)
        # Answers to requests of other programs: news for nobody here, and the state would change with each of
        # them.
        state.pop("acknowledged", None)
        ended = state.get("state") in ENDED
        state |= {
            "ended": ended,
            # the heartbeat comes once a second; a run that has ended sends none
            "silent": None if ended or heartbeat.fresh else round(heartbeat.age, 0),
            "tree": self._outline(str(state.get("path") or "")),
        }
        if state != self._state:
            with self._lock:
                self._state = state
                for watcher in self._watchers:
                    watcher.tell("state", state)

    def _show_presence(self, state: Mapping[str, Any]) -> None:
        """Tell a run that waits for a person that a window shows it: without one its wait has a bound."""
        now = monotonic()
        watched = bool(self._watchers) or now - self._asked < _CLOSED
        if watched and now >= self._next_presence and awaits_person(state):
            self._next_presence = now + PRESENCE_EVERY
            with suppress(RigctlError):  # a full disk, on which the run reports itself
                send_presence(self.folder)

    def _tell_set_points(self) -> None:
        if math.isnan(newest := self._rows.newest):
            return
        lines = self._set_points.shown(self._first_reading, newest - KEPT)
        if lines != self._lines:
            with self._lock:
                self._lines = lines
                for watcher in self._watchers:
                    watcher.tell("set_points", lines)

    def _first_reading(self, channel: str, time: float) -> float | None:
        """A channel's first reading from a time on; None if not received yet, missing, or discarded."""
        column = 1 + self.header.layout.channels.index(channel)
        # The rows of that time have been dropped: the first one that is left would be taken for it.
        if not self._rows.oldest <= time + _FRESH:
            return None
        return self._rows.first_value(column, time)

    def _outline(self, path: str) -> list[dict[str, Any]]:
        from rigctl.live.steps import outline

        if self._places is None:
            return []
        if self._tree[0] != path:
            lines = outline(self._places, path, _TREE)
            nodes = [
                {"depth": line.depth, "label": line.label, "stage": line.stage.value, "note": line.note}
                for line in lines
            ]
            self._tree = (path, nodes)
        return self._tree[1]

    def _open_plan(self) -> None:
        """If the plan's files have changed since, only the step in progress is named."""
        from rigctl.live.steps import PlanPlaces
        from rigctl.runner.resume import plan_of

        with suppress(RigctlError, OSError):
            places = PlanPlaces(plan_of(self.header))
            self._set_points.follow(places)
            self._places = places


def _event(line: Mapping[str, Any]) -> dict[str, Any]:
    """One line for a person."""
    kind = str(line.get("kind", ""))
    text = str(line.get("message") or "")
    if kind == "record":
        outcome = f", {line.get('outcome')}" if line.get("outcome") else ""
        text = f"{line.get('state', '')} {line.get('record')} {line.get('name', '')}".rstrip() + outcome
    elif kind == "measure":
        text = _measure(line)
    elif kind == "end":
        text = ": ".join(str(part) for part in (line.get("status"), line.get("reason")) if part)
    return {"time": line.get("time"), "kind": kind, "text": text, "passed": line.get("passed")}


def _measure(line: Mapping[str, Any]) -> str:
    from rigctl.units import show

    value, unit = line.get("value"), str(line.get("unit") or "1")
    if not isinstance(value, int | float) or not math.isfinite(value):
        return f"{line.get('name')}: no value"
    return f"{line.get('name')} {show(value, unit, difference=bool(line.get('difference')))}"


def about(header: RunHeader) -> dict[str, Any]:
    """The description of a run for plots: channels with their limits and set-points, and commands."""
    return {
        "run": header.id,
        "procedure": header.procedure.name,
        "rig": header.rig.name,
        "backend": dict(header.backend),
        "operator": header.operator,
        "started": header.started.isoformat(timespec="seconds"),
        **columns_of(_rig(header), header.layout),
    }


def columns_of(rig: Rig | None, layout: Layout) -> dict[str, Any]:
    """The ``channels`` of a bench with their limits and set-points, and its ``commands``."""
    roles = [] if rig is None else [rig.roles.set_pressure]
    follows = {role.channel: role.actuator for role in roles if role is not None}
    channels = [
        {
            "name": name,
            "unit": layout.unit(name),
            "limits": [] if rig is None else _limits(rig, name),
            "set_point": follows.get(name),
            "places": _places_of(rig, name),
        }
        for name in layout.channels
    ]
    commands = [
        {
            "name": name,
            "unit": layout.unit(name),
            "kind": rig.actuators[name].kind if rig else "",
            "safe": _safe(rig, name),
        }
        for name in layout.commands
    ]
    return {"channels": channels, "commands": commands}


def _rig(header: RunHeader) -> Rig | None:
    from rigctl.rig.load import parse_rig

    try:
        return parse_rig(header.rig.text, Path(header.rig.path))
    except RigctlError:
        return None


def _safe(rig: Rig | None, name: str) -> float | None:
    """The safe value of an actuator, in its unit; None if it has none."""
    from rigctl.units import parse_unit

    if rig is None or name not in rig.safe_state:
        return None
    return parse_unit(rig.actuators[name].display_unit).from_si(float(rig.safe_state[name]))


def _places_of(rig: Rig | None, name: str) -> int:
    from rigctl.live.readings import decimals

    return 3 if rig is None else decimals(rig.channels[name])


def _limits(rig: Rig, name: str) -> list[dict[str, Any]]:
    from rigctl.units import parse_unit

    channel = rig.channels[name]
    unit = parse_unit(channel.unit)
    return [
        {
            "name": key,
            "bound": limit.bound,
            "value": unit.from_si(limit.threshold, difference=channel.difference),
            "action": limit.action,
            "message": limit.message,
        }
        for key, limit in rig.limits.items()
        if limit.channel == name and limit.of_value
    ]
