"""The effects of the cylinder: each term compared with a hand calculation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import pytest

from rigctl.effects import Effect, find_effect, library, qualified
from rigctl.physics.families import find_family
from rigctl.physics.scope import Scope

FAMILY = find_family("hydraulic_cylinder")
LIBRARY = library("hydraulic_cylinder")
TERMS = [effect for effect in LIBRARY.values() if effect.terms]

# an operating point in the middle of an extension, in hot oil
POINT = {
    "oil_temperature": 333.15,
    "spool": 0.8,
    "supply_pressure": 31e5,
    "pressure_a": 9e5,
    "pressure_b": 4e5,
    "position": 0.08,
    "velocity": 0.07,
    "valve": 1.0,
    "heater_power": 1500.0,
    "pressure_setpoint": 30e5,
    "ambient_temperature": 295.15,
    "pump": 1.0,
}
MU = 3.1083e-5 * math.exp(1132.5833 / (333.15 - 147.4466))
RHO = 870.0 * (1.0 - 7e-4 * 45.0)
BORE_AREA = math.pi / 4 * 8e-3**2


def test_the_library_has_every_effect_of_the_reference() -> None:
    wanted = [
        "piston_leakage",
        "valve_leakage",
        "cap_leakage",
        "rod_leakage",
        "pump_slip",
        "relief_override",
        "relief_thermal_drift",
        "laminar_throttle",
        "flow_area_thermal_drift",
        "line_loss",
        "barus",
        "modulus_viscosity",
        "density_expansion",
        "entrained_air",
        "hose_compliance",
        "viscous_friction",
        "coulomb_friction",
        "stribeck_friction",
        "pressure_friction",
        "load_mass",
        "spring_load",
        "constant_load",
        "valve_open_delay",
        "valve_close_delay",
        "valve_delay_thermal",
        "spool_lag",
        "position_backlash",
        "position_gain",
        "position_offset",
        "position_thermal_drift",
        "pressure_gain",
        "pressure_offset",
        "pressure_lag",
        "thermocouple_lag",
        "thermocouple_offset",
        "ambient_loss",
        "pump_heating",
        "radiation_loss",
        "heater_lag",
        "wall_heat_capacity",
        "line_oil_temperature",
    ]
    assert set(wanted) <= set(LIBRARY)


def scope_with(effect: Effect, values: Mapping[str, float], **changed: float) -> Scope:
    known = {p.name: p.value for p in FAMILY.parameters} | POINT | changed
    known |= {qualified(effect.name, name): value for name, value in values.items()}
    return Scope(FAMILY, known, additions=effect.additions())


def drop_with(conductance: float, p1: float, p2: float = 0.0) -> float:
    return conductance * (p1 - p2) / MU


def stribeck(v: float) -> float:
    return (80 + 120 * math.exp(-((v / 0.01) ** 2))) * 0.25


def air(p: float) -> float:
    absolute = 0.5 * (p + 101325 + math.hypot(p + 101325, 2e3))
    bubbles = 0.005 * (101325 / absolute) ** (1 / 1.4)
    volume, slope = 0.995 + bubbles, 0.995 / 1.4e9 + bubbles / (1.4 * absolute)
    return slope / volume - 1 / 1.4e9


# effect, slot, variables of the slot, and the term calculated by hand at POINT and typical parameters
TERMS_BY_HAND: list[tuple[str, str, dict[str, float], float]] = [
    ("piston_leakage", "flow_a_to_b", {}, drop_with(5.2e-15, 9e5, 4e5)),
    ("valve_leakage", "flow_p_to_a", {}, drop_with(4e-15, 31e5, 9e5)),
    ("valve_leakage", "flow_a_to_tank", {}, drop_with(4e-15, 9e5)),
    ("valve_leakage", "flow_p_to_b", {}, drop_with(4e-15, 31e5, 4e5)),
    ("valve_leakage", "flow_b_to_tank", {}, drop_with(4e-15, 4e5)),
    ("cap_leakage", "flow_a_to_tank", {}, drop_with(5e-15, 9e5)),
    ("rod_leakage", "flow_b_to_outside", {}, drop_with(1e-15, 4e5)),
    ("pump_slip", "flow_p_to_tank", {}, drop_with(3.5e-14, 31e5)),
    ("relief_override", "relief_resistance", {}, 1e9),
    ("line_loss", "line_resistance", {}, 128 * MU * 2.0 / (math.pi * 8e-3**4)),
    ("line_loss", "line_turbulence", {}, 5.0 * RHO / (2 * BORE_AREA**2)),
    ("entrained_air", "compliance", {"pressure": 20e5}, air(20e5)),
    ("entrained_air", "compliance", {"pressure": -0.5e5}, air(-0.5e5)),
    ("hose_compliance", "compliance", {"pressure": 20e5}, 3e-10),
    ("viscous_friction", "friction", {}, 500.0 * MU * 0.07),
    ("coulomb_friction", "friction", {}, 100.0 * 0.25),
    ("stribeck_friction", "friction", {}, stribeck(0.07)),
    ("pressure_friction", "friction", {}, 20e-6 * 13e5 * 0.25),
    ("load_mass", "mass", {}, 20.0),
    ("spring_load", "load", {}, 2e3 * 0.08),
    ("constant_load", "load", {}, 200.0),
    ("valve_open_delay", "valve_delay", {"before": 0.0, "after": 1.0}, 20e-3),
    ("valve_open_delay", "valve_delay", {"before": 0.0, "after": -1.0}, 20e-3),
    ("valve_open_delay", "valve_delay", {"before": 1.0, "after": 0.0}, 0.0),
    ("valve_close_delay", "valve_delay", {"before": 1.0, "after": 0.0}, 20e-3),
    ("valve_close_delay", "valve_delay", {"before": 1.0, "after": -1.0}, 0.0),
    ("valve_delay_thermal", "valve_delay", {"before": 0.0, "after": 1.0}, 1e-3 * 40.0),
    ("valve_delay_thermal", "valve_delay", {"before": 1.0, "after": 0.0}, 0.0),
    ("position_backlash", "position_reading", {}, -0.3e-3 * 0.25),
    ("position_gain", "position_reading", {}, 0.01 * 0.08),
    ("position_offset", "position_reading", {}, 1e-3),
    ("position_thermal_drift", "position_reading", {}, -1e-3 * 40.0 * 0.08),
    ("pressure_gain", "supply_pressure_reading", {}, 0.01 * 31e5),
    ("pressure_offset", "supply_pressure_reading", {}, 0.5e5),
    ("pressure_lag", "supply_pressure_reading", {}, 0.25 * 20.0 / 22.0),
    ("thermocouple_lag", "oil_temperature_reading", {}, 0.25 * 10.0 / 10.2),
    ("thermocouple_offset", "oil_temperature_reading", {}, 1.0),
    ("radiation_loss", "heat", {}, -5.670374419e-8 * (333.15**4 - 295.15**4)),
    ("heater_lag", "heater_power", {}, (0.25 - 1500.0) * 20.0 / 22.0),
    ("wall_heat_capacity", "heat", {}, -2e4 / 120.0 * 0.25),
    ("line_oil_temperature", "line_temperature", {}, -0.2 * (333.15 - 295.15)),
]
FACTORS_BY_HAND: list[tuple[str, str, dict[str, float], float]] = [
    ("relief_thermal_drift", "relief_setting", {}, 1 - 1e-3 * 40.0),
    ("laminar_throttle", "throttle_area", {"reynolds": 400.0}, 400.0 / (400.0 + 100.0)),
    ("flow_area_thermal_drift", "throttle_area", {"reynolds": 400.0}, 1 - 1e-3 * 40.0),
    ("barus", "viscosity", {"pressure": 50e5}, math.exp(2e-8 * 50e5)),
    (
        "modulus_viscosity",
        "viscosity",
        {"pressure": 50e5},
        math.exp(50 / (334 + 3.2557 * 60 + (0.026266 + 0.000315 * 60) * 50)),
    ),
]


def at_typical_size(name: str) -> Scope:
    effect = find_effect(name, FAMILY.name)
    return scope_with(effect, effect.start | {state.name: 0.25 for state in effect.states})


@pytest.mark.parametrize(("name", "slot", "local", "expected"), TERMS_BY_HAND)
def test_terms_equal_hand_calculations(
    name: str, slot: str, local: dict[str, float], expected: float
) -> None:
    assert at_typical_size(name).total(slot, **local) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("name", "slot", "local", "expected"), FACTORS_BY_HAND)
def test_factors_equal_hand_calculations(
    name: str, slot: str, local: dict[str, float], expected: float
) -> None:
    assert at_typical_size(name).factor(slot, **local) == pytest.approx(expected, rel=1e-9)


def test_every_term_has_a_hand_calculation() -> None:
    done = {(name, slot) for name, slot, _, _ in TERMS_BY_HAND + FACTORS_BY_HAND}
    assert done == {(effect.name, slot) for effect in TERMS for slot in effect.slots}


@pytest.mark.parametrize(
    ("name", "lag", "signal"),
    [("pressure_lag", 0.02, "supply_pressure"), ("thermocouple_lag", 10.0, "oil_temperature")],
)
def test_a_ramp_is_read_late_by_the_lag(name: str, lag: float, signal: str) -> None:
    effect = find_effect(name, FAMILY.name)
    rate = scope_with(effect, effect.start | {"deviation": 0.0}).rate(signal)
    # the steady deviation for a signal of constant rate
    resolution = {"pressure_lag": 2e-3, "thermocouple_lag": 0.2}[name]
    settled = -float(rate) * (lag + resolution)
    m = scope_with(effect, {"lag": lag, "deviation": settled})
    assert effect.bind(effect.states[0].rate)(m) == pytest.approx(0.0, abs=1e-6 * abs(float(rate)))
    assert m.total(f"{signal}_reading") == pytest.approx(-float(rate) * lag)


def run(
    effect: Effect, rate_of: Callable[[Scope], float], start: float, steps: int, dt: float, **at: float
) -> float:
    state = effect.states[0]
    value = start
    for _ in range(steps):
        value += dt * rate_of(scope_with(effect, effect.start | {state.name: value}, **at))
    return value


def test_backlash_follows_the_direction_of_motion_and_stays_at_rest() -> None:
    effect = find_effect("position_backlash", FAMILY.name)
    rate = effect.bind(effect.states[0].rate)
    out = run(effect, lambda m: float(rate(m)), -0.5, 400, 1e-4, velocity=0.05)
    assert out == pytest.approx(0.5, abs=0.02)
    assert run(effect, lambda m: float(rate(m)), out, 400, 1e-2, velocity=0.0) == out
    assert run(effect, lambda m: float(rate(m)), out, 400, 1e-4, velocity=-0.05) == pytest.approx(
        -0.5, abs=0.02
    )


@pytest.mark.parametrize("name", ["coulomb_friction", "stribeck_friction", "pressure_friction"])
def test_a_seal_bends_with_the_motion_and_stays_bent_at_rest(name: str) -> None:
    """It bends over its presliding distance of 20 um and stays bent when the piston stops."""
    effect = find_effect(name, FAMILY.name)
    rate = effect.bind(effect.states[0].rate)
    assert effect.states[0].start == -1.0  # a record begins after a retraction

    def bent(start: float, metres: float, velocity: float) -> float:
        dt = 1e-7 / abs(velocity)
        return run(effect, lambda m: float(rate(m)), start, round(metres / 1e-7), dt, velocity=velocity)

    assert bent(0.0, 20e-6, 0.05) == pytest.approx(1.0 - math.exp(-1.0), abs=0.01)
    assert bent(-1.0, 200e-6, 0.05) == pytest.approx(1.0, abs=1e-3)
    assert bent(1.0, 200e-6, -0.05) == pytest.approx(-1.0, abs=1e-3)
    assert run(effect, lambda m: float(rate(m)), 0.7, 100, 1.0, velocity=0.0) == 0.7


def test_heater_lag_and_wall_follow_their_time_constants() -> None:
    heater = find_effect("heater_lag", FAMILY.name)
    rate = heater.bind(heater.states[0].rate)
    assert run(heater, lambda m: float(rate(m)), 0.0, 2200, 0.01) == pytest.approx(
        1500 * (1 - math.exp(-1)), rel=1e-3
    )
    wall = find_effect("wall_heat_capacity", FAMILY.name)
    m = scope_with(wall, wall.start | {"difference": 2.0})
    assert wall.bind(wall.states[0].rate)(m) == pytest.approx(float(m.rate("oil_temperature")) - 2.0 / 120.0)


def test_base_physics_can_be_removed_within_the_bounds_of_its_parameters() -> None:
    for effect in LIBRARY.values():
        for name, nothing in effect.base.items():
            parameter = FAMILY.parameter(name)
            assert parameter.low <= nothing <= parameter.high
            assert nothing != parameter.value
