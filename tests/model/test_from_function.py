"""Models whose equations are Python functions: the same as those of a family file, and clear refusals."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import rigctl
from rigctl.engine.symbols import Graph, evaluate, smooth_sign, to_text
from rigctl.engine.system import System
from rigctl.model.build import build_system
from rigctl.physics.python_functions import family_from_functions
from rigctl.physics.user import parse_family
from rigctl.units import DIMENSIONLESS


def motor_rates(t: Any, x: Any, u: Any, p: Any) -> Mapping[str, Any]:
    return {
        "current": (u.voltage - p.resistance * x.current - p.strength * x.speed) / p.inductance,
        "speed": (p.strength * x.current - p.damping * x.speed) / p.inertia,
    }


def motor_readings(x: Any, u: Any, p: Any) -> list[Any]:
    return [x.current, x["speed"]]


MOTOR: dict[str, Any] = {
    "states": {"current": ("0 A", "1 mA"), "speed": ("0 rad/s", "0.1 rad/s")},
    "inputs": {"voltage": "0 V"},
    "parameters": {
        "strength": ("0.04 V*s", "0.001 V*s", "1 V*s"),
        "resistance": ("1 ohm", "0.1 ohm", "10 ohm"),
        "inductance": ("5 mH", "0.1 mH", "100 mH"),
        "damping": ("1e-5 N*m*s", "0 N*m*s", "1e-3 N*m*s"),
        "inertia": "1e-4 kg*m^2",
    },
    "outputs": {"current": "A", "speed": "rad/s"},
}
MOTOR_FILE = """
family: motor
states:
  current: {start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - strength*speed)/inductance}
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: (strength*current - damping*speed)/inertia}
inputs: {voltage: {value: 0 V}}
parameters:
  strength: {value: 0.04 V*s, bounds: [0.001 V*s, 1 V*s]}
  resistance: {value: 1 ohm, bounds: [0.1 ohm, 10 ohm]}
  inductance: {value: 5 mH, bounds: [0.1 mH, 100 mH]}
  damping: {value: 1e-5 N*m*s, bounds: [0 N*m*s, 1e-3 N*m*s]}
constants: {inertia: 1e-4 kg*m^2}
outputs:
  current: {unit: A, formula: current}
  speed: {unit: rad/s, formula: speed}
"""
RIG = """
name: motor
channels:
  current: {unit: A, quantity: current, noise: 0.01 A}
  speed: {unit: rad/s, quantity: angular_speed, noise: 0.1 rad/s}
actuators:
  voltage: {kind: level, unit: V, low: -12 V, high: 12 V}
safe_state: {voltage: 0 V}
"""


def equations(system: System) -> list[str]:
    return [to_text(each) for each in (*system.rhs, *(one.expr for one in system.outputs))]


def declared(**changes: Any) -> dict[str, Any]:
    return {**MOTOR, **changes}


def test_its_equations_are_those_of_the_family_file() -> None:
    traced = family_from_functions("motor", motor_rates, motor_readings, **MOTOR)
    written = parse_family(MOTOR_FILE)
    one, other = (build_system(family, {}, None) for family in (traced, written))
    assert equations(one) == equations(other)
    assert (one.nominal, one.state_names, one.parameter_names) == (
        other.nominal,
        other.state_names,
        other.parameter_names,
    )
    assert [slot.name for slot in traced.slots] == [slot.name for slot in written.slots]


def test_a_missing_friction_is_found_in_a_log_and_no_number_is_changed(tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG, encoding="utf-8")
    run = rigctl.open_run(rigctl.import_file(_log(tmp_path), rigctl.load_rig(rig), tmp_path / "runs").path)
    model = rigctl.Model.from_function(motor_rates, motor_readings, rig=rig, name="motor", **MOTOR)
    assert not rigctl.compare([run], [model]).models[0].adequate
    found = rigctl.diagnose([run], model)
    assert "coulomb_on_speed" in (*found.effects, *(name for group in found.classes for name in group))
    sizes = {one.effect: one.parameters["size"] for one in found.ranking if one.effect == "coulomb_on_speed"}
    assert sizes["coulomb_on_speed"].value == pytest.approx(50.0, rel=0.05)
    resistance = found.best.fit.model.values["resistance"]
    assert resistance == pytest.approx(1.2, rel=0.02)
    assert model.values["resistance"] == 1.0


def _log(folder: Path) -> Path:
    """A motor of 1.2 ohm with a dry friction of 5 mN*m, integrated by SciPy."""
    times = np.arange(0.0, 10.0, 0.01)
    volts = np.repeat(np.random.default_rng(1).uniform(-6.0, 6.0, 20), 50)

    def rates(t: float, x: np.ndarray) -> list[float]:
        current, speed = x
        volt = volts[min(int(t / 0.01), volts.size - 1)]
        friction = 0.005 * math.tanh(speed / 0.05)
        return [
            (volt - 1.2 * current - 0.05 * speed) / 0.01,
            (0.05 * current - 1e-5 * speed - friction) / 1e-4,
        ]

    solved = solve_ivp(rates, (0.0, 10.0), [0.0, 0.0], t_eval=times, max_step=2e-3, rtol=1e-8)
    random = np.random.default_rng(2)
    current = solved.y[0] + random.normal(0.0, 0.01, times.size)
    speed = solved.y[1] + random.normal(0.0, 0.1, times.size)
    log = folder / "log.csv"
    rows = [
        f"{t:.2f},{v:.6f},{i:.6f},{w:.6f}" for t, v, i, w in zip(times, volts, current, speed, strict=True)
    ]
    log.write_text("\n".join(["time [s],voltage [V],current [A],speed [rad/s]", *rows]) + "\n", "utf-8")
    return log


def test_a_tank_and_a_pendulum_take_a_few_lines(tmp_path: Path) -> None:
    tank = family_from_functions(
        "tank",
        lambda t, x, u, p: (u.inflow - p.area * np.sqrt(2.0 * p.gravity * x.level)) / p.base,
        lambda x, u, p: x.level,
        states={"level": "200 mm"},
        inputs={"inflow": "0 l/min"},
        parameters={"area": ("20 mm^2", "1 mm^2", "500 mm^2"), "base": "0.05 m^2", "gravity": "9.81 m/s^2"},
        outputs={"level": "mm"},
    )
    rate = build_system(tank, {}, None)
    assert rate.state_names == ("level",)
    assert tank.states[0].scale == pytest.approx(1e-6)

    def swing(t: Any, x: Any, u: Any, p: Any) -> tuple[Any, Any]:
        angle, speed = x
        return speed, -p.gravity / p.length * np.sin(angle) - p.damping * speed

    pendulum = family_from_functions(
        "pendulum",
        swing,
        lambda x, u, p: {"angle": x.angle},
        states={"angle": "10 deg", "speed": "0 rad/s"},
        inputs={},
        parameters={
            "length": ("0.5 m", "0.1 m", "2 m"),
            "damping": ("0.1 1/s", "0 1/s", "9 1/s"),
            "gravity": "9.81 m/s^2",
        },
        outputs={"angle": "deg"},
    )
    assert pendulum.states[0].start == pytest.approx(math.radians(10.0))


def test_a_model_without_states_needs_no_rates() -> None:
    family = family_from_functions(
        "law",
        None,
        lambda x, u, p: p.gain * u.drive,
        states={},
        inputs={"drive": "0 V"},
        parameters={"gain": ("1 m/V", "0 m/V", "9 m/V")},
        outputs={"reach": "mm"},
    )
    assert family.outputs[0].unit == "m"


def test_it_is_sent_to_other_processes() -> None:
    family = family_from_functions("motor", motor_rates, motor_readings, **MOTOR)
    again = pickle.loads(pickle.dumps(family))
    assert equations(build_system(again, {}, None)) == equations(build_system(family, {}, None))


def branching(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": min(x.speed, 0.0)}


def in_time(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": x.speed * t}


def at_a_time(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": 0.0 if t == 0.0 else x.speed}


def with_math(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": math.sqrt(x.speed)}


def with_a_corner(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": np.sign(x.speed)}


def with_an_integral(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": np.arctan2(x.speed, x.speed)}


def misspelt(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": p.dampng * x.speed}


def of_another_unit(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {**motor_rates(t, x, u, p), "speed": x.current}


def forgetful(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {"speed": motor_rates(t, x, u, p)["speed"]}


def failing(t: Any, x: Any, u: Any, p: Any) -> dict[str, Any]:
    return {"speed": list(x)[7]}


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        (in_time, "may not depend on the time itself"),
        (at_a_time, "may not depend on the time itself"),
        (misspelt, "did you mean 'damping'"),
        (of_another_unit, r"the equation of speed has the dimension \[A\]"),
        (forgetful, "does not return one rate for each of current, speed"),
        (failing, r"failing fails: IndexError: .*, in line \d+ of failing"),
        (None, "no function of their rates"),
    ],
)
def test_what_has_no_equation_is_refused_in_one_message(
    rates: Callable[..., Any] | None, message: str
) -> None:
    with pytest.raises(rigctl.RigctlError, match=message):
        family_from_functions("motor", rates, motor_readings, **MOTOR)


@pytest.mark.parametrize(
    ("rates", "why"),
    [
        (branching, "may not branch"),
        (with_math, "an expression is not a number"),
        (with_a_corner, "may not have the corners of numpy.sign"),
        (with_an_integral, "numpy.arctan2 takes no symbols"),
    ],
)
def test_what_takes_no_symbols_is_called_with_numbers(rates: Callable[..., Any], why: str) -> None:
    family = family_from_functions("motor", rates, motor_readings, **MOTOR)
    assert family.program is not None
    assert why in family.program.why
    edges = {"voltage_input", "voltage_delay", "current_reading", "speed_reading"}
    parameters = {f"{name}_parameter" for name in ("strength", "resistance", "inductance", "damping")}
    assert {slot.name for slot in family.slots} == edges | parameters


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inputs": {"voltage": ("0 V", "1 V")}}, "'voltage' is declared with too much"),
        ({"states": {**MOTOR["states"], "current": "none"}}, "'current': not a quantity"),
        ({"states": {**MOTOR["states"], "current": ("0 A", "0 A")}}, "greater than zero"),
        (
            {"parameters": {**MOTOR["parameters"], "damping": ("1e-5 N*m*s", "0 N*m*s")}},
            "'damping' has one bound",
        ),
        (
            {"parameters": {**MOTOR["parameters"], "damping": ("1 N*m*s", "2 N*m*s", "3 N*m*s")}},
            "not between",
        ),
        ({"parameters": {**MOTOR["parameters"], "damping": ("1 N*m*s", "2 bar", "3 bar")}}, "bar"),
        ({"parameters": {**MOTOR["parameters"], "spare": ("1 kg", "0 kg", "2 kg")}}, "spare"),
        ({"outputs": {"current": "A", "speed": "flurbs"}}, "flurbs"),
        ({"outputs": {"current": "A", "speed": None}}, "'speed' has no unit"),
        ({"states": {**MOTOR["states"], "current": ()}}, "'current' is declared without a quantity"),
        ({"states": {**MOTOR["states"], "current": None}}, "'current' is declared without a quantity"),
    ],
)
def test_a_wrong_declaration_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(rigctl.RigctlError, match=message):
        family_from_functions("motor", motor_rates, motor_readings, **declared(**changes))


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0))
def test_numpys_functions_give_the_numbers_of_numpy(a: float, b: float) -> None:
    graph = Graph()
    x, y = graph.variable("x", DIMENSIONLESS), graph.variable("y", DIMENSIONLESS)

    def law(one: Any, two: Any) -> Any:
        waves = np.sin(one) + np.cos(two) * np.tan(0.3 * one) - np.tanh(one * two)
        powers = np.hypot(one, two) + np.square(one) + np.power(two, 1.5) + np.reciprocal(one) + np.sqrt(two)
        return (
            np.float64(2.0) * waves / powers + np.exp(-one) + np.log(two) + np.sinh(0.1 * one) - np.cosh(two)
        )

    assert evaluate(law(x, y), {"x": a, "y": b}) == pytest.approx(law(a, b), rel=1e-12)


def test_an_array_of_coefficients_multiplies_a_symbol() -> None:
    graph = Graph()
    x = graph.variable("x", DIMENSIONLESS)
    terms = np.array([1.0, 2.0, 3.0]) * x
    assert [evaluate(each, {"x": 2.0}) for each in terms] == [2.0, 4.0, 6.0]
    assert evaluate(smooth_sign(x, 0.1) + np.array(1.0) * x, {"x": 2.0}) == pytest.approx(3.0)
