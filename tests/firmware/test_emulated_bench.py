"""The emulated board behind the backend's protocol, in step with a virtual clock."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest

from rigctl.backends.arduino.bench import ArduinoBench
from rigctl.backends.emulated import library
from rigctl.backends.emulated.avr import FREQUENCY
from rigctl.backends.emulated.board import EmulatedBoard, millivolt
from rigctl.backends.emulated.create import create
from rigctl.backends.errors import BackendLost, BenchTripped, OutputsNotSafe
from rigctl.backends.protocol import Notice, Sample
from rigctl.clock import VirtualClock
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

Make = Callable[..., ArduinoBench]


@pytest.fixture
def make_bench(uno_rig: Rig) -> Iterator[Make]:
    """Makes and opens an emulated bench with the plain plant."""
    made: list[ArduinoBench] = []

    def make(**options: object) -> ArduinoBench:
        made.append(create(uno_rig, VirtualClock(), {"plant": "roles", "seed": 1, **options}))
        made[-1].open()
        return made[-1]

    yield make
    for one in made:
        one.close()


def read_until(bench: ArduinoBench, time: float) -> list[Sample]:
    samples: list[Sample] = []
    while bench.clock.now() < time:
        sample = bench.next_sample(0.1)
        if sample is not None:
            samples.append(sample)
    return samples


def kinds(notices: list[Notice]) -> list[str]:
    return [notice.kind for notice in notices]


def test_the_identity_has_kind_firmware_and_configuration(make_bench: Make) -> None:
    identity = make_bench().identity
    assert identity["kind"] == "emulated"
    assert identity["firmware"] == "RIG-UNO 1.1.1"
    assert "pressure_trip=675" in identity["board"]


def test_the_same_seed_gives_the_same_samples(make_bench: Make) -> None:
    def record() -> list[Sample]:
        bench = make_bench()
        bench.start(100.0)
        bench.command("valve", 1.0, duration=0.3).wait()
        return read_until(bench, 1.0)

    assert record() == record()


def test_samples_are_regular_and_agree_with_the_state_of_the_bench(make_bench: Make) -> None:
    bench = make_bench(noise="off")
    bench.start(100.0)
    samples = read_until(bench, 3.0)
    assert all(b.time - a.time == pytest.approx(0.01, abs=1e-3) for a, b in pairwise(samples))
    temperature, pressure, position = samples[-1].values
    assert temperature == pytest.approx(293.15, abs=0.1)
    assert pressure == pytest.approx(20e5, abs=0.07e5)
    assert position == pytest.approx(0.0, abs=0.15e-3)
    assert bench.take_notices() == []


def test_a_pulse_is_timed_by_the_board_and_stamped_within_the_stated_uncertainty(make_bench: Make) -> None:
    bench = make_bench()
    assert bench.timed
    bench.start(100.0)
    receipt = bench.command("valve", 1.0, duration=1.05).wait()
    read_until(bench, receipt.time + 1.2)
    (end,) = bench.take_receipts()
    assert (end.actuator, end.value) == ("valve", 0.0)
    assert end.time - receipt.time == pytest.approx(1.05, abs=1e-4)
    assert 0.0 < receipt.uncertainty < 2e-3
    # the switch seen by the plant, exact to a cycle, is the time base here
    assert receipt.time == pytest.approx(_switch_times(bench)[0], abs=receipt.uncertainty)
    assert end.time == pytest.approx(_switch_times(bench)[1], abs=receipt.uncertainty)


def _switch_times(bench: ArduinoBench) -> list[float]:
    port = bench._contact.line.port  # type: ignore[union-attr]
    return list(port._board.valve_times)  # type: ignore[attr-defined]


def test_heater_relief_valve_and_valve_can_be_commanded(make_bench: Make) -> None:
    bench = make_bench(noise="off")
    bench.start(10.0)
    bench.command("heater", 1.0).wait()
    bench.command("relief_valve", 40e5).wait()
    (*_, last) = read_until(bench, 5.0)
    assert last.commands == (1.0, 0.0, 40e5)
    assert last.values[1] == pytest.approx(40e5, abs=0.1e5)
    bench.command("heater", 0.0).wait()
    assert bench.command("valve", -1.0).wait().time == pytest.approx(bench.clock.now(), abs=0.02)
    bench.safe()
    assert read_until(bench, 7.0)[-1].commands == (0.0, 0.0, 40e5)


def test_a_host_that_reads_keeps_the_outputs_on(make_bench: Make) -> None:
    bench = make_bench()
    bench.start(1.0)
    bench.command("heater", 1.0).wait()
    assert read_until(bench, 20.0)[-1].commands[0] == 1.0


def test_an_off_that_the_board_only_acknowledges_is_not_believed(make_bench: Make) -> None:
    bench = make_bench()
    bench.command("heater", 1.0).wait()
    assert bench._contact is not None
    line = bench._contact.line
    put = line.put
    line.put = lambda command: put("*OPC?" if command == "OUTP:SAFE" else command)  # type: ignore[method-assign]
    with pytest.raises(OutputsNotSafe, match="heater is on, though it was commanded to be off") as told:
        bench.safe()
    assert told.value.outputs == {"heater": 1.0}
    line.put = put  # type: ignore[method-assign]
    bench.safe()
    bench.start(10.0)
    assert set(read_until(bench, bench.clock.now() + 0.5)[-1].commands) == {0.0}


def test_a_trip_ends_sampling_with_its_cause_and_refuses_later_commands(make_bench: Make) -> None:
    bench = make_bench(faults=["sensor_open:supply_pressure@2 s"])
    bench.start(100.0)
    bench.command("heater", 1.0).wait()
    with pytest.raises(BackendLost, match="the board has tripped: sensor open or shorted"):
        read_until(bench, 3.0)
    assert bench.clock.now() == pytest.approx(2.0, abs=0.1)
    assert "alarm" in kinds(bench.take_notices())
    assert [(r.actuator, r.value) for r in bench.take_receipts()] == [("heater", 0.0)]
    with pytest.raises(RigctlError, match=r"the board refuses 'OUTP:HEAT ON'.*has tripped: sensor open"):
        bench.command("heater", 1.0).wait()


def test_outputs_left_on_by_another_program_are_off_at_the_first_sample(uno_rig: Rig) -> None:
    bench = create(uno_rig, VirtualClock(), {"plant": "roles", "seed": 1})
    identify = bench._identify

    def left_on(port: Any, *, again: bool) -> Any:
        board = port._board
        board.avr.send(b"OUTP:HEAT ON\nVALV EXT\n")
        board.run_to(board.time + 0.05)
        assert board.outputs[:2] == (True, True)
        return identify(port, again=again)

    bench._identify = left_on  # type: ignore[method-assign]
    bench.open()
    bench.start(10.0)
    sample = bench.next_sample(0.5)
    assert sample is not None
    assert sample.commands[:2] == (0.0, 0.0)
    bench.close()


def test_a_host_silent_trip_beside_another_trip_is_not_cleared(uno_rig: Rig) -> None:
    bench = create(uno_rig, VirtualClock(), {"plant": "roles", "seed": 1})
    identify = bench._identify

    def tripped_twice(port: Any, *, again: bool) -> Any:
        avr = port._board.avr
        avr.send(b"OUTP:HEAT ON\n")
        avr.run_to(avr.cycle + 2 * FREQUENCY)
        avr.put_voltage(0, millivolt(700))
        avr.run_to(avr.cycle + FREQUENCY // 50)
        return identify(port, again=again)

    bench._identify = tripped_twice  # type: ignore[method-assign]
    with pytest.raises(BenchTripped, match=r"over-pressure.*host silent"):
        bench.open()


def test_a_reconnected_line_has_outputs_off_and_a_gap(make_bench: Make) -> None:
    bench = make_bench(faults=["backend_lost@1 s..4 s"])
    bench.start(100.0)
    bench.command("heater", 1.0).wait()
    samples = read_until(bench, 6.0)
    notices = bench.take_notices()
    assert kinds([n for n in notices if n.kind != "note"])[:2] == ["fault", "gap"]
    (gap,) = [n for n in notices if n.kind == "gap"]
    lost = max(b.time - a.time for a, b in pairwise(samples))
    assert gap.fields["samples"] == pytest.approx(lost * 100, abs=40)
    assert any("host silent; cleared" in n.message for n in notices)
    assert samples[-1].commands[0] == 0.0


def test_a_line_that_does_not_return_within_30_s_is_lost(make_bench: Make) -> None:
    bench = make_bench(faults=["backend_lost@1 s"])
    bench.start(10.0)
    with pytest.raises(BackendLost, match="did not come back within 30 s"):
        read_until(bench, 60.0)
    with pytest.raises(BackendLost):
        bench.safe()


def test_a_board_restart_is_detected_and_sampling_resumes(make_bench: Make) -> None:
    bench = make_bench()
    bench.start(100.0)
    read_until(bench, 2.0)
    bench._contact.line.port._board.avr.reset()  # type: ignore[union-attr, attr-defined]
    read_until(bench, 4.0)
    notices = bench.take_notices()
    assert any("restarted" in n.message for n in notices)
    assert "gap" in kinds(notices)
    assert len(read_until(bench, 5.0)) == pytest.approx(100, abs=2)


class RunningBoard(EmulatedBoard):
    """A board whose clock shows a longer time than it has been emulated."""

    #: ms that are added to its count of milliseconds
    before = 0

    def __init__(self, *made_of: Any) -> None:
        super().__init__(*made_of)
        self.run_to(0.3)
        places = self._places()
        self.run_to(0.4)
        (self._place,) = places & self._places()
        self.milliseconds += self.before

    def _places(self) -> set[int]:
        """Addresses of its clock in memory: time since reset, less the time before it starts to count."""
        milliseconds = round(self.time * 1000)
        return {k for k in range(0x100, 0x8FD) if -25 <= self._word(k) - milliseconds <= 0}

    def _word(self, place: int) -> int:
        return int.from_bytes(bytes(self._memory[place : place + 4]), "little")

    @property
    def _memory(self) -> Any:
        return ctypes.cast(self.avr._state.data, ctypes.POINTER(ctypes.c_uint8))

    @property
    def milliseconds(self) -> int:
        return self._word(self._place)

    @milliseconds.setter
    def milliseconds(self, count: int) -> None:
        for k, byte in enumerate(count.to_bytes(4, "little")):
            self._memory[self._place + k] = byte


@pytest.mark.parametrize("instant", [10_000, 100_000, 4_294_967])
def test_no_sample_is_lost_or_torn_while_microseconds_change_their_number_of_digits(
    make_bench: Make, instant: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 100 Hz, at the eighth and ninth digit and the roll-over; the benchmark runs for ten minutes."""
    boards: list[RunningBoard] = []

    class Board(RunningBoard):
        before = instant - 4000

        def __init__(self, *made_of: Any) -> None:
            super().__init__(*made_of)
            boards.append(self)

    monkeypatch.setattr("rigctl.backends.emulated.create.EmulatedBoard", Board)
    bench = make_bench(noise="off")
    (board,) = boards
    bench.start(100.0)
    begun = bench.clock.now()
    assert board.milliseconds < instant - 1000
    samples = read_until(bench, begun + 7.0)
    assert board.milliseconds > instant + 1000
    assert len(samples) == pytest.approx(700, abs=3)
    assert max(b.time - a.time for a, b in pairwise(samples)) < 0.0115
    assert bench.take_notices() == []


@pytest.mark.parametrize(("baud", "rate"), [(115200, 292), (500000, 1204)])
def test_no_sample_is_lost_on_a_line_that_is_95_percent_full(
    make_bench: Make, baud: int, rate: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(baud=baud, noise="off")
    bench.start(float(rate))
    read_until(bench, 10.6)  # from now on the board's microseconds have eight digits
    port = bench._contact.line.port  # type: ignore[union-attr]
    arrived: list[bytes] = []

    def counted(until: float) -> bytes:
        arrived.append(read(until))
        return arrived[-1]

    read = port.read
    monkeypatch.setattr(port, "read", counted)
    begun = bench.clock.now()
    samples = read_until(bench, begun + 10.0)
    capacity = port._board.avr.baud / 11  # type: ignore[attr-defined]  # characters/s; the emulator sends a parity bit
    assert sum(map(len, arrived)) / 10.0 / capacity >= 0.95
    assert len(samples) == pytest.approx(10 * rate, abs=0.02 * rate)
    assert bench.take_notices() == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"port": "/dev/ttyACM0"}, "unknown option of the emulated backend"),
        ({"baud": 9600}, "no firmware image for this speed"),
        ({"inputs": {"position": "A7"}}, "unknown input of the board, got 'A7'"),
        ({"inputs": {"positon": "A1"}}, "did you mean 'position'?"),
        ({"inputs": {"position": "A0"}}, "a channel that is on no input of the board"),
        ({"outputs": {"valve": "heater"}}, "an actuator that is on no output of the board"),
    ],
)
def test_wrong_options_are_refused(make_bench: Make, options: dict[str, object], message: str) -> None:
    with pytest.raises(RigctlError) as refused:
        make_bench(**options)
    assert message in str(refused.value)


def test_a_rig_with_another_converter_is_refused() -> None:
    with pytest.raises(RigctlError, match=r"the board's converter has 10 bits.*hl32-bench-uno"):
        create(load_rig(shipped("rigs", "hl32-bench.yaml")), VirtualClock(), {})


@pytest.mark.parametrize(
    ("platform", "message"), [("win32", "runs on Linux only"), ("linux", "apt-get install libsimavr2")]
)
def test_a_missing_emulator_is_explained(
    monkeypatch: pytest.MonkeyPatch, platform: str, message: str
) -> None:
    def missing(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(library.sys, "platform", platform)
    monkeypatch.setattr(library.c, "CDLL", missing)
    with pytest.raises(RigctlError, match=message):
        library.load_libraries.__wrapped__()
