"""A device whose answers come after they were given up: none of them confirms another command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, cycle, repeat
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rigctl.backends.errors import BackendLost, OutputsNotSafe
from rigctl.backends.lines.bench import LineBench
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.guard import GuardSettings
from rigctl.backends.transport.guard_port import GuardActed
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.backends.transport.safe_state_retries import SafeStateRetries
from rigctl.clock import VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from tclab_board import MemoryPort, Sketch

TCLAB = load_rig(shipped("rigs", "tclab-board.yaml"))
#: the same without an identity, by which to come into step
NAMELESS = parse_rig(
    TCLAB.text.replace('    identify: {send: VER, reply: "TCLab Firmware {firmware}"}\n', "")
)
ORDERS = GuardSettings(
    Address("serial", "/dev/ttyACM0", {"baud": 9600, "frame": "8N1"}),
    (SafeOrder(b"X\n", ("{_}",)), SafeOrder(b"Q1 0.00\n", ("{value}",), {"value": ("0.00",)})),
    2.0,
    read_back=(SafeOrder(b"R1\n", ("{heater}",), {"heater": ("0.00",)}),),
)
#: s, of the answers to the lines that follow; they come in their order
DELAYS = st.lists(st.sampled_from([0.01, 0.15, 0.25, 0.4, 0.6]), min_size=1, max_size=12)


class Stuck(Sketch):
    """A board that acknowledges every command; a heater that is on stays on."""

    stuck = False

    def _answer(self, line: str) -> bytes:
        on = self.heaters
        answer = super()._answer(line)
        if self.stuck:
            self.model._Q1, self.model._Q2 = on
        return answer


class LatePort(MemoryPort):
    """A line on which each answer takes its own time, but none overtakes another."""

    def __init__(self, sketch: Sketch, clock: VirtualClock) -> None:
        super().__init__(sketch, clock)
        self.delays = repeat(0.01)

    def write(self, data: bytes) -> None:
        self.delay = next(self.delays)
        if self._coming:
            self.delay = max(self.delay, self._coming[-1][0] - self.clock.now())
        super().write(data)


def bench_on(port: MemoryPort, rig: Rig = TCLAB) -> LineBench:
    assert rig.backend.lines is not None
    bench = LineBench(rig, rig.backend.lines, port.clock, lambda: port, kind="serial")
    bench.open()
    return bench


def opened(rig: Rig) -> tuple[LineBench, LatePort, Stuck]:
    clock = VirtualClock()
    sketch = Stuck(clock.now)
    port = LatePort(sketch, clock)
    bench = bench_on(port, rig)
    bench.start(2.0)
    for _ in range(3):
        bench.next_sample(5.0)
    return bench, port, sketch


@settings(max_examples=100)
@example(delays=[0.15, 0.6, 0.01, 0.01, 0.6, 0.01, 0.01, 0.15, 0.15], always=False, wait=0.7)
@given(delays=DELAYS, always=st.booleans(), wait=st.sampled_from([0.0, 0.3, 0.7, 1.3]))
def test_an_output_that_stays_on_is_never_confirmed_by_a_late_answer(
    delays: Sequence[float], always: bool, wait: float
) -> None:
    bench, port, sketch = opened(TCLAB)
    bench.command("heater_1", 0.6).wait()
    sketch.stuck = True
    port.delays = cycle(delays) if always else chain(delays, repeat(0.01))
    bench.next_sample(wait)
    for _ in range(3):
        with pytest.raises((OutputsNotSafe, BackendLost)):
            bench.safe()
    assert sketch.heaters[0] == 60.0


@pytest.mark.parametrize("late", [0.25, 0.4, 0.6])
def test_without_an_identity_a_late_answer_is_waited_for(late: float) -> None:
    """The state was asked for before it was switched on, and its answer comes when it is to be off."""
    bench, port, sketch = opened(NAMELESS)
    port.delays = chain([late], repeat(0.01))
    bench.next_sample(0.55)
    bench.command("heater_1", 0.6)
    sketch.stuck = True
    sketch.take(b"Q1 60\n")
    sketch.model._Q1 = 60
    with pytest.raises((OutputsNotSafe, BackendLost)):
        bench.safe()


@settings(max_examples=50)
@given(delays=DELAYS, always=st.booleans())
def test_a_guard_is_not_told_by_late_answers_either(
    tmp_path_factory: pytest.TempPathFactory, delays: Sequence[float], always: bool
) -> None:
    clock = VirtualClock()
    sketch = Stuck(clock.now)
    port = LatePort(sketch, clock)
    # The answers to queries from before it was on are still under way.
    port.delays = cycle(delays) if always else chain(delays, repeat(0.01))
    for text in (b"R1\n", b"R1\n", b"X\n"):
        port.write(text)
    sketch.take(b"Q1 60\n")
    sketch.stuck = True
    attempts = iter(range(4))
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("guards")
        patch.setattr("rigctl.backends.transport.safe_state_retries._folder", lambda: folder)
        patch.setattr("time.sleep", lambda _: None)
        patch.setattr(SafeStateRetries, "_pause", lambda *_: next(attempts, None) is not None)
        assert not SafeStateRetries(ORDERS, clock, lambda: port, lambda: False).carry_out(port)


@pytest.mark.parametrize("delay", [0.02, 0.12, 0.3])
def test_a_guard_does_not_take_late_answers_to_its_own_commands_for_states(
    delay: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has sent them unasked when rigctl ended; the echo of 'off' looks like the state of a heater."""
    clock = VirtualClock()
    sketch = Stuck(clock.now)
    sketch.take(b"Q1 60\n")
    sketch.stuck = True
    port = MemoryPort(sketch, clock)
    port.delay = delay
    orders = replace(ORDERS, safe=ORDERS.safe[1:])
    for order in orders.safe:
        port.write(order.text)
        clock.sleep_until(clock.now() + 0.05)
    attempts = iter(range(4))
    monkeypatch.setattr("rigctl.backends.transport.safe_state_retries._folder", lambda: tmp_path)
    monkeypatch.setattr(SafeStateRetries, "_pause", lambda *_: next(attempts, None) is not None)
    retries = SafeStateRetries(orders, clock, lambda: port, lambda: False)
    assert not retries.carry_out(port, known=True)
    assert sketch.heaters[0] == 60.0


class Guarded(MemoryPort):
    """A port whose guard makes outputs safe when it is told to, as if rigctl had stood still."""

    acted = False

    def act(self) -> None:
        for text in (b"X\n", b"Q1 0.00\n", b"Q2 0.00\n"):
            super().write(text)
            self.clock.sleep_until(self.clock.now() + 0.05)
        self.acted = True

    def read(self, until: float) -> bytes:
        if self.acted:
            self.acted = False
            raise GuardActed(2.3)
        return super().read(until)


@pytest.mark.parametrize("phase", [0.05, 0.2, 0.35, 0.45, 0.49])
@pytest.mark.parametrize("rig", [TCLAB, NAMELESS], ids=["named", "nameless"])
def test_answers_to_the_commands_of_a_guard_are_no_readings(rig: Rig, phase: float) -> None:
    """With all outputs off the run goes on; the guard's commands are still being answered.

    It acts `phase` s after a sample, of which there is one every 0.5 s.
    """
    clock = VirtualClock()
    port = Guarded(Sketch(clock.now), clock)
    bench = bench_on(port, rig)
    port.delay = 0.12
    bench.start(2.0)
    began = clock.now()
    bench.next_sample(5.0)
    clock.sleep_until(began + 3.0 + phase - 0.15)
    port.act()
    samples = [bench.next_sample(5.0) for _ in range(6)]
    for sample in samples:
        assert sample is not None
        assert sample.values == pytest.approx([294.15, 294.15], abs=1.0)
        assert sample.commands == (0.0, 0.0)
    assert not [notice for notice in bench.take_notices() if notice.kind == "alarm"]


class Chatterbox(MemoryPort):
    """A device that never stops sending."""

    text = b"eh?\r\n"
    talks = False

    def read(self, until: float) -> bytes:
        if not self.talks:
            return super().read(until)
        self.clock.sleep_until(self.clock.now() + 1e-4)
        return self.text


@pytest.mark.parametrize("text", [b"eh?\r\n", b"eh", b"\n", b"TCLab Firmware 1.4.0 Arduino Uno\r\n"])
@pytest.mark.parametrize("rig", [TCLAB, NAMELESS], ids=["named", "nameless"])
def test_a_device_that_never_stops_sending_does_not_hold_up_the_ending(rig: Rig, text: bytes) -> None:
    clock = VirtualClock()
    sketch = Sketch(clock.now)
    port = Chatterbox(sketch, clock)
    bench = bench_on(port, rig)
    bench.command("heater_1", 0.6).wait()
    port.talks, port.text = True, text
    began = clock.now()
    with pytest.raises((OutputsNotSafe, BackendLost)):
        bench.safe()
    bench.close()
    assert sketch.heaters == (0.0, 0.0)
    assert clock.now() - began < 20.0


def test_a_device_that_never_stops_sending_does_not_hold_up_its_guard(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    clock = VirtualClock()
    port = Chatterbox(Sketch(clock.now), clock)
    port.talks = True
    port.sketch.take(b"Q1 60\n")
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("guards")
        patch.setattr("rigctl.backends.transport.safe_state_retries._folder", lambda: folder)
        patch.setattr(SafeStateRetries, "_pause", lambda *_: False)
        assert not SafeStateRetries(ORDERS, clock, lambda: port, lambda: False).carry_out(port)
    assert port.sketch.heaters == (0.0, 0.0)


class Mute(MemoryPort):
    """A device that receives nothing for a while."""

    mute = False

    def write(self, data: bytes) -> None:
        if not self.mute:
            super().write(data)


@pytest.mark.parametrize("outage", [3.0, 10.0, 20.0])
def test_a_device_that_is_back_after_an_outage_is_believed_soon(outage: float) -> None:
    """Nothing that was asked so long ago is still to come, however long nothing came."""
    clock = VirtualClock()
    port = Mute(Sketch(clock.now), clock)
    bench = bench_on(port)
    bench.start(2.0)
    assert bench.next_sample(5.0) is not None

    def reads_until(end: float) -> bool:
        while clock.now() < end:
            try:
                if bench.next_sample(1.0) is not None:
                    return True
            except BackendLost:
                clock.sleep_until(clock.now() + 0.5)
        return False

    port.mute = True
    reads_until(clock.now() + 1.0)  # what was still under way
    assert not reads_until(clock.now() + outage)
    port.mute = False
    began = clock.now()
    assert reads_until(began + outage + 60.0)
    assert clock.now() - began < 5.0


class Blocked(MemoryPort):
    """A port that takes long to send an identity query."""

    blocks = False

    def write(self, data: bytes) -> None:
        if self.blocks and data.startswith(b"VER"):
            self.clock.sleep_until(self.clock.now() + 4.5 * 0.5)
        super().write(data)


def test_an_identity_query_that_is_long_in_the_sending_is_waited_for() -> None:
    clock = VirtualClock()
    port = Blocked(Sketch(clock.now), clock)
    bench = bench_on(port)
    bench.start(2.0)
    bench.next_sample(5.0)
    port.blocks = True
    port.sketch.odd["T1"] = b"2x.3\r\n"  # the line is resynchronised by the identity
    port.sketch.received.clear()
    sample = bench.next_sample(10.0)
    assert sample is not None
    assert sample.values[0] == pytest.approx(294.15, abs=1.0)
    assert port.sketch.received[:3] == ["T1", "VER", "T1"]
