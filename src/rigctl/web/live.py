"""The run in progress: any number of windows can watch it, one can command it.

In: requests and sockets of windows. Out: what their runs do, and the commands that they give, which go
the same way as those of other terminals (`rigctl.runner.operators.remote_control`): the server has no way
of its own into a run, and a run does not know of it.

The event loop only moves messages; whatever may block (files, runs, the index) is done in threads.
`_Window` is one socket: a task that reads what the window wants, and one that sends. Either's end is the
end of both.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from rigctl.errors import RigctlError
from rigctl.files.write import to_json
from rigctl.json_values import parse_json
from rigctl.web.by_hand import ByHand
from rigctl.web.lease import Lease
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute

    from rigctl.web.feed import Feed, Watcher

logger = logging.getLogger(__name__)

#: s for which a listing of the runs' folders is reused
_LOOK: Final = 1.0
#: number of the newest runs searched for runs in progress
_NEWEST: Final = 50
#: windows that can watch at a time
_MOST_WINDOWS: Final = 100
_WINDOWS: Final = (1.0, 900.0)
_WIDTHS: Final = (50, 4000)


def routes(site: Site) -> Sequence[BaseRoute]:
    """The routes of the page."""
    live = Live(site)
    return (
        get("/api/live", live.runs),
        *live.by_hand.routes(),
        get("/api/live/{run}", live.snapshot),
        post("/api/live/lease", live.lease_asked),
        post("/api/live/off", live.off, reserved=True),
        post("/api/live/{run}/request", live.request),
        post("/api/live/{run}/answer", live.answer),
        WebSocketRoute("/api/live/stream", live.stream),
    )


class Live:
    """The runs in progress of one project."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._lease = Lease()
        self.by_hand = ByHand(site, self._lease)
        self._feeds: dict[str, Feed] = {}
        self._lock = threading.Lock()
        self._found: tuple[float, list[Path]] = (-1e9, [])
        self._open = 0  # windows; counted by the event loop alone

    # --- requests of a page -------------------------------------------------------------------------------

    def runs(self, request: PageRequest) -> dict[str, Any]:
        """The ids of the runs in progress, newest first, and who has the controls."""
        ids = [folder.name for folder in self._in_progress()]
        return {"runs": ids, "lease": self._lease.seen_by(request.viewer)}

    def snapshot(self, request: PageRequest) -> dict[str, Any]:
        """The data that the socket sends, for a browser without WebSockets."""
        from rigctl.web.feed import about

        feed = self._feed(request.text("run"))
        try:
            after = float(request.text("after", "-inf"))
        except ValueError:
            after = float("-inf")
        window = float(request.whole("window", 60, int(_WINDOWS[0]), int(_WINDOWS[1])))
        width = request.whole("width", 600, *_WIDTHS)
        snapshot = feed.snapshot(after, window, width)
        return {**snapshot, "run": about(feed.header), "lease": self._lease.seen_by(request.viewer)}

    def lease_asked(self, request: PageRequest) -> dict[str, Any]:
        """Acquire the controls, take them over, or release them."""
        if request.body.get("give") is True:
            self._lease.give(request.viewer)
        else:
            self._lease.take(request.viewer, over=request.body.get("over") is True)
        return self._lease.seen_by(request.viewer)

    def request(self, request: PageRequest) -> dict[str, Any]:
        """Pause, continue or abort a run, as the commands of these names do."""
        from rigctl.runner.operators.remote_control import send
        from rigctl.runner.operators.requests import Request

        name = request.text("request")
        try:
            kind = Request(name)
        except ValueError:
            raise RigctlError(
                "unknown request", value=name, expected=", ".join(each.value for each in Request)
            ) from None
        folder = self._folder(request.text("run"))
        self._lease.take(request.viewer, over=False)
        return {"run": folder.name, "answer": send(folder, kind, at="a browser")}

    def answer(self, request: PageRequest) -> dict[str, Any]:
        """Answer the operator's question of a run that was started from this page."""
        from rigctl.runner.operators.remote_operator import send_answer

        folder = self._folder(request.text("run"))
        self._lease.take(request.viewer, over=False)
        send_answer(folder, request.text("question"), request.text("text"))
        return {"run": folder.name}

    def off(self, request: PageRequest) -> dict[str, Any]:
        """Everything to the safe state, like `rigctl off`: from any window, whichever has the controls."""
        from rigctl.runner.bench_access import Access, bench_options
        from rigctl.runner.switch_off import switch_off

        try:
            # First what this server itself has on the bench, without waiting for it: `switch_off` takes the
            # bench anyway.
            self.by_hand.leave()
        except Exception:  # whatever it is, the outputs come first
            logger.exception("leaving the bench")
        rig = self._bench(request)
        kind = rig.backend_named()
        access = Access(runs=self._site.project.runs, backend=kind, options=bench_options(kind, rig))
        done = switch_off(rig, access)
        if done.confirmed:
            self.by_hand.made_safe(rig)
        return {"rig": rig.name, "done": done.done, "confirmed": done.confirmed, "known_by": done.known_by}

    async def stream(self, socket: WebSocket) -> None:
        """Serve a window until it closes: JSON for events, float32 for samples."""
        await socket.accept()
        viewer = socket.query_params.get("viewer", "")[:64]
        if self._open >= _MOST_WINDOWS:
            await socket.close(1013, f"{_MOST_WINDOWS} windows watch already")
            return
        if not viewer:
            await socket.close(1008, "a window needs a name")
            return
        self._lease.connected(viewer)
        window = _Window(self, socket, viewer)
        self._open += 1
        try:
            await window.serve()
        finally:
            self._open -= 1
            self._lease.disconnected(viewer)

    # --- inside -------------------------------------------------------------------------------------------

    def lease_seen_by(self, viewer: str) -> dict[str, object]:
        """The window with the controls."""
        return self._lease.seen_by(viewer)

    def ids(self) -> list[str]:
        """The runs in progress, newest first."""
        return [folder.name for folder in self._in_progress()]

    def feed(self, run: str) -> Feed:
        """The feed of a run; see `_feed`."""
        return self._feed(run)

    def _in_progress(self) -> list[Path]:
        """Folders with a recent heartbeat: no lock is touched, which a run might need at that moment."""
        from rigctl.dataset.catalogue import newest_folders
        from rigctl.dataset.recording.writer_lock import read_state
        from rigctl.web.feed import ENDED

        with self._lock:
            when, folders = self._found
            if monotonic() - when < _LOOK:
                return folders
            folders = []
            if self._site.project.runs.is_dir():
                for folder in reversed(newest_folders(self._site.project.runs, _NEWEST)):
                    state = read_state(folder)
                    if state is not None and state.fresh and state.fields.get("state") not in ENDED:
                        folders.append(folder)
            self._found = (monotonic(), folders)
            return folders

    def _folder(self, run: str) -> Path:
        from rigctl.dataset import find_run
        from rigctl.web.project_files import plain_id

        self._site.require_project()
        return find_run(plain_id(run), self._site.project.runs)

    def _feed(self, run: str) -> Feed:
        """The feed of a run, started when the first window watches."""
        from rigctl.dataset import RunHeader
        from rigctl.dataset.run_json import read_info
        from rigctl.web.feed import Feed

        with self._lock:
            # Reading the run's header takes time and is done without the lock.
            feed = self._feeds.get(run)
            if feed is not None and feed.goes_on():
                return feed
        folder = self._folder(run)
        info = read_info(folder)
        names = RunHeader.__dataclass_fields__
        header = RunHeader.from_json({key: value for key, value in info.items() if key in names})
        with self._lock:
            self._feeds = {name: feed for name, feed in self._feeds.items() if not feed.over}
            if run not in self._feeds:  # two windows may have come at once
                self._feeds[run] = Feed(folder, header)
            return self._feeds[run]

    def _bench(self, request: PageRequest) -> Any:
        """The rig in question: that of a run, or the project's."""
        from rigctl.rig import load_rig

        self._site.require_project()
        if "run" in request.body:
            from rigctl.dataset.run_json import read_info

            description = read_info(self._folder(request.text("run")))["rig"]
            path = Path(str(description.get("path") or ""))
        else:
            return self.by_hand.rig()
        return load_rig(path)


class _Window:
    """One socket: reads the requests of its window and sends the data."""

    def __init__(self, live: Live, socket: WebSocket, viewer: str) -> None:
        self._live = live
        self._socket = socket
        self._viewer = viewer
        self._wanted: dict[str, Any] = {}
        self._changed = asyncio.Event()
        self._feed: Feed | None = None
        self._watcher: Watcher | None = None
        self._sent: dict[str, object] = {}

    async def serve(self) -> None:
        reader = asyncio.create_task(self._read())
        sender = asyncio.create_task(self._send())
        try:
            # Whichever ends first, by a closed socket or an error, takes the other with it.
            await asyncio.wait({reader, sender}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._leave()
            for task in (reader, sender):
                task.cancel()
            for ended in await asyncio.gather(reader, sender, return_exceptions=True):
                if isinstance(ended, Exception) and not isinstance(ended, RuntimeError | WebSocketDisconnect):
                    logger.error("a window of the live page", exc_info=ended)

    async def _read(self) -> None:
        """The request of the window: ``{"run", "window", "width"}``; anything else is ignored."""
        with suppress(WebSocketDisconnect):
            while True:
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                with suppress(ValueError, TypeError, RecursionError):
                    wanted = parse_json(message.get("text") or "")
                    if isinstance(wanted, dict):
                        self._wanted = wanted
                        self._changed.set()

    async def _send(self) -> None:
        with suppress(WebSocketDisconnect):
            await self._changed.wait()
            look = 0.0
            while True:
                if self._wanted:
                    wanted, self._wanted = self._wanted, {}
                    await self._watch(wanted)
                if monotonic() >= look:
                    look = monotonic() + _LOOK
                    await self._say("runs", await run_in_threadpool(self._live.ids))
                    await self._say("lease", self._live.lease_seen_by(self._viewer))
                await self._hand_on()
                with suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), _LOOK)
                self._changed.clear()

    async def _watch(self, wanted: dict[str, Any]) -> None:
        from rigctl.web.feed import Watcher, about

        run = wanted.get("run")
        if not isinstance(run, str):
            self._leave()
            return
        try:
            feed = await run_in_threadpool(self._live.feed, run)
        except (RigctlError, OSError) as problem:
            await self._say("refused", str(problem))
            return
        # Another run, or a new feed of the same one: what is still in the old queue must not be sent after
        # it.
        if feed is not self._feed:
            self._leave()
            loop = asyncio.get_running_loop()
            self._watcher = Watcher(lambda: _wake(loop, self._changed))
            self._feed = feed
            await self._say("run", await run_in_threadpool(about, feed.header))
        assert self._watcher is not None  # noqa: S101 - made beside the feed
        feed.join(
            self._watcher,
            _between(wanted.get("window"), 60.0, *_WINDOWS),
            int(_between(wanted.get("width"), 600.0, *_WIDTHS)),
        )

    async def _hand_on(self) -> None:
        if self._watcher is None:
            return
        messages, batches = self._watcher.waiting()
        for kind, what in messages.items():
            await self._socket.send_text(to_json({"kind": kind, kind: what}, indent=None))
        for batch in batches:
            await self._socket.send_bytes(batch)

    async def _say(self, kind: str, what: object) -> None:
        """Send a message if it is new."""
        if kind not in self._sent or self._sent[kind] != what:
            self._sent[kind] = what
            await self._socket.send_text(to_json({"kind": kind, kind: what}, indent=None))

    def _leave(self) -> None:
        if self._feed is not None and self._watcher is not None:
            self._feed.leave(self._watcher)
        self._feed = self._watcher = None


def _wake(loop: asyncio.AbstractEventLoop, changed: asyncio.Event) -> None:
    with suppress(RuntimeError):  # the server has ended
        loop.call_soon_threadsafe(changed.set)


def _between(given: object, otherwise: float, low: float, high: float) -> float:
    if not isinstance(given, int | float) or given != given:  # noqa: PLR0124 - NaN
        return otherwise
    return float(min(max(given, low), high))  # an integer may be too large for a float


PART = PagePart("live", "Live", "The run in progress, watched and commanded.", routes)
