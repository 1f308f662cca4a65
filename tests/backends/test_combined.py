"""One bench of several devices: which value is shown when, and what a hanging host or device leads to."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator, Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.backends.combined.bench import CombinedBench
from rigctl.backends.combined.merging import Merging
from rigctl.backends.errors import BackendLost, BenchTripped, OutOfReach, OutputsNotSafe
from rigctl.backends.protocol import Backend, CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, real_clock
from rigctl.errors import RigctlError
from rigctl.plan.loop import LoopState
from rigctl.rig import Rig, parse_rig

RIG = """\
name: two
devices:
  fast: {kind: simulated}
  slow: {kind: simulated, stale_after: 5 s}
channels:
  a: {device: fast, unit: V, quantity: voltage}
  b: {device: slow, unit: V, quantity: voltage}
  c: {device: fast, unit: V, quantity: voltage, stale_after: 2 s}
actuators:
  x: {device: fast, kind: switch}
  y: {device: slow, kind: switch}
  hand: {by: operator, kind: switch}
safe_state: {x: off, y: on}
"""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return parse_rig(RIG)


reading = st.tuples(st.sampled_from(["fast", "slow"]), st.floats(0.0, 1.0), st.sampled_from([0.0, 1.0]))


@given(steps=st.lists(reading, max_size=30), late=st.floats(0.0, 3.0))
def test_every_reading_keeps_its_time_and_every_channel_its_newest_value(
    steps: list[tuple[str, float, float]], late: float
) -> None:
    """Whatever the order of arrival: readings of `slow` are `late`, and each channel has its own limit."""
    rig = parse_rig(RIG)
    merging = Merging(rig)
    merging.start(10.0)
    now, newest, times = 0.0, dict[str, float](), [-math.inf]
    commands: list[tuple[float, int, float]] = [(-math.inf, 0, 0.0), (-math.inf, 1, 1.0)]
    for number, (device, wait, command) in enumerate(steps):
        now += wait
        taken = now - (late if device == "slow" else 0.0)
        if device in newest and taken <= newest[device]:
            continue
        newest[device] = taken
        values = (float(number), -float(number)) if device == "fast" else (float(number),)
        own = rig.parts[device].layout.channels
        sample = merging.sample(device, Sample(taken, values, (command,)))
        column = 0 if device == "fast" else 1
        commands.append((taken, column, command))
        read = sample.read
        assert (sample.device, read.time) == (device, taken)
        assert {name for name, value in zip("abc", read.values, strict=True) if value == value} == set(own)
        assert [read.values["abc".index(name)] for name in own] == list(values)
        in_force = [[v for t, k, v in commands if k == k0 and t <= taken][-1] for k0 in (0, 1)]
        assert list(read.commands[:2]) == in_force
        assert sample.time == max(times[-1], taken)
        times.append(sample.time)
        age = {name: sample.time - when for name, when in newest.items()}
        for name, value in zip("abc", sample.values, strict=True):
            where = rig.device_of(name)
            known = where == device or (where in age and age[where] <= {"a": 1.0, "b": 5.0, "c": 2.0}[name])
            assert math.isnan(value) is not known


def test_a_command_is_in_force_from_its_receipt_on_not_from_its_devices_next_reading(rig: Rig) -> None:
    merging = Merging(rig)
    merging.start(10.0)
    merging.sample("slow", Sample(1.0, (0.0,), (1.0,)))
    merging.switched(CommandReceipt(2.0, "y", 0.0))
    in_force = {
        time: merging.sample("fast", Sample(time, (0.0, 0.0), (0.0,))).read.commands[1] for time in (1.9, 2.1)
    }
    assert in_force == {1.9: 1.0, 2.1: 0.0}
    late = merging.sample("slow", Sample(1.95, (0.0,), (1.0,)))  # taken before the switch, and under way
    assert (late.read.commands[1], late.commands[1]) == (1.0, 0.0)
    assert merging.sample("fast", Sample(2.2, (0.0, 0.0), (0.0,))).read.commands[1] == 0.0


class Device:
    """A bench without a plant, whose calls can be held up."""

    timed = True
    without_host = "nothing"
    outputs_read: frozenset[str] = frozenset()

    def __init__(self, rig: Rig, clock: Clock) -> None:
        self.clock = clock
        self.rig = rig
        self.identity: Mapping[str, str] = {"kind": "made"}
        self.outputs_answered = frozenset(rig.actuators)
        self.hold = threading.Event()  # while it is set, samples and endings wait
        self.outputs: dict[str, float] = {}
        self.calls = 0
        self.closed = False
        self.broken: Exception | None = None
        self.refused: Exception | None = None
        self.given: list[float] = []
        self._rate = 0.0

    def open(self) -> None:
        while self.hold.is_set():
            time.sleep(0.001)
        if self.broken is not None:
            raise self.broken
        self.safe()

    def close(self) -> None:
        self.closed = True

    def start(self, rate: float) -> None:
        self._rate = rate

    def next_sample(self, timeout: float) -> Sample | None:
        self.calls += 1
        if self.broken is not None:
            raise self.broken
        time.sleep(timeout)
        if not self._rate:
            return None
        values = (1.0,) * len(self.rig.channels)
        return Sample(self.clock.now(), values, tuple(self.outputs.values()))

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        if self.refused is not None:
            raise self.refused
        self.given.append(value)
        self.outputs[actuator] = value
        return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))

    def take_receipts(self) -> list[CommandReceipt]:
        return []

    def take_notices(self) -> list[Notice]:
        return []

    def safe(self) -> None:
        while self.hold.is_set():
            time.sleep(0.001)
        self.outputs = {name: float(value) for name, value in self.rig.safe_state.items()}

    def cannot_regulate(self, loop: object) -> str:
        return ""

    def regulate(self, loop: object) -> PendingCommand:
        return self.command(next(iter(self.outputs)), 1.0)

    def loop_state(self, ahead: float | None = None) -> LoopState:
        while self.hold.is_set():
            time.sleep(0.001)
        return LoopState(True, None)

    def stop_regulating(self, actuator: str) -> PendingCommand:
        return self.command(actuator, 0.0)


class Two:
    def __init__(self, rig: Rig) -> None:
        clock = real_clock()
        self.devices = {name: Device(part, clock) for name, part in rig.parts.items()}
        benches: dict[str, Backend] = dict(self.devices)
        self.bench = CombinedBench(rig, clock, benches, {})


@pytest.fixture
def two(rig: Rig) -> Iterator[Two]:
    made = Two(rig)
    made.bench.open()
    made.bench.start(50.0)
    yield made
    for device in made.devices.values():
        device.hold.clear()
    made.bench.close()
    assert all(device.closed for device in made.devices.values())


def test_an_output_is_commanded_on_its_device_and_by_hand(two: Two) -> None:
    assert two.bench.command("x", 1.0).wait().value == 1.0
    assert two.devices["fast"].outputs == {"x": 1.0}
    assert two.devices["slow"].outputs == {"y": 1.0}
    assert two.bench.command("hand", 1.0).wait().value == 1.0
    while (
        (sample := two.bench.next_sample(1.0)) is None or sample.device != "fast" or sample.commands[0] == 0.0
    ):
        pass
    assert sample.commands == (1.0, 1.0, 1.0)
    with pytest.raises(RigctlError, match="unknown actuator"):
        two.bench.command("z", 1.0)


def test_a_device_that_hangs_in_its_ending_is_named_and_the_other_is_safe(
    two: Two, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.backends.combined.bench._SAFE_WITHIN", 0.5)
    two.bench.command("x", 1.0).wait()
    two.devices["slow"].hold.set()
    with pytest.raises(OutputsNotSafe, match="slow: no answer") as caught:
        two.bench.safe()
    assert caught.value.confirmed == {"x"}
    assert caught.value.unseen_since is not None
    assert two.devices["fast"].outputs == {"x": 0.0}
    two.devices["slow"].hold.clear()
    monkeypatch.setattr("rigctl.backends.combined.bench._SAFE_WITHIN", 60.0)
    two.bench.safe()


def test_devices_of_a_host_that_hangs_are_left_to_their_guards(
    two: Two, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread must not keep a device alive whose host does nothing any more."""
    monkeypatch.setattr("rigctl.backends.combined.device_thread._HOST_SILENT", 0.05)
    time.sleep(0.5)
    calls = [device.calls for device in two.devices.values()]
    time.sleep(0.5)
    assert calls == [device.calls for device in two.devices.values()]
    two.bench.next_sample(0.0)
    while calls == [device.calls for device in two.devices.values()]:
        two.bench.next_sample(0.01)


def test_a_device_lost_for_good_ends_sampling_and_is_named(two: Two) -> None:
    two.devices["slow"].broken = BackendLost("it has burnt")
    with pytest.raises(BackendLost, match="slow: it has burnt"):
        while True:
            two.bench.next_sample(0.1)


@pytest.mark.parametrize("error", [BackendLost("no answer"), RigctlError("another device")])
def test_where_one_device_cannot_be_opened_the_others_are_closed_again(rig: Rig, error: RigctlError) -> None:
    made = Two(rig)
    made.devices["slow"].broken = error
    with pytest.raises(type(error), match=f"slow: {error.what}"):
        made.bench.open()
    assert made.devices["fast"].closed
    assert made.devices["fast"].outputs == {"x": 0.0}
    with pytest.raises(BackendLost):
        made.bench.next_sample(0.0)


@pytest.mark.parametrize(
    ("fast", "slow", "kind"),
    [
        (BenchTripped("too hot"), BackendLost("no answer"), BackendLost),
        (BackendLost("no answer"), BenchTripped("too hot"), BackendLost),
        (BenchTripped("too hot"), OutputsNotSafe("no answer", {"y": 0.0}), OutputsNotSafe),
        (RigctlError("another device"), OutputsNotSafe("no answer", {"y": 0.0}), OutputsNotSafe),
        (RuntimeError("a mistake"), OutputsNotSafe("no answer", {"y": 0.0}), OutputsNotSafe),
        (BenchTripped("too hot"), RigctlError("another device"), RigctlError),
        (BenchTripped("too hot"), BenchTripped("too cold"), BenchTripped),
    ],
)
def test_a_trip_or_a_mistake_on_one_device_hides_no_loss_of_another(
    fast: Exception, slow: Exception, kind: type[Exception], rig: Rig
) -> None:
    """A trip says that outputs are safe, which is known of its own device only."""
    texts = [str(getattr(error, "what", error)) for error in (fast, slow)]
    made = Two(rig)
    made.devices["fast"].broken, made.devices["slow"].broken = fast, slow
    with pytest.raises(RigctlError) as caught:
        made.bench.open()
    assert type(caught.value) is kind
    for name, text in zip(("fast", "slow"), texts, strict=True):
        assert f"{name}: " in str(caught.value)
        assert text in str(caught.value)


def test_only_what_is_read_or_answered_is_called_confirmed(rig: Rig) -> None:
    made = Two(rig)
    made.devices["fast"].outputs_answered = frozenset()
    made.devices["slow"].broken = BackendLost("no answer")
    with pytest.raises(BackendLost) as caught:
        made.bench.open()
    assert "confirmed safe" not in str(caught.value)


def test_a_device_that_hangs_when_it_is_opened_is_named(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.backends.combined.bench._OPEN_WITHIN", 0.1)
    monkeypatch.setattr("rigctl.backends.combined.bench._SAFE_WITHIN", 0.1)
    made = Two(rig)
    made.devices["slow"].hold.set()
    with pytest.raises(BackendLost, match="slow: not open within"):
        made.bench.open()
    assert made.devices["fast"].closed
    made.devices["slow"].hold.clear()


def test_all_devices_are_opened_at_once(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits until the other is being opened too."""
    made = Two(rig)
    both = threading.Barrier(2, timeout=60.0)
    for device in made.devices.values():
        monkeypatch.setattr(device, "open", both.wait)
    made.bench.open()
    assert not both.broken
    made.bench.close()


def test_a_command_that_waits_for_a_stuck_device_is_dropped_once_outputs_are_to_be_safe(
    two: Two, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.backends.combined.bench._SAFE_WITHIN", 0.1)
    slow = two.devices["slow"]
    slow.hold.set()
    with pytest.raises(OutputsNotSafe):
        two.bench.safe()  # the thread is in the device's own ending now
    off = two.bench.command("y", 0.0)
    with pytest.raises(OutputsNotSafe):
        two.bench.safe()
    slow.hold.clear()
    with pytest.raises(OutOfReach, match="slow: not sent"):
        off.wait()
    monkeypatch.setattr("rigctl.backends.combined.bench._SAFE_WITHIN", 60.0)
    two.bench.safe()
    assert slow.given == []
    assert two.bench.command("y", 0.0).wait().value == 0.0


def test_a_command_ends_whatever_its_device_raises(two: Two) -> None:
    two.devices["slow"].refused = ValueError("a mistake in a backend")
    with pytest.raises(RigctlError, match="slow: ValueError"):
        two.bench.command("y", 0.0).wait()


def test_a_device_that_is_slow_to_say_how_its_loop_is_is_named(
    two: Two, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.backends.combined.bench._AT_ONCE", 0.1)
    two.bench._regulating = "slow"
    assert two.bench.loop_state().running
    two.devices["slow"].hold.set()
    with pytest.raises(BackendLost, match="slow: no answer within"):
        two.bench.loop_state()


def test_a_device_that_could_not_start_though_late_is_lost(two: Two, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigctl.backends.combined.bench._AT_ONCE", 0.05)
    held = threading.Event()

    def start(rate: float) -> None:
        held.wait()
        raise BackendLost("it has burnt")

    monkeypatch.setattr(two.devices["slow"], "start", start)
    two.bench.start(20.0)
    held.set()
    with pytest.raises(BackendLost, match="slow: it has burnt"):
        while True:
            two.bench.next_sample(0.1)


def test_rows_of_other_devices_show_safe_outputs_at_once(two: Two) -> None:
    two.bench.command("x", 1.0).wait()
    two.bench.safe()
    ended = two.bench.clock.now()
    while (sample := two.bench.next_sample(1.0)) is None or sample.read.time <= ended:
        pass
    assert sample.read.commands[:2] == (0.0, 1.0)


def test_simulated_devices_are_closed_without_an_error_in_a_thread(rig: Rig) -> None:
    """Their benches take no calls once they are closed; an error in a thread is a warning, hence an error."""
    bench = create_backend(rig, None, real_clock(), {})
    bench.open()
    bench.start(20.0)
    while bench.next_sample(1.0) is None:
        pass
    bench.close()
    bench.close()
