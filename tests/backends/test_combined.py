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
from rigctl.backends.errors import BackendLost, OutputsNotSafe
from rigctl.backends.protocol import Backend, CommandReceipt, Notice, PendingCommand, Sample
from rigctl.clock import Clock, real_clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig, parse_rig

RIG = """\
name: two
devices:
  fast: {kind: simulated}
  slow: {kind: simulated, stale_after: 5 s}
channels:
  a: {device: fast, unit: V, quantity: voltage}
  b: {device: slow, unit: V, quantity: voltage}
  c: {device: fast, unit: V, quantity: voltage}
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
    """Whatever the order of arrival: readings of the slow device are `late`, and none is older than 5 s."""
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
        sample = merging.sample(device, Sample(taken, values, (command,)), now)
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
        age = {name: now - when for name, when in newest.items()}
        for name, value in zip("abc", sample.values, strict=True):
            where = rig.device_of(name)
            known = where in age and age[where] <= (1.0 if where == "fast" else 5.0)
            assert math.isnan(value) is not known


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
        self.broken: RigctlError | None = None
        self._rate = 0.0

    def open(self) -> None:
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
