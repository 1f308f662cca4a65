"""Real servers of instrument protocols, each connected to the simulated bench of a rig.

They are independent of rigctl's clients; their register maps and nodes are written out here, as in a manual.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import cache, partial
from typing import Any, Self

from rigctl.backends.simulated.create import prepare
from rigctl.rig import Rig


class Circuit:
    """The simulated bench of an oil circuit, in real time, switched by whoever serves it.

    Attributes
    ----------
    switched: wall times (monotonic) at which an output was set, with its name and SI value.
    """

    def __init__(self, rig: Rig) -> None:
        self._device = prepare(rig, {"noise": "off", "quantised": "off", "plant": "roles"}).switch_on()
        self._names = rig.layout.channels
        self._began = time.monotonic()
        self._lock = threading.Lock()
        self.outputs = dict.fromkeys(rig.actuators, 0.0)
        self.switched: list[tuple[float, str, float]] = []

    def read(self) -> dict[str, float]:
        """The sensors now, SI."""
        with self._lock:
            self._device.run_to(time.monotonic() - self._began)
            return dict(zip(self._names, self._device.read(), strict=True))

    def set(self, actuator: str, value: float) -> None:
        with self._lock:
            now = time.monotonic()
            self._device.run_to(now - self._began)
            self._device.command(actuator, value, now - self._began, None)
            self._device.run_to(now - self._began)
            if self.outputs[actuator] != value:
                self.switched.append((now, actuator, value))
            self.outputs[actuator] = value

    @property
    def off(self) -> bool:
        return not any(self.outputs.values())


class Server(ABC):
    """A protocol server on this machine, in a thread with an event loop.

    Attributes
    ----------
    circuit: what it controls.
    port: what a rig file calls it.
    asked: requests so far.
    mute: it receives requests and answers none; may be set at any time.
    refusing: it answers every reading with an exception; may be set at any time.
    broken: values are NaN, or what the device has for that; may be set at any time.
    delay: s that it lets each answer wait; may be set at any time.
    exchanged: another device of its kind answers in its place; may be set while it is unplugged.
    to_stranger: the outputs that were commanded of that one.
    """

    switch, level = "heater", "relief_valve"  # what its switched and its continuous output are
    temperature = "oil_temperature"  # what its thermometer reads

    def __init__(self, rig: Rig, circuit: Circuit | None = None) -> None:
        self.circuit = circuit or Circuit(rig)
        self.asked = 0
        self.mute = self.refusing = self.broken = self.exchanged = False
        self.to_stranger: list[tuple[str, float]] = []
        self.delay = 0.0
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.number = int(free.getsockname()[1])
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.start()

    @property
    @abstractmethod
    def port(self) -> str: ...

    @abstractmethod
    async def _start(self) -> None: ...

    @abstractmethod
    async def _stop(self) -> None: ...

    def start(self) -> None:
        """Plug it in."""
        self._wait(self._start())

    def stop(self) -> None:
        """Unplug it: connections end, and new ones are not accepted."""
        self._wait(self._stop())

    def close(self) -> None:
        self.stop()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def output(self, name: str) -> float:
        """An output's value, SI, as the device that answers has it."""
        return 1.0 if self.exchanged else self.circuit.outputs[name]

    def set(self, name: str, value: float) -> None:
        """Set an output of the device that answers, SI."""
        if self.exchanged:
            self.to_stranger.append((name, value))
        else:
            self.circuit.set(name, value)

    async def _late(self) -> None:
        """Let an answer wait; a delay that is taken back ends that."""
        began = time.monotonic()
        while time.monotonic() - began < self.delay:
            await asyncio.sleep(0.01)

    def _wait(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(60.0)


class ModbusServer(Server):
    """The controller of `rigs/oil-circuit-modbus.yaml`, on TCP, or on a line that RTU is spoken on.

    Attributes
    ----------
    little: its words are in the opposite order to its manual's.
    beats: how often its heartbeat has changed.
    """

    little = False
    beats = 0

    @property
    def port(self) -> str:
        return f"127.0.0.1:{self.number}"

    async def _start(self) -> None:
        from pymodbus.server import ModbusTcpServer

        self._server: Any = ModbusTcpServer(
            self._device(), address=("127.0.0.1", self.number), trace_packet=self._packet
        )
        await self._server.serve_forever(background=True)

    async def _stop(self) -> None:
        await self._server.shutdown()

    def _device(self) -> Any:
        from pymodbus.simulator import DataType, SimData, SimDevice

        return SimDevice(
            1,
            (
                [SimData(0, count=16, values=False, datatype=DataType.BITS)],
                [SimData(0, count=16, values=False, datatype=DataType.BITS)],
                [SimData(0, count=120, values=0, datatype=DataType.REGISTERS)],
                [SimData(0, count=120, values=0, datatype=DataType.REGISTERS)],
            ),
            action=self._act,
        )

    def _packet(self, sending: bool, data: bytes) -> bytes:
        return b"" if self.mute else data

    async def _act(
        self, function: int, start: int, address: int, count: int, registers: list[int], written: Any
    ) -> Any:
        from pymodbus.constants import ExcCodes

        self.asked += 1
        await self._late()
        if written:
            self._written(function, address, written)
            return None
        if self.refusing:
            return ExcCodes.DEVICE_FAILURE
        if function == 4:
            registers[: len(self._inputs())] = self._inputs()
        elif function == 3:
            registers[99 - start] = 9999 if self.exchanged else 4711
            registers[0] = round(self.output(self.level) / 1e3)
        elif function == 1:
            registers[0] = int(self.output(self.switch))
        return None

    def _written(self, function: int, address: int, values: list[Any]) -> None:
        if function == 5:
            self.set(self.switch, float(values[0]))
        elif address == 0:
            self.set(self.level, values[0] * 1e3)
        else:
            self.beats += 1

    def _inputs(self) -> list[int]:
        now = self.circuit.read()
        pressure = float("nan") if self.broken else now["supply_pressure"] / 1e5
        packed = struct.unpack(">HH", struct.pack(">f", pressure))
        celsius = -32768 if self.broken else round(100.0 * (now[self.temperature] - 273.15))
        return [*(packed[::-1] if self.little else packed), celsius & 0xFFFF]


class RtuServer(ModbusServer):
    """The same on a serial line: two pseudo-terminals, back to back."""

    def __init__(self, rig: Rig, circuit: Circuit | None = None) -> None:
        import os
        import tty

        self._ends = [os.openpty(), os.openpty()]
        for master, slave in self._ends:
            tty.setraw(slave)
            os.set_blocking(master, False)
        self._names = [os.ttyname(slave) for _, slave in self._ends]
        super().__init__(rig, circuit)

    @property
    def port(self) -> str:
        return self._names[1]

    async def _start(self) -> None:
        import os

        from pymodbus.server import ModbusSerialServer

        (here, _), (there, _) = self._ends

        def carry(source: int, target: int) -> None:
            data = os.read(source, 4096)
            if not self.mute:
                os.write(target, data)

        self._loop.add_reader(here, carry, here, there)
        self._loop.add_reader(there, carry, there, here)
        self._server = ModbusSerialServer(self._device(), port=self._names[0], baudrate=19200)
        await self._server.serve_forever(background=True)

    async def _stop(self) -> None:
        import os

        await super()._stop()
        for master, slave in self._ends:
            self._loop.remove_reader(master)
            os.close(master)
            os.close(slave)


class ScpiServer(Server):
    """The switch and measurement unit of `rigs/oil-circuit-visa.yaml`, on a TCP port.

    Attributes
    ----------
    received: every line.
    answered: how many of them have been answered, or would have been.
    errors: what `SYST:ERR?` gives, first come first.
    """

    def __init__(self, rig: Rig, circuit: Circuit | None = None) -> None:
        self.received: list[str] = []
        self.answered = 0
        self.errors: list[str] = []
        self._writers: set[asyncio.StreamWriter] = set()
        super().__init__(rig, circuit)

    @property
    def port(self) -> str:
        return f"TCPIP::127.0.0.1::{self.number}::SOCKET"

    async def _start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.number)

    async def _stop(self) -> None:
        self._server.close()
        for writer in self._writers:
            writer.close()
        self._writers.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        with suppress(OSError):
            while line := await reader.readline():
                self.asked += 1
                text = line.decode("ascii", "replace").strip()
                self.received.append(text)
                answers = [answer for part in text.split(";") if (answer := self._answer(part)) is not None]
                await self._late()
                try:
                    if answers and not self.mute:
                        writer.write(f"{';'.join(answers)}\n".encode())
                        await writer.drain()
                finally:
                    self.answered += 1

    def _answer(self, part: str) -> str | None:
        command, _, arguments = part.partition(" ")
        if command == "MEAS:VOLT:DC?":
            now = self.circuit.read()
            volts = ((now["supply_pressure"] / 1e5 + 12.5) / 12.5, (now[self.temperature] - 223.15) / 20.0)
            if self.refusing:
                return "OVLD"
            return ",".join("+9.91000000E+37" if self.broken else f"{volt:+.8E}" for volt in volts)
        fixed = {
            "*IDN?": f"ACME,34980,{'OTHER' if self.exchanged else 'MY44001234'},2.1",
            "*OPC?": "1",
            "ROUT:CLOS?": f"{self.output(self.switch):.0f}",
            "SOUR:VOLT?": f"{self.output(self.level) / 6e5:+.6E}",
        }
        if command == "SYST:ERR?":
            return self.errors.pop(0) if self.errors else '+0,"No error"'
        if command in fixed:
            return fixed[command]
        if command in ("ROUT:CLOS", "ROUT:OPEN"):
            self.set(self.switch, float(command == "ROUT:CLOS"))
        elif command == "SOUR:VOLT":
            self.set(self.level, 6e5 * float(arguments.partition(",")[0]))
        elif command and command != "*CLS":
            self.errors.append('-113,"Undefined header"')
        return None


class _Controller:
    """asyncua's server, made once: its standard nodes take seconds. It serves one `OpcUaServer` at a time."""

    def __init__(self) -> None:
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self.served: OpcUaServer
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.number = int(free.getsockname()[1])
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        asyncio.run_coroutine_threadsafe(self._serve(), self._loop).result(60.0)

    async def _serve(self) -> None:
        from asyncua import ua
        from asyncua.server.server import Server as Ua

        kinds: dict[str, Any] = {
            "Plant": ua.VariantType.String,
            "SupplyPressure": ua.VariantType.Float,
            "OilTemperature": ua.VariantType.Int32,
            "Heater": ua.VariantType.Boolean,
            "ReliefValve": ua.VariantType.Float,
            "HostAlive": ua.VariantType.Byte,
        }
        server = Ua()
        await server.init()
        server.set_endpoint(f"opc.tcp://127.0.0.1:{self.number}")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        assert await server.register_namespace("circuit") == 2
        aspace, value = server.iserver.aspace, ua.AttributeIds.Value
        for name, kind in kinds.items():
            there = ua.NodeId.from_string(f"ns=2;s=Circuit.{name}")
            node = await server.nodes.objects.add_variable(there, name, "" if name == "Plant" else 0, kind)
            await node.set_writable()
            aspace.set_attribute_value_callback(there, value, partial(self._read, name, kind))
            aspace.set_attribute_value_setter(there, value, partial(self._written, name))
        clock = ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime)
        aspace.set_attribute_value_callback(clock, value, self._now)
        aspace.set_attribute_value_setter(clock, value, lambda *_: None)  # the library writes it every second
        await server.start()

    def _now(self, *_: object) -> Any:
        from asyncua import ua

        here = self.served.stopped or datetime.now(UTC).replace(microsecond=0)  # once a second
        here += timedelta(seconds=self.served.skew)
        return ua.DataValue(ua.Variant(here, ua.VariantType.DateTime), ServerTimestamp=here)

    def _read(self, name: str, kind: Any, *_: object) -> Any:
        from asyncua import ua

        served = self.served
        served.asked += 1
        if served.refusing and name == "SupplyPressure":
            return ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadSensorFailure))
        here = datetime.now(UTC) + timedelta(seconds=served.skew)
        value = served.values()[name]
        return ua.DataValue(
            ua.Variant(value, ua.VariantType.String if isinstance(value, str) else kind),
            StatusCode=ua.StatusCode(getattr(ua.StatusCodes, served.statuses.get(name, "Good"))),
            SourceTimestamp=served.frozen or here,
            ServerTimestamp=(served.frozen if served.caching else None) or here,
        )

    def _written(self, name: str, _node: object, _attribute: object, value: Any) -> None:
        self.served.written(name, float(value.Value.Value))


@cache
def _controller() -> _Controller:
    return _Controller()


class OpcUaServer(Server):
    """The controller of `rigs/oil-circuit-opcua.yaml`, and a plug between its server and clients.

    Attributes
    ----------
    beats: how often its heartbeat has changed.
    frozen: its sources have stopped, and their last time stamp stays; may be set at any time.
    caching: it returns the server time stamp of a value that was read earlier, too; may be set at any time.
    stopped: its own clock stands still; may be set at any time.
    skew: s by which the controller's clock is ahead of this computer's; may be set at any time.
    statuses: status codes other than "Good", by name of the node; may be changed at any time.
    """

    beats = 0
    frozen: datetime | None = None
    stopped: datetime | None = None
    caching = False
    skew = 0.0

    def __init__(self, rig: Rig, circuit: Circuit | None = None) -> None:
        self._ends: set[asyncio.StreamWriter] = set()
        self.statuses: dict[str, str] = {}
        _controller().served = self
        super().__init__(rig, circuit)

    @property
    def port(self) -> str:
        return f"opc.tcp://127.0.0.1:{self.number}"

    def values(self) -> dict[str, Any]:
        now = self.circuit.read()
        return {
            "Plant": "another plant" if self.exchanged else "oil circuit 4711",
            "SupplyPressure": float("nan") if self.broken else now["supply_pressure"] / 1e5,
            "OilTemperature": round(100.0 * (now[self.temperature] - 273.15)),
            "Heater": bool(self.output(self.switch)),
            "ReliefValve": self.output(self.level) / 1e5,
            "HostAlive": self.beats % 128,
        }

    def written(self, name: str, number: float) -> None:
        if name == "Heater":
            self.set(self.switch, number)
        elif name == "ReliefValve":
            self.set(self.level, number * 1e5)
        else:
            self.beats += 1

    async def _start(self) -> None:
        self._plug = await asyncio.start_server(self._carry, "127.0.0.1", self.number)

    async def _stop(self) -> None:
        self._plug.close()
        for writer in self._ends:
            writer.close()
        self._ends.clear()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", _controller().number)
        self._ends |= {writer, back}
        await asyncio.gather(self._copy(reader, back), self._copy(there, writer))

    async def _copy(self, source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await source.read(65536):
                await self._late()
                if not self.mute:
                    target.write(data)
                    await target.drain()
        target.close()


#: kind of backend -> the server that its shipped rig is for
SERVERS: dict[str, Callable[[Rig], Server]] = {
    "modbus": ModbusServer,
    "visa": ScpiServer,
    "opcua": OpcUaServer,
}
