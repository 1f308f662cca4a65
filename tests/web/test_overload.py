"""Everything off is reachable, whatever other clients and other requests do."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from rigctl.project import Project
from rigctl.web.jobs import Jobs
from rigctl.web.procedure import Procedures
from rigctl.web.request_handling import PageRequest, get, post
from rigctl.web.request_timeout import MOST_CONNECTIONS
from rigctl.web.server_state import Site
from systems import needs_posix
from web.serving import Served


@pytest.mark.parametrize("head", [b"", b"GET / HTTP/1.1\r\nHost: 127", b"GET /assets/live.js HTTP/1.1\r\n"])
def test_many_connections_of_strangers_keep_nobody_out(served: Served, cookie: str, head: bytes) -> None:
    """From 200 on every request used to be answered with 503, and 'Everything off' was one of them."""
    rig = {"Origin": served.base}
    with ExitStack() as lines:
        for _ in range(2 * MOST_CONNECTIONS):
            line = lines.enter_context(socket.create_connection(("127.0.0.1", served.port), timeout=60.0))
            if head:
                line.sendall(head)
        assert served.ask("GET", "/api/status", cookie=cookie)[0] == 200
        status, _, text = served.ask("POST", "/api/live/off", {}, headers=rig, cookie=cookie)
        assert status == 200, text


async def _ask(app: Starlette, method: str, path: str) -> int:
    """The status of an answer, asked for as the server does."""
    scope: dict[str, Any] = {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": b"",
        "headers": [],
    }
    answers: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        answers.append(dict(message))

    await app(scope, receive, send)
    return int(answers[0]["status"])


def test_requests_that_are_stuck_hold_up_no_reserved_one() -> None:
    """Forty that waited for a pipe used to take every thread; too many are refused at once."""
    released = threading.Event()

    def stuck(_: PageRequest) -> dict[str, Any]:
        released.wait(60.0)
        return {}

    app = Starlette(routes=[get("/stuck", stuck), post("/off", lambda _: {}, reserved=True)])

    async def asked() -> tuple[int, list[int]]:
        waiting = [asyncio.create_task(_ask(app, "GET", "/stuck")) for _ in range(100)]
        await asyncio.sleep(0.1)
        off = await _ask(app, "POST", "/off")
        released.set()
        return off, await asyncio.gather(*waiting)

    with ThreadPoolExecutor() as aside:  # the browser tests run an event loop in this thread
        off, others = aside.submit(lambda: asyncio.run(asked())).result()
    assert off == 200
    assert (others.count(200), others.count(503)) == (80, 20)


@needs_posix("pipes in folders")
def test_a_rig_that_is_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    procedures = Procedures(Site(Project(tmp_path, tmp_path / "runs"), Jobs(tmp_path)))
    text = f"procedure: x\nrig: {tmp_path}/pipe.yaml\nsteps: [wait: 1 s]\n"
    told = procedures.check(PageRequest({}, {}, {"path": "procedures/a.yaml", "text": text}))
    (error,) = told["errors"]
    assert "it is a pipe or a device, not a file" in error["message"]
