"""Generic effects: where each applies, and that each is valid."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from rigctl.effects.generic import generic_effects, offers
from rigctl.effects.generic.common import shown_quotient
from rigctl.effects.registry import check_effect, library
from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.model.build import build_system, superset
from rigctl.physics.families import FAMILIES, find_family, using_families
from rigctl.physics.family import (
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    StateVariable,
)
from rigctl.physics.scope import Scope
from rigctl.physics.user import parse_family
from rigctl.units import parse_unit

MOTOR = """
family: motor
states:
  current: {start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - kt*speed)/inductance}
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: kt*current/inertia}
  angle: {start: 0 rad, scale: 0.1 rad, rate: speed}
inputs:
  voltage: {value: 0 V}
parameters:
  resistance: {value: 2 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {value: 0.05 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
constants: {inertia: 2e-4 kg*m^2, inductance: 5e-3 H}
outputs:
  current: {unit: A, formula: current}
  rpm: {unit: rad/s, formula: speed}
"""

OVEN = """
family: oven
states:
  air: {start: 20 degC, scale: 0.1 K, rate: (power - loss*(air - room_temperature) - to_load)/capacity}
  load: {start: 20 degC, scale: 0.1 K, rate: to_load/load_capacity}
inputs:
  power: {value: 0 W}
  room_temperature: {value: 20 degC}
parameters:
  loss: {value: 2 W/K, bounds: [0 W/K, 100 W/K]}
  contact: {value: 1 W/K, bounds: [0 W/K, 100 W/K]}
constants: {capacity: 500 J/K, load_capacity: 800 J/K}
definitions:
  to_load: {unit: W, formula: contact*(air - load)}
outputs:
  air: {unit: degC, formula: air}
  mean: {unit: degC, formula: air + 0.5*(load - air)}
"""

PUMP = """
family: pump
inputs:
  flow: {value: 5 m^3/h}
  speed: {value: "1"}
parameters:
  height: {value: 22 m, bounds: [1 m, 100 m]}
  resistance: {value: 1.2e6 s^2/m^5, bounds: [1e4 s^2/m^5, 1e8 s^2/m^5]}
outputs:
  head: {unit: m, formula: "height*speed^2 - resistance*flow^2"}
"""

DECLARED = """
family: brake
states:
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: (drive - drag)/inertia}
inputs: {drive: {value: 0 N*m}}
parameters: {inertia: {value: 1 kg*m^2, bounds: [0.1 kg*m^2, 10 kg*m^2]}}
slots: {drag: {unit: N*m}}
outputs: {speed: {unit: rad/s, formula: speed}}
"""


def family(text: str) -> ModelFamily:
    return parse_family(text)


@pytest.mark.parametrize("text", [MOTOR, OVEN, PUMP, DECLARED])
def test_every_generic_effect_is_sound_and_their_number_is_limited(text: str) -> None:
    chosen = family(text)
    effects = generic_effects(chosen)
    assert effects == tuple(library(chosen).values())
    assert 5 < len(effects) <= 60
    for effect in effects:
        check_effect(effect)
        assert set(effect.confused_with) <= {other.name for other in effects}
        assert effect.looks_like
        assert effect.source


def test_friction_is_offered_for_speeds_and_leaks_for_stored_quantities() -> None:
    motor = set(library(family(MOTOR)))
    assert {"coulomb_on_speed", "stribeck_on_speed", "quadratic_drag_on_speed"} <= motor
    assert {"leak_on_current", "power_law_on_current", "saturation_of_voltage", "lag_of_rpm"} <= motor
    assert not {
        name for name in motor if name.endswith("_on_angle")
    }  # the rate of a position is a speed, not a balance
    assert "coulomb_on_current" not in motor
    assert "leak_on_speed" not in motor


BATH = """
family: bath
states:
  probe: {start: 20 degC, scale: 10 mK, rate: (bath - probe)/lag}
inputs: {bath: {value: 20 degC}}
parameters: {lag: {value: 60 s, bounds: [1 s, 1000 s]}}
outputs: {probe: {unit: degC, formula: probe}}
"""
TABLE = """
family: rod
inputs: {oven: {value: 20 degC}}
parameters: {expansion: {value: 2e-5 1/K, bounds: [1e-6 1/K, 1e-3 1/K]}}
outputs: {stretch: {unit: "1", formula: expansion*(oven - 20 degC)}}
"""


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (BATH, "gain_of_bath"),
        (BATH, "quadratic_of_bath"),
        (TABLE, "gain_of_stretch_with_oven"),
        (TABLE, "quadratic_of_stretch_with_oven"),
    ],
)
def test_relative_errors_of_a_temperature_refer_to_its_usual_value(text: str, name: str) -> None:
    """Two percent of 293 K would be an error of 6 K at room temperature."""
    chosen = family(text)
    effect = library(chosen)[name]
    assert "− 20 degC)" in effect.equation
    size = effect.parameters[0].name
    ((slot, _),) = effect.terms

    def added(celsius: float) -> float:
        item = chosen.inputs[0].name
        at = {one.name: one.start for one in chosen.states} | {item: 273.15 + celsius}
        at |= {one.name: one.value for one in chosen.parameters} | {f"{name}.{size}": 0.02}
        return float(Scope(chosen, at, additions=effect.additions()).total(slot))

    assert added(20.0) == pytest.approx(0.0, abs=1e-9)
    assert added(30.0) > 0.0
    if name.startswith("gain"):
        assert added(30.0) == pytest.approx(0.2)


def test_effects_on_a_reading_act_at_only_one_of_its_slots() -> None:
    """Effects at two slots would depend on each other: a circular equation."""
    text = MOTOR.replace("formula: current}", "formula: current + extra + sensor - more}")
    text += "slots:\n" + "".join(
        f"  {name}: {{unit: A, kind: {kind}}}\n"
        for name, kind in (("extra", "process"), ("sensor", "sensor"), ("more", "process"))
    )
    chosen = family(text)
    found = {offer.role.slot.name: offer for offer in offers(chosen)}
    assert {"gain_of_current", "lag_of_current"} <= {effect.name for effect in found["sensor"].effects}
    for name in ("extra", "more"):
        assert not found[name].effects
        assert found[name].why_not == "it adds to the reading current as sensor does, where effects act"
    build_system(chosen, superset(chosen))  # all together


def test_a_static_reading_may_depend_on_inputs_that_its_formula_lacks() -> None:
    """The textbook pump delivers the same flow at every pressure; real pumps leak."""
    text = "family: pump\ninputs: {pressure: {value: 100 bar}, oil_temperature: {value: 40 degC}}\n"
    text += "parameters: {delivery: {value: 8 l/min, bounds: [1 l/min, 50 l/min]}}\n"
    text += "outputs: {flow: {unit: l/min, formula: delivery}}\n"
    known = library(family(text))
    assert {"gain_of_flow_with_pressure", "gain_of_flow_with_oil_temperature"} <= set(known)
    assert "− 40 degC)" in known["gain_of_flow_with_oil_temperature"].equation
    units = [known[f"{law}_of_flow_with_pressure"].parameters[0].unit for law in ("gain", "quadratic")]
    assert units == ["l/min/bar", "l/min/bar^2"]  # as its author writes them, not m^4*s/kg
    assert known["threshold_of_flow_with_oil_temperature"].parameters[1].unit == "degC"


@pytest.mark.parametrize(
    ("above", "below", "unit"),
    [
        ("bar", ("l/min", "l/min"), "bar/(l/min)^2"),
        ("1", ("V",), "1/V"),
        ("mm", ("1",), "mm"),
        ("K", ("W/cm^2",), "K/(W/cm^2)"),
    ],
)
def test_the_unit_of_a_quotient_keeps_the_units_as_written(
    above: str, below: tuple[str, ...], unit: str
) -> None:
    assert shown_quotient(above, *below) == unit
    parse_unit(unit)


GROWTH = """
family: culture
states:
  pace: {start: 0.1 1/s, scale: 1e-3 1/s, rate: (feed*step - pace)/lag}
inputs: {feed: {value: "0"}}
parameters:
  lag: {value: 10 s, bounds: [1 s, 100 s]}
  step: {value: 1 1/s, bounds: [0.1 1/s, 10 1/s]}
outputs: {pace: {unit: 1/s, formula: pace}}
"""


@pytest.mark.parametrize(
    ("unit", "turns"),
    [("1/s", False), ("Hz", False), ("1/min", False)]
    + [(unit, True) for unit in ("rad/s", "rpm", "deg/s", "U/min")],
)
def test_friction_is_offered_for_angular_speeds_and_not_for_growth_rates(unit: str, turns: bool) -> None:
    known = set(library(family(GROWTH.replace("0.1 1/s, scale: 1e-3 1/s", f"1 {unit}, scale: 1e-2 {unit}"))))
    assert ("coulomb_on_pace" in known) == turns
    assert ("leak_on_pace" in known) != turns


def test_a_rate_is_an_angular_speed_if_an_angle_is_its_integral() -> None:
    angle = "  angle: {start: '0', scale: 0.1, rate: pace}\ninputs:"
    assert "coulomb_on_pace" in library(family(GROWTH.replace("inputs:", angle)))


def test_heat_leaks_to_the_room_and_a_mean_of_states_may_lag() -> None:
    oven = family(OVEN)
    known = library(oven)
    assert known["leak_on_air"].equation == "w = −k·(air − room_temperature)"
    assert "gain_of_power" in known
    assert "offset_of_room_temperature" in known
    assert "gain_of_room_temperature" not in known
    assert "lag_of_air" in known
    assert "lag_of_mean" in known
    why = {offer.role.slot.name: offer.why_not for offer in offers(oven)}
    assert why["air_rate"] == "no friction: it is not a speed"
    assert why["room_temperature_input"] == "only an offset: it is not commanded"
    assert why["mean_reading"] == ""


def test_a_static_family_has_effects_that_depend_on_its_inputs() -> None:
    pump = family(PUMP)
    known = library(pump)
    assert {"offset_of_head", "quadratic_of_head_with_flow", "threshold_of_head_with_speed"} <= set(known)
    assert not [effect.name for effect in known.values() if effect.states]
    declared = family(
        PUMP.replace("outputs:", "slots: {loss: {unit: m}}\noutputs:").replace('2"', '2 - loss"')
    )
    assert {"offset_on_loss", "threshold_on_loss_with_flow"} <= set(library(declared))


def test_friction_opposes_the_motion_whatever_the_sign_of_its_slot() -> None:
    """A declared slot that decelerates and a derived one that accelerates: friction brakes at both."""
    for text, effect, size in ((DECLARED, "coulomb_on_drag", 0.5), (MOTOR, "coulomb_on_speed", 50.0)):
        chosen = family(text)
        compiled = compile_system(build_system(chosen, {effect: {"size": size}}))
        system = compiled.system
        start = np.zeros(len(system.states))
        start[system.state_names.index("speed")] = 10.0
        times = np.linspace(0.0, 0.1, 11)
        given = np.zeros((1, len(system.inputs)))
        record = Excitation(times, np.zeros(1), given, start, np.array(system.nominal), "coast")
        found = simulate(compiled, [record]).require().outputs[0]
        at = next(name for name in system.output_names if name in ("speed", "rpm"))
        course = found[:, system.output_names.index(at)]
        assert course[-1] < 10.0 - 0.9 * 0.1 * size


def test_shipped_families_and_those_that_opt_out_have_no_generic_effects() -> None:
    for name, shipped in FAMILIES.items():
        assert generic_effects(shipped) == (), name
    silent = family(MOTOR.replace("family: motor", "family: motor\ngeneric_effects: false"))
    assert silent.slots == ()
    assert library(silent) == {}


def test_a_python_family_gets_generic_slots_and_sees_the_disturbed_input() -> None:
    cart = ModelFamily(
        name="cart",
        title="Cart",
        source="Newton",
        states=(StateVariable("speed", "m/s", 1e-3, lambda m: m.push / m.mass, 0.0, "of the cart"),),
        inputs=(InputVariable("push", "N", 0.0, "on the cart"),),
        parameters=(ParameterDeclaration("mass", "kg", 2.0, "of the cart", 0.1, 10.0),),
        definitions=(),
        slots=(),
        outputs=(OutputVariable("speed", "m/s", lambda m: m.speed, "of the cart"),),
    )
    with using_families(cart):
        known = find_family("cart")
        assert {"coulomb_on_speed", "offset_of_push", "lag_of_speed"} <= set(library(known))
        compiled = compile_system(build_system(known, {"offset_of_push": {"size": 3.0}}))
    system, times = compiled.system, np.array([0.0, 2.0])
    record = Excitation(times, np.zeros(1), np.array([[1.0]]), np.zeros(1), np.array(system.nominal), "cart")
    found = simulate(compiled, [record]).require().outputs[0]
    assert found[-1, 0] == pytest.approx((1.0 + 3.0) / 2.0 * 2.0, rel=1e-6)


def test_importing_the_effects_does_not_load_the_unit_registry() -> None:
    """The unit registry takes a second to build, at the cost of every command."""
    asked = "import sys, rigctl.effects; sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0


def test_effects_at_null_change_no_output() -> None:
    chosen = family(MOTOR)
    times = np.linspace(0.0, 0.5, 26)
    outputs = []
    for effects in ({}, superset(chosen)):
        compiled = compile_system(build_system(chosen, effects))
        system = compiled.system
        starts = {f"{e.name}.{s.name}": s.start for e in library(chosen).values() for s in e.states}
        starts |= {state.name: state.start for state in chosen.states}
        start = np.array([starts[name] for name in system.state_names])
        record = Excitation(
            times, np.array([0.0, 0.2]), np.array([[5.0], [-3.0]]), start, np.array(system.nominal), "off"
        )
        outputs.append(simulate(compiled, [record]).require().outputs[0])
    assert outputs[0] == pytest.approx(outputs[1], rel=1e-4, abs=1e-3)


def test_limits_at_an_input_that_is_declared_at_zero_are_in_its_own_unit() -> None:
    """One SI unit, 6e7 ml/min, was assumed for a pump of 20: no dead band of it could be found."""
    family = parse_family("""
family: syringe
states:
  pressure: {start: 150 mbar, scale: 10 mbar, rate: (pump - flow)/compliance}
inputs:
  pump: {value: 0 ml/min}
parameters:
  compliance: {value: 0.35 ml/bar, bounds: [0.01 ml/bar, 10 ml/bar]}
  resistance: {value: 5 bar*s/ml, bounds: [0.1 bar*s/ml, 100 bar*s/ml]}
definitions:
  flow: {unit: ml/min, formula: pressure/resistance}
outputs:
  pressure: {unit: mbar, formula: pressure}
""")
    unit = parse_unit("ml/min").factor
    effects = {effect.name: effect for effect in generic_effects(family)}
    for name in ("dead_band_of_pump", "saturation_of_pump"):
        limit = next(one for one in effects[name].parameters if one.name == "limit")
        assert limit.low < 0.1 * unit < limit.start < 10.0 * unit < limit.high < 1e5 * unit
