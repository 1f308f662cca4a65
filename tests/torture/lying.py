"""Devices that lie, are exchanged, go silent or stale, or have a loose contact, at every ending of a run,
behind each protocol.

Each trial is a run in virtual time with rigctl's own clients; in place of the protocol libraries there is a
device in memory, the witness of its outputs and of what was sent to a stranger in its place. After
each run either all outputs are off, or the run has said that they may be on; and every record that is
complete has stored the outputs as they were.
"""

from __future__ import annotations

import math
import random
import shutil
import signal
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rigctl.backends.lines.bench import LineBench
from rigctl.backends.modbus import client as modbus_client
from rigctl.backends.opcua import client as opcua_client
from rigctl.backends.registry import address_of
from rigctl.backends.transport.client_port import Client
from rigctl.backends.transport.port import PortLost
from rigctl.backends.visa.client import VisaClient
from rigctl.dataset import Run, open_run
from rigctl.files.shipped import shipped
from rigctl.rig import Lines, Rig, load_rig, parse_rig
from rigctl.runner.session import RunResult
from rigctl.testing import FakeSerial, ScriptedClock
from run_workshop import Workshop
from tclab_board import Sketch

KINDS = ("lines", "modbus", "visa", "opcua")
FAULTS = (
    *("none", "lie", "force", "mute", "gone", "exchanged", "exchanged unnoticed", "refuse", "stale"),
    "intermittent",  # every second or third temperature is impossible
)
#: the device starts again, with its outputs at other values, and is gone for a while or for good
AWAY = "restart away"
#: the same, but it is there again at once: it closes the connection, or nobody notices
RESTARTS = ("restart", "restart unnoticed", AWAY)
ENDINGS = ("finish", "fail", "interlock", "SIGINT", "SIGTERM", "SIGHUP")
_PATIENT = 1e6  # s: a fault that lasts
_ANSWER_TAKES = 0.004  # s
#: degC: the temperature, one beyond its limit, and one that no sensor can measure
_COLD, _HOT, _IMPOSSIBLE = 20.0, 110.0, 300.0
#: s from the limit exceeded to all outputs off, whatever share of the readings is impossible: twice the time
#: for which it must be exceeded, and three samples
_OFF_WITHIN = {"lines": 3.5, "modbus": 1.4, "visa": 1.4, "opcua": 1.7}
#: s before a sample in which its outputs were read
_READ_WITHIN = 0.6
#: an output of a device in its own numbers, for 1 bar
_PER_BAR = {"modbus": 100.0, "visa": 1.0 / 6.0}

STEPS = """\
steps:
  - set: {HEAT_ON}
  - record: {name: heating, rate: 5 Hz}
    do:
      - wait: 2 s
      - set: {MORE}
      - wait: 2 s
      - set: {HEAT_OFF}
  - LAST
finally:
  - set: {HEAT_OFF}
"""
_OUTPUTS = {
    "lines": {
        "HEAT_ON": "heater_1: 60 %",
        "MORE": "heater_2: 40 %",
        "HEAT_OFF": "heater_1: 0 %, heater_2: 0 %",
    },
    "oil": {
        "HEAT_ON": "heater: on, relief_valve: 20 bar",
        "MORE": "relief_valve: 30 bar",
        "HEAT_OFF": "heater: off, relief_valve: 0 bar",
    },
}


@dataclass
class Device:
    """The outputs of a device in memory, and what is wrong with it.

    Attributes
    ----------
    outputs: what they really are, in the device's own numbers.
    fault: one of `FAULTS`; after one of `RESTARTS` it works as before, or is gone.
    power_on: the value of each output after a restart.
    restarted: s, when a restart has changed an output.
    changed: the outputs that it has changed.
    written: s and the outputs that were commanded.
    hot: whether the temperature is beyond its limit.
    every: which reading of a loose contact is impossible: 2 is every second one.
    history: s and the outputs from then on.
    stranger: the outputs of another device, which answers in its place while the fault is "exchanged".
    sent_to_stranger: what was written to that one.
    """

    clock: ScriptedClock
    outputs: dict[str, float]
    fault: str = "none"
    stranger: dict[str, float] = field(default_factory=dict)
    sent_to_stranger: list[str] = field(default_factory=list)
    fault_since: datetime | None = None
    dropped: bool = False
    power_on: float = 0.0
    restarted: float | None = None
    changed: set[str] = field(default_factory=set)
    written: list[tuple[float, str]] = field(default_factory=list)
    hot: bool = False
    every: int = 2
    readings: int = 0
    history: list[tuple[float, dict[str, float]]] = field(default_factory=list)

    def temperature(self) -> float:
        """The next reading, degC."""
        self.readings += 1
        if self.fault == "intermittent" and self.readings % self.every == 0:
            return _IMPOSSIBLE
        return _HOT if self.hot else _COLD

    def _note(self) -> None:
        self.history.append((self.clock.now(), dict(self.outputs)))

    def between(self, name: str, start: float, end: float) -> set[float]:
        """The values that an output had from `start` to `end`, s."""
        earlier = [outputs[name] for time, outputs in self.history if time <= start]
        return {*(earlier[-1:] or [0.0]), *(one[name] for time, one in self.history if start < time <= end)}

    def last_on(self) -> float:
        """When an output was switched off last, s; infinite while one is on."""
        offs = [
            after[0]
            for before, after in pairwise(self.history)
            if any(before[1].values()) and not any(after[1].values())
        ]
        return math.inf if any(self.outputs.values()) else max(offs, default=0.0)

    @property
    def restart_is_hidden(self) -> bool:
        """Whether what the restart changed was commanded while an answer was on its way, so that nobody can
        notice: each output had its new value some milliseconds before, if at all.
        """
        since = self.restarted or 0.0
        return self.changed <= {name for time, name in self.written if since < time <= since + _ANSWER_TAKES}

    @property
    def exchanged(self) -> bool:
        return self.fault.startswith("exchanged")

    def begin(self, fault: str) -> None:
        if fault in RESTARTS:
            after = dict.fromkeys(self.outputs, self.power_on)
            self.restarted = self.clock.now() if after != self.outputs else None
            self.changed = {name for name, value in after.items() if value != self.outputs[name]}
            self.outputs, self.dropped = after, fault == "restart"
            self._note()
            if fault != AWAY:
                return
            fault = "gone"
        self.fault, self.fault_since = fault, self.now()
        self.stranger = dict.fromkeys(self.outputs, 1.0)
        self.dropped = fault in ("gone", "exchanged")

    def end(self) -> None:
        self.fault, self.dropped = "none", True

    def now(self) -> datetime:
        return datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=self.clock.now())

    def state(self, name: str) -> float:
        return (self.stranger if self.exchanged else self.outputs)[name]

    def write(self, name: str, value: float) -> bool:
        """Write an output; False if the device refuses and says so."""
        self.written.append((self.clock.now(), name))
        if self.exchanged:
            self.sent_to_stranger.append(f"{name} {value:g}")
            self.stranger[name] = value
        elif self.fault not in ("lie", "force", "refuse"):
            self.outputs[name] = value
            self._note()
        return self.fault != "refuse"


class DirectPort(FakeSerial):
    """The port of a client, which is asked at once; a silent device costs virtual time only."""

    def __init__(self, device: Device, connect: Callable[[], Client], clock: ScriptedClock) -> None:
        super().__init__(self, clock, delay=_ANSWER_TAKES)
        self._bench_device, self._connect = device, connect
        self._client: Client | None = None
        self._lost = False

    def check(self) -> None:
        if self._bench_device.fault == "gone":
            raise PortLost("nobody is there")
        self._client, self._lost, self._bench_device.dropped = self._connect(), False, False
        self._coming.clear()  # what was on its way is lost with the connection

    def _present(self) -> None:
        if self._lost or self._bench_device.dropped:
            self._lost = True
            raise PortLost("the connection was closed")

    def take(self, data: bytes) -> bytes:
        assert self._client is not None
        answers = []
        for line in data.decode().split("\n"):
            if line.strip():
                try:
                    answers.append(self._client.answer(line.strip()))
                except PortLost:
                    self._lost = True
                    raise
        return b"".join(f"{answer}\n".encode() for answer in answers if answer is not None)


# --- the devices behind each library ---


def _modbus(rig: Rig, device: Device, patch: pytest.MonkeyPatch) -> Callable[[], Client]:
    """Registers of `rigs/oil-circuit-modbus.yaml`, in place of pymodbus."""
    from pymodbus.exceptions import ModbusIOException

    def answer(function: int, **fields: object) -> Any:
        if device.fault == "mute":
            raise ModbusIOException("no response")
        return SimpleNamespace(isError=lambda: False, function_code=function, **fields)

    def holding(address: int, count: int, **_: object) -> Any:
        words = {0: round(device.state("relief_valve")), 99: 9999 if device.exchanged else 4711}
        return answer(3, registers=[words.get(address + offset, 0) for offset in range(count)])

    def inputs(address: int, count: int, **_: object) -> Any:
        pressure = struct.unpack(">HH", struct.pack(">f", device.state("relief_valve") / 100.0))
        words = [*pressure, round(100.0 * device.temperature())]
        return answer(4, registers=words[address : address + count])

    def coils(address: int, count: int, **_: object) -> Any:
        return answer(1, bits=[bool(device.state("heater"))] + [False] * 7)

    def write_coil(address: int, value: bool, **_: object) -> Any:
        taken = answer(5, address=address, bits=[value])
        return taken if device.write("heater", float(value)) else _exception(4)

    def write_register(address: int, value: int, **_: object) -> Any:
        taken = answer(6, address=address, registers=[value])
        return taken if address == 1 or device.write("relief_valve", float(value)) else _exception(4)

    library = SimpleNamespace(
        connect=lambda: True,
        close=lambda: None,
        connected=True,
        socket=None,
        read_coils=coils,
        read_discrete_inputs=coils,
        read_holding_registers=holding,
        read_input_registers=inputs,
        write_coil=write_coil,
        write_register=write_register,
    )
    patch.setattr(modbus_client, "_connection", lambda *_: library)
    address = address_of(rig, None)
    return lambda: modbus_client.ModbusClient(address.url, address.settings)


def _exception(code: int) -> Any:
    return SimpleNamespace(isError=lambda: True, exception_code=code)


class _Instrument:
    """The messages of `rigs/oil-circuit-visa.yaml`, in place of PyVISA's resource on a GPIB bus."""

    timeout = 500.0

    def __init__(self, device: Device) -> None:
        self._device = device
        self._answer = ""
        self._errors: list[str] = []

    def write(self, line: str) -> None:
        answers = [answer for part in line.split(";") if (answer := self._one(part.strip())) is not None]
        self._answer = ";".join(answers)

    def read_bytes(self, *_: object, **__: object) -> bytes:
        from pyvisa.constants import StatusCode
        from pyvisa.errors import VisaIOError

        if self._device.fault == "mute" or not self._answer:
            raise VisaIOError(StatusCode.error_timeout)
        return self._answer.encode()

    def clear(self) -> None:
        self._answer = ""

    def close(self) -> None:
        """Nothing to close."""

    def _one(self, part: str) -> str | None:
        device, (command, _, argument) = self._device, part.partition(" ")
        heater, relief = device.state("heater"), device.state("relief_valve")
        volts = (device.temperature() + 50.0) / 20.0 if command == "MEAS:VOLT:DC?" else 0.0
        answers = {
            "*IDN?": f"ACME,34980,{'OTHER' if device.exchanged else 'MY44001234'},2.1",
            "*OPC?": "1",
            "MEAS:VOLT:DC?": f"{(relief * 6 + 12.5) / 12.5:.6f},{volts:.4f}",
            "ROUT:CLOS?": f"{heater:.0f}",
            "SOUR:VOLT?": f"{relief:.6f}",
        }
        if command == "SYST:ERR?":
            return self._errors.pop(0) if self._errors else '+0,"No error"'
        if command in answers:
            return answers[command]
        if command == "*CLS":
            self._errors.clear()
        elif command.startswith("ROUT:"):
            self._took(device.write("heater", float(command == "ROUT:CLOS")))
        elif command == "SOUR:VOLT":
            self._took(device.write("relief_valve", float(argument.partition(",")[0])))
        return None

    def _took(self, done: bool) -> None:
        if not done:
            self._errors.append('-221,"Settings conflict; local lockout"')


def _visa(rig: Rig, device: Device, patch: pytest.MonkeyPatch) -> Callable[[], Client]:
    class Bus(VisaClient):
        def _opened(self) -> Any:
            return _Instrument(device)

    address = address_of(rig, "GPIB0::9::INSTR")
    patch.setattr("pyvisa.ResourceManager", lambda *_: SimpleNamespace(close=lambda: None))
    return lambda: Bus(address.url, address.settings)


class _Session:
    """The nodes of `rigs/oil-circuit-opcua.yaml`, in place of asyncua's session."""

    device: Device

    def __init__(self, *_: object, **__: object) -> None:
        self.uaclient = self

    async def connect(self) -> None:
        """Connected at once."""

    async def disconnect(self) -> None:
        """Nothing to close."""

    def get_node(self, node: str) -> Any:
        from asyncua import ua

        kinds = {"Heater": ua.VariantType.Boolean, "HostAlive": ua.VariantType.Byte}
        kind = kinds.get(node.rpartition(".")[2], ua.VariantType.Double)

        async def read() -> Any:
            return kind

        return SimpleNamespace(read_data_type_as_variant_type=read)

    async def read(self, asked: Any) -> list[Any]:
        from asyncua import ua

        if self.device.fault == "mute":
            raise TimeoutError
        return [self._value(each.NodeId.to_string(), ua) for each in asked.NodesToRead]

    async def write_attributes(self, nodes: list[Any], values: list[Any]) -> list[Any]:
        from asyncua import ua

        if self.device.fault == "mute":
            raise TimeoutError
        name = {"Heater": "heater", "ReliefValve": "relief_valve"}.get(
            nodes[0].to_string().rpartition(".")[2]
        )
        done = name is None or self.device.write(name, float(values[0].Value.Value))
        return [ua.StatusCode(ua.StatusCodes.Good if done else ua.StatusCodes.BadUserAccessDenied)]

    def _value(self, node: str, ua: Any) -> Any:
        device, now = self.device, self.device.now()
        stale = device.fault == "stale"
        source = device.fault_since if stale else now
        values: dict[str, Any] = {
            "Plant": "another plant" if device.exchanged else "oil circuit 4711",
            "SupplyPressure": device.state("relief_valve"),
            "OilTemperature": 100.0 * device.temperature() if node.endswith("OilTemperature") else 0.0,
            "Heater": bool(device.state("heater")),
            "ReliefValve": device.state("relief_valve"),
            "i=2258": now,
        }
        value = values.get(node.rpartition(".")[2], values.get(node, "product"))
        answer = ua.DataValue(ua.Variant(value))
        cached = stale and node.endswith("SupplyPressure")
        return ua.DataValue(
            answer.Value, SourceTimestamp=source if cached else now, ServerTimestamp=source if cached else now
        )


def _opcua(rig: Rig, device: Device, patch: pytest.MonkeyPatch) -> Callable[[], Client]:
    _Session.device = device
    patch.setattr("asyncua.client.client.Client", _Session)
    patch.setattr(opcua_client, "time", SimpleNamespace(monotonic=device.clock.now))
    address = address_of(rig, None)
    return lambda: opcua_client.OpcUaClient(address.url, address.settings)


class _Board(Sketch):
    """The two-heater board, with the same faults."""

    def __init__(self, device: Device) -> None:
        super().__init__(device.clock.now)
        self._device = device

    def take(self, data: bytes) -> bytes:
        return b"" if self._device.fault == "mute" else super().take(data)

    def _answer(self, line: str) -> bytes:
        name, _, argument = line.partition(" ")
        device = self._device
        if name == "T1":
            return f"{device.temperature():.3f}\r\n".encode()
        if name == "VER" and device.exchanged:
            return b"TCLab Firmware 1.4.0 of the neighbour\r\n"
        if name in ("R1", "R2"):
            return f"{device.state(f'heater_{name[1]}'):.2f}\r\n".encode()
        if name in ("Q1", "Q2"):
            if not device.write(f"heater_{name[1]}", float(argument)):
                return b"ERR locked\r\n"
            return f"{float(argument):.2f}\r\n".encode()
        if name == "X":
            for each in ("heater_1", "heater_2"):
                device.write(each, 0.0)
            return b"X\r\n"
        return super()._answer(line)


class _BoardClient:
    """A client only in name: its lines are those of the board."""

    def __init__(self, device: Device) -> None:
        self._board = _Board(device)

    def answer(self, line: str) -> str | None:
        return self._board.take(f"{line}\n".encode()).decode("ascii", "replace").strip() or None

    def close(self) -> None:
        """Nothing to close."""


def _lines(_rig: Rig, device: Device, _patch: pytest.MonkeyPatch) -> Callable[[], Client]:
    return lambda: _BoardClient(device)


_CLIENTS = {"lines": _lines, "modbus": _modbus, "visa": _visa, "opcua": _opcua}


def _rig_of(kind: str) -> tuple[Rig, Lines]:
    name = "tclab-board" if kind == "lines" else f"oil-circuit-{kind}"
    rig = load_rig(shipped("rigs", f"{name}.yaml"))
    if kind == "lines":
        rig = parse_rig(rig.text.replace("stale_after: 5 s", "stale_after: 2 s"))
    backend = rig.backend
    if backend.modbus is not None:
        return rig, backend.modbus.in_lines(rig.actuators)
    if backend.opcua is not None:
        return rig, backend.opcua.in_lines(rig.actuators)
    assert backend.lines is not None
    return rig, backend.lines.of_a_client if kind == "visa" else backend.lines


# --- a trial ---


@dataclass(frozen=True)
class Trial:
    """One run: how it ends, what is wrong with its device, and from when until when, s."""

    seed: str
    kind: str
    ending: str
    fault: str
    begin: float
    end: float
    moment: float


def draw(seed: str, kind: str, faults: tuple[str, ...] = FAULTS) -> Trial:
    rng = random.Random(f"{seed} {kind}")
    begin = rng.uniform(0.5, 9.0)
    lasts = rng.choice((rng.uniform(0.02, 1.0), rng.uniform(1.0, 6.0), _PATIENT, _PATIENT))
    # an ending near the fault is the interesting one
    moment = max(0.5, begin + rng.choice((rng.uniform(-1.0, 1.0), rng.uniform(-4.0, 4.0))))
    fault = rng.choice([one for one in faults if one != "stale" or kind == "opcua"])
    return Trial(seed, kind, rng.choice(ENDINGS), fault, begin, begin + lasts, moment)


@dataclass
class Tally:
    """What happened over all trials: `failures` are those that left an output on without saying so."""

    trials: dict[str, int] = field(default_factory=dict)
    unconfirmed: int = 0
    complete: int = 0  #: records, each compared with the real outputs
    left_on_and_said: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        total = sum(self.trials.values())
        said = f"{self.left_on_and_said} left on and reported, {self.unconfirmed} reported as unconfirmed"
        verdict = f"REFUTED {len(self.failures)} times" if self.failures else f"not refuted ({total})"
        compared = f"{self.complete} complete records compared with the outputs"
        return f"{verdict}: {self.trials}; {self.statuses}; {said}; {compared}"


@contextmanager
def _bench(trial: Trial, device: Device, rig: Rig, lines: Lines) -> Iterator[LineBench]:
    with pytest.MonkeyPatch.context() as patch:
        port = DirectPort(device, _CLIENTS[trial.kind](rig, device, patch), device.clock)

        def connect() -> DirectPort:
            port.check()
            return port

        bench = LineBench(rig, lines, device.clock, connect, kind=trial.kind)
        bench.open()
        yield bench
        bench.close()


def _steps(trial: Trial, rig: Rig) -> str:
    last = {
        "finish": f"wait: {max(trial.moment - 5.0, 0.1):.3f} s",
        "fail": f"wait: {{until: {next(iter(rig.channels))} > 90 degC, timeout: 2 s}}",
    }.get(trial.ending, "wait: 60 s")
    names: Mapping[str, str] = _OUTPUTS["lines" if trial.kind == "lines" else "oil"]
    text = STEPS.replace("LAST", last)
    for name, value in names.items():
        text = text.replace(name, value)
    return text


def one(folder: Path, trial: Trial, tally: Tally) -> RunResult:
    """One run; raises AssertionError if it broke the promise."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    clock, (rig, lines) = ScriptedClock(), _rig_of(trial.kind)
    names = [name for name in rig.safe_state if rig.actuators[name].by == "driven"]
    device = Device(clock, dict.fromkeys(names, 0.0))
    rng = random.Random(trial.seed)
    device.power_on, device.every = rng.choice((0.0, 1.0)), rng.choice((2, 3))
    if trial.fault != "none":
        clock.at(trial.begin, lambda: device.begin(trial.fault))
        if trial.end < _PATIENT and trial.fault not in RESTARTS[:2]:
            clock.at(trial.end, device.end)
    if trial.ending.startswith("SIG"):
        clock.at(trial.moment, lambda: signal.raise_signal(getattr(signal, trial.ending)))
    if trial.ending == "interlock":
        clock.at(trial.moment, lambda: setattr(device, "hot", True))
    with _bench(trial, device, rig, lines) as bench:
        result = Workshop(folder).run(_steps(trial, rig), rig=rig, backend=bench).result
        on = {name: value for name, value in device.outputs.items() if value}
        # nobody can notice a restart while the last answer, which says that all is off, is on its way
        too_late = device.restarted is not None and device.restarted > clock.now() - _ANSWER_TAKES
    tally.trials[trial.kind] = tally.trials.get(trial.kind, 0) + 1
    tally.statuses[result.status] = tally.statuses.get(result.status, 0) + 1
    tally.unconfirmed += result.unconfirmed is not None
    tally.left_on_and_said += bool(on) and result.unconfirmed is not None
    assert not on or result.unconfirmed or too_late, f"{on} at the end, and nothing is said: {result}"
    if result.unconfirmed:
        assert (result.exit_code, result.status != "finished") == (1, True), (
            "said, but not with the exit code"
        )
    if trial.ending in ("interlock", "fail"):
        assert result.status != "finished", "nothing ended it"
    if trial.ending == "interlock" and trial.fault in ("none", "intermittent"):
        late = device.last_on() - trial.moment
        assert late <= _OFF_WITHIN[trial.kind], f"on for {late:.2f} s beyond the limit"
    if result.folder is not None:
        _compare(trial.kind, open_run(result.folder), device, tally)
    if device.restarted is not None and result.folder is not None:
        records = open_run(result.folder).records
        inside = (records["start"] < device.restarted) & (device.restarted < records["end"])
        complete = "complete" in records["outcome"][inside].tolist()
        assert not complete or device.restart_is_hidden, "complete, with a restart in it"
    if trial.fault == "exchanged":
        assert not device.sent_to_stranger, f"sent to another device: {device.sent_to_stranger}"
    return result


def _compare(kind: str, run: Run, device: Device, tally: Tally) -> None:
    """Raise AssertionError unless the real outputs were as stored at each sample of every complete record."""
    for number in run.records.index[run.records["outcome"] == "complete"]:
        tally.complete += 1
        samples = run.samples(record=int(number))
        for name in device.outputs:
            scale = _PER_BAR.get(kind, 1.0) if name == "relief_valve" else 1.0
            for time, stored in zip(samples["time"], samples[name], strict=True):
                were = device.between(name, time - _READ_WITHIN, time + _ANSWER_TAKES)
                assert any(abs(scale * stored - value) <= 0.01 * max(1.0, value) for value in were), (
                    f"record {number} is complete: {name} {stored:g} at {time:.2f} s, in truth {were}"
                )


def torture(
    folder: Path,
    seed: int | str,
    kinds: tuple[str, ...],
    trials: Iterator[int],
    faults: tuple[str, ...] = FAULTS,
) -> Tally:
    """Trials in turn behind each protocol, as many numbers as `trials` yields."""
    tally = Tally()
    for number in trials:
        for kind in kinds:
            trial = draw(f"{seed}-{number}", kind, faults)
            try:
                one(folder / "trial", trial, tally)
            except Exception as problem:  # noqa: BLE001 - whatever it is, it is counted
                tally.failures.append(f"{trial}: {type(problem).__name__}: {problem}")
    return tally


def main() -> None:
    """``make lying``: as many endings as asked, or as fit into some seconds of CPU; prints the count."""
    import argparse
    import sys
    import tempfile
    import time

    asked = argparse.ArgumentParser(prog="python -m torture.lying", description=__doc__)
    asked.add_argument("--trials", type=int, default=2000, help="endings of each kind of backend")
    asked.add_argument("--cpu", type=float, default=900.0, help="s of CPU time after which no more are begun")
    asked.add_argument("--seed", default="0")
    asked.add_argument("--restarts", action="store_true", help="restarts in place of the other faults")
    given = asked.parse_args()

    def numbers() -> Iterator[int]:
        for number in count():
            if number >= given.trials or time.process_time() > given.cpu:
                return
            yield number

    with tempfile.TemporaryDirectory() as folder:
        tally = torture(Path(folder), given.seed, KINDS, numbers(), RESTARTS if given.restarts else FAULTS)
    print(tally, *tally.failures, sep="\n")  # noqa: T201
    sys.exit(bool(tally.failures))


if __name__ == "__main__":
    main()
