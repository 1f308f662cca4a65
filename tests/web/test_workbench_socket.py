"""The server's side of the workbench's socket: it waits for no process."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import threading
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, cast

from starlette.websockets import WebSocket

from rigctl.web.workbench.process import TEXT, _Session
from rigctl.web.workbench.socket import _from_page, _read, _to_page


class _Page:
    """A page that sends the given messages, and then disconnects."""

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

    async def receive(self) -> dict[str, Any]:
        if not self._texts:
            return {"type": "websocket.disconnect"}
        return {"type": "websocket.receive", "text": self._texts.pop(0)}


def test_a_process_that_does_not_read_does_not_stop_the_server() -> None:
    """A pipe holds 64 kB; the event loop used to hang, and with it 'Everything off' in every window."""
    ours, theirs = multiprocessing.Pipe()
    texts = [f"{k}" + "x" * 400_000 for k in range(3)]
    went_on = threading.Event()
    heard: list[bytes] = []

    def read_late(pipe: Connection) -> None:
        went_on.wait(60.0)
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

    with ThreadPoolExecutor() as aside:  # the browser tests run an event loop in this thread
        assert aside.submit(lambda: asyncio.run(served())).result()
    reader.join()
    assert heard == [text.encode() for text in texts]
    ours.close()
    theirs.close()


class _Silent:
    """A page that reads nothing until it is allowed to."""

    def __init__(self) -> None:
        self.reads = asyncio.Event()
        self.taken: list[str] = []

    async def send_text(self, text: str) -> None:
        await self.reads.wait()
        self.taken.append(text)


def test_a_page_that_does_not_read_pauses_its_process_and_loses_no_message() -> None:
    """Frames used to queue in the server's memory, and a page left in the background filled it."""
    ours, theirs = multiprocessing.Pipe()
    count, sent = 40, []

    def work() -> None:
        for k in range(count):
            theirs.send_bytes(TEXT + f"{k}".encode() + b" " * 200_000)
            sent.append(k)

    async def served() -> tuple[int, list[str]]:
        said: asyncio.Queue[bytes | None] = asyncio.Queue()
        room, over, page = threading.Semaphore(4), threading.Event(), _Silent()
        loop = asyncio.get_running_loop()
        reader = threading.Thread(target=_read, args=(ours, loop, said, room, over))
        passing = asyncio.create_task(_to_page(cast("WebSocket", page), said, room))
        process = threading.Thread(target=work)
        reader.start()
        process.start()
        while len(sent) < 4:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)  # any further data would be read within this time
        ahead = len(sent)
        page.reads.set()
        while len(page.taken) < count:
            await asyncio.sleep(0.01)
        process.join()
        over.set()
        theirs.close()
        await asyncio.to_thread(reader.join)
        passing.cancel()
        return ahead, page.taken

    with ThreadPoolExecutor() as aside:
        ahead, taken = aside.submit(lambda: asyncio.run(served())).result()
    assert ahead <= 5
    assert [int(text) for text in taken] == list(range(count))
    ours.close()


def test_requests_beyond_the_limit_of_the_queue_are_refused() -> None:
    ours, theirs = multiprocessing.Pipe()
    session = _Session(theirs)  # its workers have not started: all requests wait
    for k in range(102):
        session.take({"do": "settle", "seq": k})
    theirs.close()
    refused = []
    while True:
        try:
            refused.append(json.loads(ours.recv_bytes()[1:]))
        except EOFError:
            break
    assert [(one["kind"], one["seq"]) for one in refused] == [("problem", 100), ("problem", 101)]
    assert "100 requests are waiting" in refused[0]["error"]["message"]
    ours.close()
