"""Connects a page with its workbench: messages pass unchanged.

For each page: a process, a thread that reads its pipe, and two tasks of the event loop, one for each
direction. The thread reads on only while there is room in the queue, so that a page that does not read
holds up its own process and fills no memory. Whichever direction ends first ends all.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Final

from rigctl.errors import ExitCode, RigctlError
from rigctl.web.server_state import Site
from rigctl.web.workbench.process import TEXT, attend

if TYPE_CHECKING:
    from starlette.websockets import WebSocket

#: workbenches that are open at a time; each holds its records in memory
_MOST: Final = 4
#: messages of a process that wait for a page; the process waits with the next
_MOST_WAITING: Final = 8
#: s for a process to end
_GRACE: Final = 1.0


def session_endpoint(site: Site) -> Callable[[WebSocket], Awaitable[None]]:
    """The server's side of the socket: one process for each page."""
    open_now: list[object] = []

    async def endpoint(socket: WebSocket) -> None:
        await socket.accept()
        if len(open_now) >= _MOST:
            await _refuse(socket)
            return
        open_now.append(socket)
        try:
            await _through(socket, str(site.project.root))
        finally:
            open_now.remove(socket)

    return endpoint


async def _refuse(socket: WebSocket) -> None:
    error = RigctlError(
        f"{_MOST} workbenches are open already", hint="Close one of them", exit_code=ExitCode.FAILED
    )
    await socket.send_json({"kind": "problem", "do": "open", "error": error.as_dict()})
    await socket.close()


async def _through(socket: WebSocket, folder: str) -> None:
    """Pass on messages until the page or the process ends."""
    loop = asyncio.get_running_loop()
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=attend, args=(theirs, folder), name="rigctl workbench", daemon=True)
    await loop.run_in_executor(None, process.start)
    theirs.close()
    messages: asyncio.Queue[bytes | None] = asyncio.Queue()
    room = threading.Semaphore(_MOST_WAITING)
    over = threading.Event()
    reader = threading.Thread(
        target=_read, args=(ours, loop, messages, room, over), name="workbench", daemon=True
    )
    reader.start()
    tasks = [
        asyncio.create_task(_to_page(socket, messages, room)),
        asyncio.create_task(_from_page(socket, ours)),
    ]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        # The thread may be waiting for room, or in `recv_bytes`: the first is released here, the second by
        # the end of the process.
        over.set()
        room.release()
        process.terminate()
        await loop.run_in_executor(None, _ended, process)
        ours.close()


def _read(
    pipe: Connection,
    loop: asyncio.AbstractEventLoop,
    messages: asyncio.Queue[bytes | None],
    room: threading.Semaphore,
    over: threading.Event,
) -> None:
    """Read a process's messages while there is `room`, so that a page that does not read fills no memory."""
    with suppress(EOFError, OSError, RuntimeError):  # the event loop has ended
        while True:
            room.acquire()
            if over.is_set():
                return
            loop.call_soon_threadsafe(messages.put_nowait, pipe.recv_bytes())
    with suppress(RuntimeError):
        loop.call_soon_threadsafe(messages.put_nowait, None)


async def _to_page(
    socket: WebSocket, messages: asyncio.Queue[bytes | None], room: threading.Semaphore
) -> None:
    while True:
        message = await messages.get()
        if message is None:
            error = RigctlError(
                "the process behind this workbench has ended",
                hint="It may have run out of memory; open the model again",
                exit_code=ExitCode.FAILED,
            )
            with suppress(RuntimeError):
                await socket.send_json({"kind": "problem", "do": "end", "error": error.as_dict()})
                await socket.close()
            return
        if message[:1] == TEXT:
            await socket.send_text(message[1:].decode("utf-8"))
        else:
            await socket.send_bytes(message[1:])
        room.release()


async def _from_page(socket: WebSocket, pipe: Connection) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        text = message.get("text")
        if text is None:  # the server closes the socket after too long a message
            await socket.close(1003)
            return
        with suppress(OSError):  # the process has ended, as the other task reports
            # a full pipe waits for a process that is busy, and the server must not wait with it
            await asyncio.to_thread(pipe.send_bytes, text.encode("utf-8", "replace"))


def _ended(process: Any) -> None:
    process.join(_GRACE)
    if process.is_alive():
        process.kill()
        process.join(_GRACE)
