"""The compiled bench against SciPy's integrators on an independent implementation of the same equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from families.plain_cylinder import PlainCylinder, Vector
from rigctl.effects import library
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.system import System
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import build_system, plant_inputs, plant_stepper, superset
from rigctl.rig.load import load_rig

FAMILY = "hydraulic_cylinder"
# the record starts off the end stop, whose corner only one implementation rounds over micrometres;
# the retraction ends before the stop, because the reference cannot integrate over a hard corner
CAMPAIGN = [(0.2, 0.0), (1.05, 1.0), (1.0, 0.0), (0.5, -1.0)]
START_AT = 0.01
TIMES = np.arange(0.0, 2.75, 0.01)

Effects = dict[str, dict[str, float]]

#: for differences of two simulations
FINE = Tolerance(relative=1e-9, absolute=1e-6)


def simulated(
    celsius: float, bar: float, effects: Effects | None = None, *, tolerance: Tolerance = DEFAULT
) -> dict[str, Vector]:
    system = build_system(FAMILY, effects)
    done = simulate(compile_system(system), [record(system, celsius, bar)], tolerance=tolerance).require()
    return {name: done.output(name)[0] for name in system.output_names}


def record(system: System, celsius: float, bar: float, heater: float = 0.0) -> Excitation:
    start = {"oil_temperature": celsius + 273.15, "supply_pressure": bar * 1e5, "pressure_b": 0.9e5 * bar}
    start |= {"position": START_AT, "pressure_a": 0.75 * 0.9e5 * bar}
    start |= {name: -1.0 for name in system.state_names if name.endswith(".bending")}
    starts = np.cumsum([0.0] + [duration for duration, _ in CAMPAIGN[:-1]])
    return Excitation(
        times=TIMES,
        switch_times=starts,
        inputs=np.array([[command, heater, bar * 1e5, 295.15, 1.0] for _, command in CAMPAIGN]),
        initial=np.array([start.get(name, 0.0) for name in system.state_names]),
        parameters=np.array(system.nominal),
    )


def plain(celsius: float, bar: float, bench: PlainCylinder | None = None) -> dict[str, Vector]:
    bench = replace(bench or PlainCylinder(), p_set=bar * 1e5)
    # several times faster, and as accurate where no seal breaks loose
    method, rtol = ("Radau", 1e-8) if bench.presliding else ("LSODA", 1e-10)
    y = bench.record(celsius, CAMPAIGN, TIMES, start_at=START_AT, method=method, rtol=rtol)
    names = ("oil_temperature", "spool", "supply_pressure", "pressure_a", "pressure_b", "position")
    return {name: y[:, column] for column, name in enumerate(names)}


@pytest.mark.parametrize(("celsius", "bar"), [(20.0, 20.0), (60.0, 50.0)])
@pytest.mark.parametrize(("tolerance", "measured", "chambers"), [(DEFAULT, 3e-5, 6e-4), (TIGHT, 5e-6, 2e-5)])
def test_a_whole_record_agrees_with_an_independent_implementation(
    celsius: float, bar: float, tolerance: Tolerance, measured: float, chambers: float
) -> None:
    found, expected = simulated(celsius, bar, tolerance=tolerance), plain(celsius, bar)
    # the chambers ring at 400 Hz when the valve opens, the channels of the published bench do not show it
    shares = {
        "position": measured,
        "supply_pressure": measured,
        "pressure_a": chambers,
        "pressure_b": chambers,
    }
    for name, share in shares.items():
        peak = np.abs(expected[name]).max()
        assert np.abs(found[name] - expected[name]).max() < share * peak, name


@pytest.mark.parametrize(
    ("celsius", "strokes"),
    [
        (20, (77.4, 94.9, 109.6, 122.6)),
        (60, tuple(1.014 * s for s in (77.4, 94.9, 109.6, 122.6))),
        (80, tuple(1.022 * s for s in (77.4, 94.9, 109.6, 122.6))),
    ],
)
def test_strokes_agree_with_the_published_bench(celsius: float, strokes: tuple[float, ...]) -> None:
    for bar, stroke in zip((20.0, 30.0, 40.0, 50.0), strokes, strict=True):
        position = simulated(celsius, bar)["position"]
        assert 1e3 * (position[TIMES <= 2.25].max() - START_AT) == pytest.approx(stroke, abs=0.15)


def gap(k: float, p1: float, p2: float, mu: float) -> float:
    return k * (p1 - p2) / mu


def valve_leak(y: Vector, mu: float) -> dict[str, float]:
    _, _, ps, pa, pb, _, _ = y
    k = 5e-14
    return {
        "pa": gap(k, ps, pa, mu),
        "pb": gap(k, ps, pb, mu),
        "at": gap(k, pa, 0, mu),
        "bt": gap(k, pb, 0, mu),
    }


def soft_air(pressure: float, x0: float = 0.01) -> float:
    absolute = pressure + 101325.0
    air = x0 * (101325.0 / absolute) ** (1 / 1.4)
    return (air / (1.4 * absolute) - air / 1.4e9) / (1 - x0 + air)


def stribeck(y: Vector, mu: float) -> dict[str, float]:
    return {"friction": (80 + 120 * math.exp(-((y[6] / 0.01) ** 2))) * y[7]}


HIDDEN: list[tuple[str, dict[str, float], PlainCylinder]] = [
    (
        "piston_leakage",
        {"conductance": 5e-14},
        PlainCylinder(extra=lambda y, mu: {"ab": gap(5e-14, y[3], y[4], mu)}),
    ),
    ("valve_leakage", {"conductance": 5e-14}, PlainCylinder(extra=valve_leak)),
    (
        "rod_leakage",
        {"conductance": 2e-14},
        PlainCylinder(extra=lambda y, mu: {"bo": gap(2e-14, y[4], 0, mu)}),
    ),
    ("pump_slip", {"conductance": 1e-13}, PlainCylinder(extra=lambda y, mu: {"pt": gap(1e-13, y[2], 0, mu)})),
    ("relief_override", {"resistance": 2e9}, PlainCylinder(extra=lambda y, mu: {"R": 2e9})),
    (
        "relief_thermal_drift",
        {"coefficient": 2e-3},
        PlainCylinder(extra=lambda y, mu: {"setting": 1 - 2e-3 * (y[0] - 20)}),
    ),
    (
        "flow_area_thermal_drift",
        {"coefficient": -2e-3},
        PlainCylinder(extra=lambda y, mu: {"area": 1 - 2e-3 * (y[0] - 20)}),
    ),
    (
        "viscous_friction",
        {"coefficient": 2e3},
        PlainCylinder(extra=lambda y, mu: {"friction": 2e3 * mu * y[6]}),
    ),
    (
        "coulomb_friction",
        {"force": 150.0},
        PlainCylinder(extra=lambda y, mu: {"friction": 150 * y[7]}, presliding=20e-6),
    ),
    (
        "stribeck_friction",
        {"force": 80.0, "static_force": 200.0},
        PlainCylinder(extra=stribeck, presliding=20e-6),
    ),
    ("load_mass", {"mass": 200.0}, PlainCylinder(extra=lambda y, mu: {"mass": 200.0})),
    ("spring_load", {"stiffness": 1e3}, PlainCylinder(extra=lambda y, mu: {"load": 1e3 * y[5]})),
    ("entrained_air", {"fraction": 0.01}, PlainCylinder(soft=soft_air)),
    ("hose_compliance", {"compliance": 1e-9}, PlainCylinder(soft=lambda p: 1e-9)),
]


@pytest.mark.parametrize(("name", "values", "bench"), HIDDEN, ids=[name for name, _, _ in HIDDEN])
def test_a_hidden_effect_agrees_with_an_independent_implementation(
    name: str, values: dict[str, float], bench: PlainCylinder
) -> None:
    # a seal that breaks loose amplifies integration errors, most where the chambers ring afterwards
    sudden = name == "stribeck_friction"
    tolerance, ringing = (FINE, 3e-3) if sudden else (TIGHT, 2e-4)
    found, expected = simulated(50.0, 40.0, {name: values}, tolerance=tolerance), plain(50.0, 40.0, bench)
    without = simulated(50.0, 40.0, tolerance=TIGHT)
    shares = {"position": 5e-6, "supply_pressure": 5e-6, "pressure_a": ringing, "pressure_b": ringing}
    for channel, share in shares.items():
        peak = np.abs(expected[channel]).max()
        effect = np.abs(expected[channel] - without[channel]).max()
        assert np.abs(found[channel] - expected[channel]).max() < share * peak + 2e-3 * effect, channel


@pytest.mark.parametrize(
    ("name", "values", "later"),
    [
        ("valve_open_delay", {"delay": 0.03}, (0.03, 0.0)),
        ("valve_close_delay", {"delay": 0.03}, (0.0, 0.03)),
        ("valve_delay_thermal", {"coefficient": 1e-3}, (0.03, 0.0)),
    ],
)
def test_a_valve_delay_equals_a_later_command(
    name: str, values: dict[str, float], later: tuple[float, float]
) -> None:
    opening, closing = later
    found = simulated(50.0, 40.0, {name: values}, tolerance=TIGHT)["position"]
    bench = PlainCylinder(p_set=40e5)
    commands = [
        (0.2 + opening, 0.0),
        (1.05 - opening + closing, 1.0),
        (1.0 - closing + opening, 0.0),
        (0.5, -1.0),
    ]
    expected = bench.record(50.0, commands, TIMES, start_at=START_AT)[:, 5]
    # the oil warms by 0.01 K before the valve is commanded to open
    assert np.abs(found - expected).max() < 5e-5 * expected.max()


def test_the_whole_library_at_null_changes_no_trajectory() -> None:
    base, off = simulated(50.0, 40.0), simulated(50.0, 40.0, superset(FAMILY))
    for name, values in base.items():
        # the steps are chosen over all states, so that they differ within the tolerance
        assert np.abs(off[name] - values).max() < 5e-4 * np.abs(values).max(), name


SIZES = [
    (effect.name, parameter.name)
    for effect in library(FAMILY).values()
    for parameter in effect.parameters
    if not parameter.shape
]


@cache
def at_null(more: str) -> CompiledSystem:
    """The bench with every effect of the library at null, except for a small amount of `more`."""
    return compile_system(
        build_system(FAMILY, superset(FAMILY, {more: {"coefficient": 500.0}} if more else {}))
    )


@pytest.mark.parametrize(("effect", "parameter"), SIZES)
def test_sensitivities_at_null_agree_with_one_sided_differences(effect: str, parameter: str) -> None:
    size = library(FAMILY)[effect].parameter(parameter).start * 5e-3
    # heating excites the thermal effects, viscous friction those of the viscosity
    compiled = at_null("viscous_friction" if effect != "viscous_friction" else "")
    system = compiled.system
    column = f"{effect}.{parameter}"
    place = system.parameter_names.index(column)
    values = np.tile(np.array(system.nominal), (3, 1))
    values[1, place] += size
    values[2, place] += 2.0 * size
    base = record(system, 60.0, 30.0, heater=2000.0)
    trajectories = simulate(
        compiled, [base.replace(parameters=q) for q in values], columns=[column], tolerance=FINE
    ).require()
    # a one-sided second-order difference, as an effect may not be negative
    slope = (4.0 * trajectories.outputs[1] - trajectories.outputs[2] - 3.0 * trajectories.outputs[0]) / (
        2.0 * size
    )
    exact = trajectories.sensitivities[0][:, :, 0]
    for output, name in enumerate(system.output_names[:3]):  # those of the published bench
        noise = 2e-8 * np.abs(trajectories.outputs[0][:, output]).max() / abs(size)
        error = np.linalg.norm(slope[:, output] - exact[:, output]) / np.sqrt(len(slope))
        share = np.linalg.norm(exact[:, output]) / np.sqrt(len(slope))
        assert error < 0.03 * share + noise, name


def test_the_stepped_bench_reproduces_the_published_stroke() -> None:
    rig = load_rig(shipped("rigs", "hl32-bench.yaml"))
    bench = plant_stepper(rig, initial={"pressure_b": 18e5})
    assert bench.compiled.system.output_names == ("oil_temperature", "supply_pressure", "position")
    bench.advance(0.2)
    bench.switch_input("valve", 1.0)
    bench.switch_input("valve", 0.0, at=1.25)
    for sample in range(21, 226):
        bench.advance(sample / 100)
    # the rig's efficiency warms the oil a little more than the family's test does
    assert 1e3 * bench.outputs()[2] == pytest.approx(77.4, abs=0.1)


def test_hidden_effects_default_to_their_typical_size() -> None:
    rig = load_rig(shipped("rigs", "hl32-bench.yaml"))
    bench = plant_stepper(rig, {"coulomb_friction": {"force": 30.0}, "pressure_lag": {}})
    system = bench.compiled.system
    sizes = dict(zip(system.parameter_names, system.nominal, strict=True))
    assert sizes["coulomb_friction.force"] == 30.0
    assert sizes["pressure_lag.lag"] == 20e-3
    with pytest.raises(RigctlError, match="did you mean 'pressure_b'"):
        plant_stepper(rig, initial={"presure_b": 0.0})


def test_commands_are_converted_to_model_inputs() -> None:
    inputs = plant_inputs(load_rig(shipped("rigs", "hl32-bench.yaml")))
    commands = {"valve": 1.0, "heater": 1.0, "relief_valve": 30e5}
    switched: Callable[[str], dict[str, float]] = lambda name: inputs.switched(name, commands)  # noqa: E731
    assert switched("heater") == {"heater_power": 2000.0}
    assert switched("valve") == {"valve": 1.0}
    assert switched("relief_valve") == {"pressure_setpoint": 30e5}
