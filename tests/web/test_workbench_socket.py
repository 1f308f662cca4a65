"""The server's side of the workbench's socket: it waits for no process."""

from __future__ import annotations

import asyncio
import multiprocessing
import threading
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, cast

from starlette.websockets import WebSocket

from rigctl.web.workbench.socket import _from_page


class _Page:
    """A page that sends what it is given, and then goes."""

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

    async def receive(self) -> dict[str, Any]:
        if not self._texts:
            return {"type": "websocket.disconnect"}
        return {"type": "websocket.receive", "text": self._texts.pop(0)}


def test_a_process_that_does_not_read_does_not_stop_the_server() -> None:
    """A pipe holds 64 kB; the event loop hung, and with it 'Everything off' of every window."""
    ours, theirs = multiprocessing.Pipe()
    texts = [f"{k}" + "x" * 400_000 for k in range(3)]
    went_on = threading.Event()
    heard: list[bytes] = []

    def read_late(pipe: Connection) -> None:
        went_on.wait(20.0)
        heard.extend(pipe.recv_bytes() for _ in range(3))

    reader = threading.Thread(target=read_late, args=(theirs,))

    async def served() -> bool:
        passing = asyncio.create_task(_from_page(cast("WebSocket", _Page(list(texts))), ours))
        reader.start()
        await asyncio.sleep(0.1)
        others_are_served = not passing.done() and not heard
        went_on.set()
        await passing
        return others_are_served

    with ThreadPoolExecutor() as aside:  # the browser's tests have a loop in this thread
        assert aside.submit(lambda: asyncio.run(served())).result()
    reader.join()
    assert heard == [text.encode() for text in texts]
    ours.close()
    theirs.close()
