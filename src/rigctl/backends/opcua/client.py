"""The client of an OPC UA server: reads and writes of nodes for `rigctl.rig.protocols.client_lines`.

asyncua implements the protocol, in its own event loop; the thread of a `ClientPort` waits for it.
"""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotInTime
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeVar

from rigctl.backends.transport.client_port import ClientPort
from rigctl.backends.transport.port import AnotherDevice, PortLost
from rigctl.backends.transport.readback import repeats
from rigctl.clock import Clock

_PRODUCT, _VERSION, _NOW = "i=2261", "i=2264", "i=2258"  # of the server's status; part 5, 12.10
_ENDS_WITHIN = 0.5  # s to close the session

#: status codes of a session that cannot be used again
_ENDED = (
    "BadConnectionClosed",
    "BadSecureChannelClosed",
    "BadSecureChannelIdInvalid",
    "BadSessionClosed",
    "BadSessionIdInvalid",
    "BadServerHalted",
    "BadShutdown",
)

Result = TypeVar("Result")


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
    """Open the port of an `Address`: ``opc.tcp://host:port/path``.

    Its settings are those of `rigctl.backends.opcua.create.settings_of`.
    """
    return ClientPort(url, lambda: OpcUaClient(url, settings), clock)


@dataclass(frozen=True)
class _Item:
    """A node and the scale of its number; fields as in `rigctl.rig.protocols.opcua`."""

    node: str
    scale: float
    offset: float
    max_age: float | None
    age: bool

    def repeats(self, answer: Any, number: float) -> bool:
        """Return whether a node's answer is a number that was written to another node, as this one rounds."""
        there = None if answer.Value is None else answer.Value.Value
        if not (answer.StatusCode.is_good() and isinstance(there, bool | int | float)):
            return False
        return not isinstance(there, bool) and repeats(there, self.scale, self.offset, number)

    def text(self, answer: Any, clock: _ServerClock) -> str:
        """Return the number in a node's answer as text, with all its digits, as ``5`` could be a rounded 5.4;
        ``nan`` if there is none, its status is not good, or its time stamp is too old or in the future.

        The age refers to the server's clock: a cached value may have an old server timestamp, too.
        """
        source, now = answer.SourceTimestamp, clock.now
        age = math.nan if source is None or now is None else (now - source).total_seconds() + clock.stands
        if self.age:
            return f"{age:.6f}" if math.isfinite(age) else "nan"
        value = None if answer.Value is None else answer.Value.Value
        if not (answer.StatusCode.is_good() and isinstance(value, bool | int | float)):
            return "nan"
        # if the source's clock is ahead, a value looks fresh until that time, even if the source has stopped
        if self.max_age is not None and not abs(age) <= self.max_age:
            return "nan"
        if isinstance(value, bool):
            return str(int(value))
        number = value * self.scale + self.offset
        return f"{number:.15e}" if math.isfinite(number) else "nan"


class _ServerClock:
    """The server's time: the latest one in its newest answer, and how long ago that was first seen.

    Servers update their current time once a second or more often, and may return old server timestamps with
    values that they cache. What stands still is therefore extrapolated with this computer's clock.

    Attributes
    ----------
    now: the latest time; None if the server tells none.
    stands: s for which it has been the same.
    """

    def __init__(self) -> None:
        self.now: datetime | None = None
        self.stands = 0.0
        self._since = -math.inf  # s, monotonic

    def read(self, current: Any, values: Sequence[Any]) -> None:
        """Take the server's answers: its current time, and the values read with it."""
        times = [answer.ServerTimestamp for answer in (*values, current)]
        times.append(None if current.Value is None else current.Value.Value)
        now = max((one for one in times if isinstance(one, datetime)), default=None)
        if now is None or now != self.now:
            self._since = time.monotonic()
        self.now, self.stands = now, time.monotonic() - self._since


class OpcUaClient:
    """One session with a server.

    Raises
    ------
    PortLost
        there is no connection.
    """

    def __init__(self, url: str, settings: Mapping[str, Any]) -> None:
        from asyncua import ua
        from asyncua.client.client import Client
        from asyncua.ua.uaerrors import UaError, UaStatusCodeError

        logging.getLogger("asyncua").addHandler(logging.NullHandler())  # relevant errors are raised
        logging.getLogger("asyncua").propagate = False
        self._ua: Any = ua
        self._error, self._refusal = UaError, UaStatusCodeError
        self._ended = {getattr(self._ua.StatusCodes, name) for name in _ENDED}
        self._name = url
        self._timeout = float(settings["timeout"])
        self._identify = settings["identify"]
        self._reads = [{name: _Item(**item) for name, item in names.items()} for names in settings["reads"]]
        self._writes = {name: _Item(**item) for name, item in settings["writes"].items()}
        self._heartbeat = settings["heartbeat"]
        self._count, self._beat_at = 0, -math.inf
        self._clock = _ServerClock()
        self._found = ""  # the identity, once the server has been identified
        self._types: dict[str, Any] = {}  # types of the nodes that are written
        self._set: dict[str, tuple[float, float, str]] = {}  # last written: in the node, its number, its text
        # asyncua needs an event loop that runs all the time, as it renews the session in the background. The
        # calls come from the thread of the `ClientPort`, one at a time.
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name=f"loop of {url}")
        self._thread.start()
        self._session: Any = Client(url, timeout=self._timeout)
        try:
            if self._waited(self._session.connect(), float(settings["wake"])) is _LATE:
                raise PortLost(f"{url}: nobody answers")
        except (TimeoutError, OSError, UaError) as error:
            self._stop()
            raise PortLost(f"{url}: {error or 'nobody answers'}") from None
        except BaseException:
            self._stop()
            raise

    def answer(self, line: str) -> str | None:
        """Return the answer to a line of `rigctl.rig.protocols.client_lines`."""
        name, _, argument = line.partition(" ")
        try:
            answer = self._waited(self._carry_out(name, argument), self._timeout)
        except (ValueError, self._refusal) as refused:
            # Of the status codes those of a dead session are a loss of contact; all others are refusals by
            # the server.
            if getattr(refused, "code", None) in self._ended:
                raise PortLost(f"{self._name}: {refused}") from None
            return f"error {' '.join(str(refused).split())}"
        except TimeoutError:
            return None
        except (OSError, self._error) as error:
            raise PortLost(f"{self._name}: {error or 'the connection was closed'}") from None
        # Late is silence: the line-based code repeats the query, or takes the device for lost.
        return None if answer is _LATE else str(answer)

    def close(self) -> None:
        """Close the session."""
        with suppress(OSError, self._error, asyncio.TimeoutError):
            self._waited(self._session.disconnect(), _ENDS_WITHIN)
        self._stop()

    def _stop(self) -> None:
        """Stop the event loop, and the library's remaining tasks."""

        async def cancel() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

        self._waited(cancel(), _ENDS_WITHIN)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_ENDS_WITHIN)
        if not self._thread.is_alive():
            self._loop.close()

    def _waited(self, work: Coroutine[Any, Any, Result], limit: float) -> Result | object:
        """Return the result of a task in the event loop; `_LATE` if it takes longer than `limit` s."""
        begun: Future[Result] = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return begun.result(limit)
        except NotInTime:
            begun.cancel()
            return _LATE

    async def _carry_out(self, name: str, argument: str) -> str:
        if name == "identify":
            answer = await self._who()
        elif name == "read":
            answer = await self._read(int(argument))
        elif name == "write":
            answer = await self._write(*argument.split(" "))
        elif name == "beat":
            answer = "ok"
        else:
            raise ValueError(f"not understood: {name}")
        if self._heartbeat is not None and time.monotonic() - self._beat_at >= self._heartbeat[1]:
            await self._beat()  # only while the caller is alive
        return answer

    async def _who(self) -> str:
        asked = [_PRODUCT, _VERSION] + ([] if self._identify is None else [self._identify[0]])
        found = [self._text(answer) for answer in await self._fetch(asked)]
        identity = f"opcua {' '.join(text for text in found if text) or 'unknown'}"
        if self._found and identity != self._found:
            raise AnotherDevice(f"{self._name}: another server answers than before: {identity}")
        if self._identify is not None and found[2] != self._identify[1]:
            return f"no plant {self._identify[1]} but {found[2]}"
        self._found = identity
        return identity

    @staticmethod
    def _text(answer: Any) -> str:
        return "" if answer.Value is None or answer.Value.Value is None else str(answer.Value.Value)

    async def _read(self, index: int) -> str:
        items = self._reads[index]
        *answers, clock = await self._fetch([*(item.node for item in items.values()), _NOW])
        self._clock.read(clock, answers)
        texts = []
        for (name, item), answer in zip(items.items(), answers, strict=True):
            there = None if answer.Value is None else answer.Value.Value
            written = self._set.get(name)
            same = written is not None and answer.StatusCode.is_good() and written[0] == there
            text = item.text(answer, self._clock)
            if written is not None and (same or (text != "nan" and item.repeats(answer, written[1]))):
                text = written[2]
            texts.append(text)
        return " ".join(texts)

    async def _fetch(self, nodes: list[str]) -> list[Any]:
        ua = self._ua
        asked = [
            ua.ReadValueId(NodeId=ua.NodeId.from_string(node), AttributeId=ua.AttributeIds.Value)
            for node in nodes
        ]
        both = ua.TimestampsToReturn.Both
        return list(
            await self._session.uaclient.read(ua.ReadParameters(NodesToRead=asked, TimestampsToReturn=both))
        )

    async def _write(self, name: str, text: str) -> str:
        item = self._writes[name]
        put = await self._put(item.node, (float(text) - item.offset) / item.scale)
        self._set[name] = (put, put * item.scale + item.offset, text)
        return "ok"

    async def _beat(self) -> None:
        self._beat_at = time.monotonic()
        self._count = (self._count + 1) % (1 << 7)
        await self._put(self._heartbeat[0], float(self._count))

    async def _put(self, node: str, number: float) -> float:
        """Write a number in the node's data type, and return what was written."""
        ua = self._ua
        # A server refuses a number of another type than its node's. The type is asked for once.
        if node not in self._types:
            self._types[node] = await self._session.get_node(node).read_data_type_as_variant_type()
        kind = self._types[node]
        value: bool | int | float = number
        if kind is ua.VariantType.Boolean:
            value = round(number) != 0
        elif kind not in (ua.VariantType.Float, ua.VariantType.Double):
            value = round(number)
        try:
            written = ua.DataValue(ua.Variant(value, kind))
            ua.ua_binary.variant_to_binary(written.Value)
        except Exception:  # noqa: BLE001 - asyncua raises a different error for each type; sending it would end the session
            raise ValueError(f"node {node}: {value:g} is no value of type {kind.name}") from None
        (status,) = await self._session.uaclient.write_attributes([ua.NodeId.from_string(node)], [written])
        status.check()
        # What the node holds from now on, to be recognised when it is read back.
        if kind is ua.VariantType.Float:
            from struct import pack, unpack

            (value,) = unpack("<f", pack("<f", value))
        return value


_LATE = object()  # returned instead of an answer
