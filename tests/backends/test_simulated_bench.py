"""The simulated bench: its grid of samples, exact switches, safe state, and determinism."""

from __future__ import annotations

import struct
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Backend, Sample
from rigctl.backends.registry import create_backend
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.backends.simulated.roles_plant import STROKE_TIME
from rigctl.clock import ScaledClock, VirtualClock
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

MakeBench = Callable[..., SimulatedBench]
POSITION, VALVE = 2, 1  # positions of these columns in the shipped rig's samples
SPEED = (0.285 + 0.005) / STROKE_TIME  # of the plain plant's rod


def take(bench: Backend, count: int) -> list[Sample]:
    samples = [bench.next_sample(10.0) for _ in range(count)]
    assert all(samples)
    return [sample for sample in samples if sample]


class WallTime:
    """A computer's clock that only moves when somebody sleeps or works."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds

    def clock(self, speed: float = 1.0) -> ScaledClock:
        return ScaledClock(speed=speed, monotonic=lambda: self.seconds, sleep=self.sleep)


def test_samples_lie_on_the_time_grid_and_the_first_is_available_at_once(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(100.0)
    assert [sample.time for sample in take(bench, 301)] == [k / 100.0 for k in range(301)]
    bench.start(10.0)
    assert [sample.time for sample in take(bench, 3)] == [3.0, 3.1, 3.2]


def test_a_short_wait_neither_returns_nor_loses_a_sample(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(1.0)
    assert take(bench, 1)[0].time == 0.0
    assert bench.next_sample(0.4) is None
    assert bench.clock.now() == 0.4
    assert [sample.time for sample in take(bench, 2)] == [1.0, 2.0]


@pytest.mark.parametrize(("plant", "idle"), [("roles", True), ("models/heater-board.yaml", False)])
def test_an_actuator_that_drives_nothing_says_so_once_when_it_leaves_its_safe_value(
    plant: str, *, idle: bool
) -> None:
    rig = load_rig(shipped("rigs", "heater-board.yaml"))
    chosen = plant if plant == "roles" else str(shipped(*plant.split("/")))
    bench = create_backend(rig, "simulated", VirtualClock(), {"plant": chosen, "noise": False})
    bench.open()
    bench.start(1.0)
    for level in (0.0, 0.2, 0.4):
        bench.command("heater_1", level).wait()
        take(bench, 2)
    told = [one.message for one in bench.take_notices()]
    assert told == ["'heater_1' drives nothing in this simulation: no channel will answer to it"] * idle


def test_a_bench_that_was_not_started_gives_no_sample(make_bench: MakeBench) -> None:
    bench = make_bench()
    assert bench.next_sample(0.5) is None
    assert bench.clock.now() == 0.5


@settings(max_examples=40)
@given(duration=st.floats(0.001, 2.0), rate=st.floats(5.0, 400.0))
def test_a_pulse_moves_the_rod_by_its_duration_whatever_the_rate(
    rig: Rig, duration: float, rate: float
) -> None:
    bench = create_backend(
        rig, "simulated", VirtualClock(), {"plant": "roles", "noise": False, "quantised": False}
    )
    bench.open()
    bench.start(rate)
    take(bench, 3)
    start = bench.command("valve", 1.0, duration=duration).wait()
    samples = take(bench, int(rate * duration) + 3)
    (end,) = bench.take_receipts()
    assert (start.actuator, start.value, start.uncertainty) == ("valve", 1.0, 0.0)
    assert (end.actuator, end.value, end.uncertainty) == ("valve", 0.0, 0.0)
    assert end.time == start.time + duration
    assert samples[-1].values[POSITION] == pytest.approx(SPEED * duration, rel=1e-9)
    for sample in samples:
        assert sample.commands[VALVE] == (1.0 if sample.time < end.time else 0.0)


def test_a_new_command_replaces_a_pulse_that_has_not_ended(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(10.0)
    take(bench, 1)
    bench.command("valve", 1.0, duration=1.0).wait()
    take(bench, 5)
    bench.command("valve", 1.0).wait()
    assert take(bench, 10)[-1].values[POSITION] == pytest.approx(SPEED * 1.5)
    assert bench.take_receipts() == []


def test_a_command_between_two_samples_keeps_its_time(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(10.0)
    take(bench, 1)
    bench.clock.sleep_until(0.55)  # the samples up to then have not been taken yet
    assert bench.command("valve", 1.0).wait().time == 0.55
    samples = take(bench, 10)
    assert [sample.commands[VALVE] for sample in samples] == [0.0] * 5 + [1.0] * 5
    assert samples[-1].values[POSITION] == pytest.approx(SPEED * 0.45)


def test_a_caller_that_falls_behind_still_gets_every_sample(
    make_bench: MakeBench,
) -> None:
    wall = WallTime()
    bench = make_bench(wall.clock())
    bench.start(100.0)
    take(bench, 1)
    wall.sleep(0.2055)
    assert bench.command("valve", 1.0).wait().time == pytest.approx(0.2055)
    samples = take(bench, 41)
    assert [sample.time for sample in samples] == pytest.approx([k / 100.0 for k in range(1, 42)])
    assert [sample.commands[VALVE] for sample in samples[:20]] == [0.0] * 20
    assert samples[-1].values[POSITION] == pytest.approx(SPEED * (0.41 - 0.2055))
    assert wall.seconds == pytest.approx(0.41)


def test_a_scaled_clock_runs_the_same_bench_faster(make_bench: MakeBench) -> None:
    wall = WallTime()
    bench = make_bench(wall.clock(speed=10.0))
    bench.start(10.0)
    assert take(bench, 101)[-1].time == pytest.approx(10.0)
    assert wall.seconds == pytest.approx(1.0)


def test_fault_times_count_from_the_opening_of_the_bench(make_bench: MakeBench) -> None:
    wall = WallTime()
    clock = wall.clock()
    wall.sleep(50.0)
    bench = make_bench(clock, faults="sensor_open:oil_temperature@1 s")
    bench.start(10.0)
    samples = take(bench, 12)
    assert samples[0].time == 50.0
    assert samples[9].values[0] < 300.0
    assert samples[11].values[0] > 1000.0
    assert [notice.time for notice in bench.take_notices()] == [51.0]


def test_safe_ends_a_pulse_at_once_and_can_be_called_again(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(10.0)
    bench.command("heater", 1.0).wait()
    bench.command("relief_valve", 40e5).wait()
    bench.command("valve", 1.0, duration=5.0).wait()
    take(bench, 11)
    bench.safe()
    bench.safe()
    reached = SPEED * 1.0
    for sample in take(bench, 60):
        assert sample.commands == (0.0, 0.0, 40e5)
        assert sample.values[POSITION] == pytest.approx(reached)
    assert bench.take_receipts() == []


def test_closing_is_idempotent_and_a_closed_bench_raises(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.start(10.0)
    bench.close()
    bench.close()
    with pytest.raises(BackendLost, match="not open") as problem:
        bench.next_sample(1.0)
    assert problem.value.exit_code == ExitCode.FAILED
    bench.open()
    bench.start(10.0)
    assert bench.next_sample(1.0)


@pytest.mark.parametrize(
    ("actuator", "value", "duration", "message"),
    [
        ("vlave", 1.0, None, "unknown actuator, got 'vlave'; did you mean 'valve'?"),
        ("valve", 2.0, None, "valve: no position of this actuator, got '2'"),
        ("heater", 0.5, None, "heater: no position of this actuator"),
        ("relief_valve", 70e5, None, "relief_valve: out of range, got '70 bar'; expected 10 bar to 55 bar"),
        ("relief_valve", float("nan"), None, "relief_valve: not a finite number"),
        ("valve", 1.0, 0.0, "valve: a pulse must last, got '0 s'"),
        ("valve", 1.0, float("inf"), "valve: a pulse must last"),
        ("relief_valve", 20e5, 1.0, "relief_valve: a pulse needs a value to return to"),
    ],
)
def test_an_invalid_command_is_refused_and_changes_no_output(
    make_bench: MakeBench, actuator: str, value: float, duration: float | None, message: str
) -> None:
    bench = make_bench()
    bench.start(10.0)
    before = take(bench, 1)[0].commands
    with pytest.raises(RigctlError) as problem:
        bench.command(actuator, value, duration=duration).wait()
    assert message in str(problem.value)
    assert take(bench, 5)[-1].commands == before


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_an_impossible_rate_is_refused(make_bench: MakeBench, rate: float) -> None:
    with pytest.raises(RigctlError, match="not a sampling rate"):
        make_bench().start(rate)


def test_the_operator_responds_after_a_delay(rig: Rig, make_bench: MakeBench) -> None:
    simulation = rig.simulation.model_copy(update={"answer_delay": 2.0})
    bench = make_bench(on=rig.model_copy(update={"simulation": simulation}))
    bench.start(10.0)
    assert bench.command("relief_valve", 40e5).wait().time == 2.0
    assert bench.command("valve", 1.0).wait().time == 0.0
    samples = take(bench, 41)
    assert samples[19].commands[2] == 20e5
    assert samples[20].commands[2] == 40e5
    assert samples[20].values[1] == pytest.approx(20e5)
    assert samples[40].values[1] == pytest.approx(40e5, rel=1e-4)


def test_settings_scatter_as_in_the_rig_file(rig: Rig, make_bench: MakeBench) -> None:
    simulation = rig.simulation.model_copy(update={"scatter": {"relief_valve": 0.002}})
    bench = make_bench(on=rig.model_copy(update={"simulation": simulation}))
    bench.start(0.1)
    reached = []
    for _ in range(400):
        bench.command("relief_valve", 40e5).wait()
        reached.append(take(bench, 2)[-1].values[1] / 40e5 - 1.0)
    assert all(a != b for a, b in pairwise(reached))
    spread = (sum(error**2 for error in reached) / len(reached)) ** 0.5
    assert spread == pytest.approx(0.002, rel=0.15)


def campaign(bench: Backend) -> bytes:
    """The samples and events of a short run, as bytes."""
    taken: list[Sample] = []
    for rate, pressure in ((10.0, 20e5), (100.0, 40e5)):
        bench.start(rate)
        bench.command("relief_valve", pressure).wait()
        bench.command("valve", 1.0, duration=0.333).wait()
        taken += take(bench, 250)
        bench.command("valve", -1.0, duration=0.2).wait()
        taken += take(bench, 50)
    return b"".join(
        struct.pack(f"{1 + len(s.values) + len(s.commands)}d", s.time, *s.values, *s.commands) for s in taken
    )


def test_equal_seeds_give_identical_samples_and_events(rig: Rig, make_bench: MakeBench) -> None:
    simulation = rig.simulation.model_copy(update={"scatter": {"relief_valve": 0.002}})
    scattered = rig.model_copy(update={"simulation": simulation})
    runs = [campaign(make_bench(on=scattered, noise="on", quantised="on", seed=seed)) for seed in (7, 7, 8)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_the_bench_reports_its_identity(make_bench: MakeBench) -> None:
    identity = make_bench(seed=11, faults=["samples_stop@30 s"]).identity
    assert identity["kind"] == "simulated"
    assert identity["name"] == "HL32 bench"
    assert identity["seed"] == "11"
    assert identity["noise"] == "off"
    assert identity["faults"] == "samples_stop@30 s"
