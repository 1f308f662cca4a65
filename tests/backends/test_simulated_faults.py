"""Injected faults: their grammar and their behaviour."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.protocol import Sample
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.backends.simulated.faults import KINDS, Fault, parse_fault
from rigctl.errors import RigctlError
from rigctl.rig import Rig

MakeBench = Callable[..., SimulatedBench]


def take(bench: SimulatedBench, count: int) -> list[Sample]:
    samples = [bench.next_sample(1.0) for _ in range(count)]
    return [sample for sample in samples if sample]


def column(samples: list[Sample], index: int) -> list[float]:
    return [sample.values[index] for sample in samples]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("sensor_stuck:position@12 s", Fault("sensor_stuck", "position", 12.0)),
        (" sensor_open : oil_temperature @ 5 min ", Fault("sensor_open", "oil_temperature", 300.0)),
        ("samples_stop@30 s..33.5 s", Fault("samples_stop", None, 30.0, 33.5)),
        ("heater_stuck_on@0 s", Fault("heater_stuck_on", None, 0.0)),
        ("setpoint_never_reached@0 s", Fault("setpoint_never_reached", None, 0.0)),
        (
            "setpoint_never_reached:supply_pressure@1 h",
            Fault("setpoint_never_reached", "supply_pressure", 3600.0),
        ),
    ],
)
def test_a_fault_is_parsed_and_printed(rig: Rig, text: str, fault: Fault) -> None:
    assert parse_fault(text, rig) == fault
    assert parse_fault(str(fault), rig) == fault


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensor_stuck:position", "not a fault"),
        ("sensor_stuk:position@12 s", "did you mean 'sensor_stuck'?"),
        ("sensor_stuck:postion@12 s", "unknown channel, got 'postion'; did you mean 'position'?"),
        ("sensor_stuck@12 s", "sensor_stuck needs a channel"),
        ("valve_stuck:position@12 s", "valve_stuck takes no channel"),
        ("setpoint_never_reached:position@1 s", "unknown controlled channel"),
        ("samples_stop@12 bar", "the fault's time: wrong dimension, got '12 bar'"),
        ("samples_stop@12", "the fault's time: the unit is missing, got '12'"),
        ("samples_stop@soon", "the fault's time: not a quantity, got 'soon'"),
        ("samples_stop@-1 s", "before the start"),
        ("samples_stop@5 s..4 s", "the fault ends before it begins"),
    ],
)
def test_an_invalid_fault_is_refused_with_a_clear_message(rig: Rig, text: str, message: str) -> None:
    with pytest.raises(RigctlError) as problem:
        parse_fault(text, rig)
    assert message in str(problem.value)


@given(
    text=st.one_of(
        st.text(), st.builds("{}:{}@{}".format, st.sampled_from(sorted(KINDS)), st.text(), st.text())
    )
)
def test_any_text_is_parsed_as_a_fault_or_refused(rig: Rig, text: str) -> None:
    try:
        assert parse_fault(text, rig).kind in KINDS
    except RigctlError as problem:
        assert str(problem)


def test_a_fault_of_a_part_that_the_rig_lacks_is_refused(rig: Rig) -> None:
    bare = rig.model_copy(update={"roles": type(rig.roles)(), "actuators": {}})
    for text in ("heater_stuck_on@1 s", "valve_stuck@1 s", "setpoint_never_reached@1 s"):
        with pytest.raises(RigctlError):
            parse_fault(text, bare)


def test_a_stuck_sensor_holds_its_value_and_recovers(make_bench: MakeBench) -> None:
    bench = make_bench(faults="sensor_stuck:position@0.5 s..1 s", noise="on")
    bench.start(100.0)
    bench.command("valve", 1.0).wait()
    positions = column(take(bench, 151), 2)
    assert len(set(positions[50:100])) == 1
    assert len(set(positions[:50])) == 50
    assert positions[100] > positions[99] + 0.04


def test_an_open_sensor_reads_the_broken_wire_value_of_the_rig_file(make_bench: MakeBench) -> None:
    names = ("oil_temperature", "supply_pressure", "position")
    bench = make_bench(faults=[f"sensor_open:{name}@0.1 s" for name in names], quantised="on")
    bench.start(10.0)
    sound, broken = take(bench, 2)
    assert sound.values == pytest.approx((293.15, 20e5, 0.0), rel=1e-2, abs=1e-3)
    assert broken.values == pytest.approx((273.15 + 1023.75, -12.5e5, -0.010))


def test_an_open_sensor_without_a_range_reads_nan(rig: Rig, make_bench: MakeBench) -> None:
    channel = rig.channels["position"].model_copy(update={"range": None})
    unbounded = rig.model_copy(update={"channels": {**rig.channels, "position": channel}})
    bench = make_bench(on=unbounded, faults="sensor_open:position@0 s")
    bench.start(10.0)
    assert math.isnan(take(bench, 1)[0].values[2])


def test_a_noisy_sensor_is_noisy_even_with_simulated_noise_disabled(make_bench: MakeBench) -> None:
    bench = make_bench(faults="sensor_noisy:supply_pressure@1 s")
    bench.start(100.0)
    pressures = column(take(bench, 1100), 1)
    assert set(pressures[:100]) == {20e5}
    mean = sum(pressures[100:]) / 1000
    spread = (sum((p - mean) ** 2 for p in pressures[100:]) / 1000) ** 0.5
    assert spread == pytest.approx(0.1 * 106e5, rel=0.1)


def test_a_sensor_out_of_range_reads_a_physically_impossible_value(rig: Rig, make_bench: MakeBench) -> None:
    bench = make_bench(faults="sensor_out_of_range:position@0.5 s")
    bench.start(10.0)
    positions = column(take(bench, 10), 2)
    possible = [rig.channels["position"].possible(position) for position in positions]
    assert possible == [True] * 5 + [False] * 5


def test_a_failed_sensor_leaves_the_other_channels_unchanged(make_bench: MakeBench) -> None:
    readings = []
    for faults in ((), ("sensor_noisy:position@0 s",), ("sensor_open:position@0 s",)):
        bench = make_bench(faults=faults, noise="on", quantised="on", seed=3)
        bench.start(100.0)
        samples = take(bench, 100)
        readings.append((column(samples, 0), column(samples, 1)))
    assert readings[0] == readings[1] == readings[2]


def test_a_heater_stuck_on_heats_whatever_is_commanded(make_bench: MakeBench) -> None:
    bench = make_bench(faults="heater_stuck_on@60 s")
    bench.start(1.0)
    temperatures = column(take(bench, 61), 0)
    assert temperatures[60] == pytest.approx(temperatures[0], abs=0.1)
    bench.safe()
    samples = take(bench, 600)
    assert samples[-1].values[0] > temperatures[60] + 9.0
    assert samples[-1].commands[0] == 0.0


def test_a_stuck_valve_stays_where_it_is_until_the_fault_ends(make_bench: MakeBench) -> None:
    bench = make_bench(faults="valve_stuck@0.2 s..1 s")
    bench.start(10.0)
    bench.command("valve", 1.0, duration=0.5).wait()
    positions = column(take(bench, 21), 2)
    assert positions[10] == pytest.approx(positions[1] * 10)
    assert positions[20] == pytest.approx(positions[10])


def test_an_unreachable_set_point_can_be_injected_on_all_channels_or_one(make_bench: MakeBench) -> None:
    bench = make_bench(faults="setpoint_never_reached@0 s")
    bench.start(1.0)
    bench.command("heater", 1.0).wait()
    bench.command("relief_valve", 40e5).wait()
    last = take(bench, 601)[-1]
    assert last.values[0] < 294.0
    assert last.values[1] == pytest.approx(20e5)
    assert last.commands == (1.0, 0.0, 40e5)
    bench = make_bench(faults="setpoint_never_reached:supply_pressure@0 s")
    bench.start(1.0)
    bench.command("heater", 1.0).wait()
    bench.command("relief_valve", 40e5).wait()
    last = take(bench, 601)[-1]
    assert last.values[0] > 302.0
    assert last.values[1] == pytest.approx(20e5)


def test_the_bench_obeys_commands_while_samples_have_stopped(make_bench: MakeBench) -> None:
    bench = make_bench(faults="samples_stop@1 s..3 s")
    bench.start(10.0)
    assert take(bench, 10)[-1].time == 0.9
    assert bench.next_sample(1.0) is None
    assert bench.clock.now() == pytest.approx(1.9)
    bench.command("valve", 1.0, duration=0.1).wait()
    assert bench.next_sample(1.0) is None
    back = bench.next_sample(1.0)
    assert back
    assert back.time == pytest.approx(3.0)
    assert back.values[2] == pytest.approx(0.29 / 2.5 * 0.1)
    kinds = [(notice.kind, notice.time) for notice in bench.take_notices()]
    assert kinds == [("fault", 1.0), ("fault", 3.0), ("gap", pytest.approx(3.0))]


def test_every_wait_for_a_sample_times_out_after_samples_stop_for_good(make_bench: MakeBench) -> None:
    bench = make_bench(faults="samples_stop@0 s")
    bench.start(100.0)
    assert [bench.next_sample(0.25) for _ in range(4)] == [None] * 4
    assert bench.clock.now() == 1.0
    bench.safe()


def test_every_call_on_a_lost_bench_fails_except_close(make_bench: MakeBench) -> None:
    bench = make_bench(faults="backend_lost@1 s")
    bench.start(10.0)
    take(bench, 10)
    for call in (
        lambda: bench.next_sample(1.0),
        lambda: bench.command("valve", 1.0).wait(),
        bench.safe,
        lambda: bench.next_sample(1.0),
    ):
        with pytest.raises(BackendLost, match="does not answer any more"):
            call()
    assert bench.clock.now() == 1.0
    bench.close()


def test_a_bench_that_returns_after_a_loss_was_made_safe_by_its_watchdog(make_bench: MakeBench) -> None:
    bench = make_bench(faults="backend_lost@1 s..5 s")
    bench.start(10.0)
    bench.command("valve", 1.0).wait()
    take(bench, 10)
    assert [bench.next_sample(1.0) for _ in range(4)] == [None] * 4
    back = bench.next_sample(1.0)
    assert back
    assert back.time == pytest.approx(5.0)
    assert back.commands[1] == 0.0
    assert back.values[2] == pytest.approx(min(0.29 / 2.5 * 3.0, 0.285))
    assert "gap" in [notice.kind for notice in bench.take_notices()]


def test_a_command_to_a_disconnected_bench_is_refused_and_not_repeated_later(make_bench: MakeBench) -> None:
    bench = make_bench(faults="backend_lost@1 s..2 s")
    bench.start(10.0)
    take(bench, 10)
    assert bench.next_sample(0.5) is None
    with pytest.raises(BackendLost):
        bench.safe()
    with pytest.raises(OutOfReach):
        bench.command("valve", 1.0).wait()
    assert bench.clock.now() == 1.4
    assert [sample.commands[1] for sample in take(bench, 10)] == [0.0] * 10
