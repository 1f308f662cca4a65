"""The simulated bench on the cylinder's equations: published strokes, heat, hidden effects."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.backends.protocol import Sample
from rigctl.backends.registry import create_backend
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.clock import VirtualClock
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

MakeBench = Callable[..., SimulatedBench]
ROOT = Path(__file__).parents[2]
TEMPERATURE, PRESSURE, POSITION = 0, 1, 2


@pytest.fixture
def make_cylinder(rig: Rig, make_bench: MakeBench) -> MakeBench:
    """An open bench on the cylinder's equations, without noise, its oil at `celsius`."""

    def make(celsius: float = 20.0, *, on: Rig = rig, **options: object) -> SimulatedBench:
        initial = {**on.simulation.initial, "oil_temperature": celsius + 273.15}
        simulation = on.simulation.model_copy(update={"initial": initial})
        return make_bench(on=on.model_copy(update={"simulation": simulation}), **{"plant": None, **options})

    return make


def run(bench: SimulatedBench, seconds: float, rate: float = 10.0) -> list[Sample]:
    bench.start(rate)
    samples = [bench.next_sample(1.0) for _ in range(round(seconds * rate) + 1)]
    return [sample for sample in samples if sample]


def stroke(bench: SimulatedBench, pressure: float, rate: float = 100.0) -> float:
    """The published record: retracted and at rest, then 1.05 s of open valve; in m."""
    bench.command("relief_valve", pressure).wait()
    bench.command("valve", -1.0).wait()
    run(bench, 6.0)
    bench.command("valve", 0.0).wait()
    before = run(bench, 2.0)[-1].values[POSITION]
    bench.command("valve", 1.0, duration=1.05).wait()
    return run(bench, 3.0, rate)[-1].values[POSITION] - before


@pytest.mark.parametrize(("celsius", "longer"), [(20.0, 0.0), (60.0, 0.014), (80.0, 0.022)])
def test_strokes_agree_with_the_independent_calculation(
    make_cylinder: MakeBench, celsius: float, longer: float
) -> None:
    bench = make_cylinder(celsius)
    for pressure, expected in ((20e5, 77.4e-3), (30e5, 94.9e-3), (40e5, 109.6e-3), (50e5, 122.6e-3)):
        assert stroke(bench, pressure) == pytest.approx(expected * (1.0 + longer), abs=1e-3)


def test_the_stroke_does_not_depend_on_the_rate(make_cylinder: MakeBench) -> None:
    strokes = [stroke(make_cylinder(), 40e5, rate) for rate in (7.0, 100.0, 333.0)]
    assert strokes == pytest.approx([strokes[0]] * 3, abs=2e-6)


def test_the_oil_temperature_follows_the_heat_balance(make_cylinder: MakeBench) -> None:
    bench = make_cylinder(22.0)
    bench.command("relief_valve", 50e5).wait()
    bench.command("heater", 1.0).wait()
    run(bench, 30.0)
    samples = run(bench, 120.0, 1.0)
    rate = (samples[-1].values[TEMPERATURE] - samples[0].values[TEMPERATURE]) / 120.0
    density = 870.0 * (1.0 - 7e-4 * (23.0 - 15.0))
    pump_work = 50e5 * 14e-3 / 60.0 / 0.9
    assert rate == pytest.approx((2000.0 + pump_work) / (density * 80e-3 * 1900.0), rel=0.01)


def test_pressure_follows_the_relief_valve_and_drops_without_the_pump(
    rig: Rig, make_cylinder: MakeBench
) -> None:
    bench = make_cylinder()
    bench.command("relief_valve", 35e5).wait()
    assert run(bench, 2.0)[-1].values[PRESSURE] == pytest.approx(35e5, rel=1e-3)
    standing = rig.simulation.model_copy(update={"pump": False})
    bench = make_cylinder(on=rig.model_copy(update={"simulation": standing}))
    bench.command("valve", 1.0).wait()
    assert run(bench, 5.0)[-1].values[PRESSURE] < 5e5


def test_a_rig_with_more_transducers_reads_the_chambers(make_bench: MakeBench) -> None:
    instrumented = load_rig(ROOT / "rigs" / "hl32-bench-instrumented.yaml")
    bench = make_bench(on=instrumented, plant=None)
    bench.command("valve", -1.0).wait()
    names = instrumented.layout.channels
    values = dict(zip(names, run(bench, 8.0)[-1].values, strict=True))
    assert values["pressure_a"] == pytest.approx(0.0, abs=1e5)
    assert values["pressure_b"] == pytest.approx(values["supply_pressure"], abs=2e5)


def test_hidden_effects_change_the_stroke_and_are_part_of_the_identity(make_cylinder: MakeBench) -> None:
    late = make_cylinder(effects=["valve_open_delay:delay=50 ms"])
    assert "valve_open_delay (delay=0.05" in late.identity["plant"]
    sound = stroke(make_cylinder(), 30e5)
    assert stroke(late, 30e5) == pytest.approx(sound * (1.0 - 0.05 / 1.05), abs=1e-3)


def test_a_model_file_can_define_the_simulated_plant(make_cylinder: MakeBench) -> None:
    bench = make_cylinder(plant=ROOT / "models" / "hl32-textbook.yaml")
    assert "hl32-textbook.yaml" in bench.identity["plant"]
    series = [area * 28.0 / (area**2 + 28.0**2) ** 0.5 for area in (3.3, 4.05)]  # throttle and valve edge
    assert stroke(bench, 30e5) == pytest.approx(94.9e-3 * series[1] / series[0], rel=0.015)


def test_injected_faults_act_on_the_equations(make_cylinder: MakeBench) -> None:
    bench = make_cylinder(faults=["valve_stuck@10 s", "heater_stuck_on@0 s"])
    bench.command("relief_valve", 30e5).wait()
    before = run(bench, 11.0)
    bench.command("valve", 1.0, duration=1.0).wait()
    after = run(bench, 60.0)
    assert after[-1].values[POSITION] == pytest.approx(before[-1].values[POSITION], abs=1e-4)
    assert after[-1].values[TEMPERATURE] > 294.0


def test_equal_seeds_give_identical_samples_on_the_equations(make_cylinder: MakeBench) -> None:
    runs = []
    for _ in range(2):
        bench = make_cylinder(noise="on", quantised="on", seed=4)
        bench.command("valve", 1.0, duration=0.777).wait()
        runs.append([(s.time, s.values, s.commands) for s in run(bench, 3.0, 100.0)])
    assert repr(runs[0]) == repr(runs[1])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": ["piston_leakge"]}, "did you mean 'piston_leakage'?"),
        ({"effects": ["valve_open_delay:delay=5 bar"]}, "wrong dimension, got '5 bar'"),
        ({"plant": "roles", "effects": ["piston_leakage"]}, "effects need a plant with a model"),
        ({"plant": "models/nothing.yaml"}, "nothing.yaml"),
    ],
)
def test_an_invalid_plant_option_is_refused_before_the_bench_is_opened(
    rig: Rig, options: dict[str, object], message: str
) -> None:
    with pytest.raises(RigctlError) as problem:
        create_backend(rig, "simulated", VirtualClock(), options)
    assert message in str(problem.value)


def test_a_model_of_another_kind_is_refused(rig: Rig, tmp_path: Path) -> None:
    other = tmp_path / "board.yaml"
    other.write_text("model: heater_board\n", encoding="utf-8")
    with pytest.raises(RigctlError, match="another kind than the bench"):
        create_backend(rig, "simulated", VirtualClock(), {"plant": other})
