"""The two-heater board and its effects, compared with hand calculations."""

from __future__ import annotations

import math

import pytest

from rigctl.effects import find_effect, qualified
from rigctl.families.heater_board.family import FAMILY as HEATER_BOARD
from rigctl.physics.scope import Scope

POINT = {
    "temperature_1": 340.0,
    "temperature_2": 310.0,
    "heater_1": 0.6,
    "heater_2": 0.1,
    "ambient_temperature": 296.0,
}
SIGMA = 5.670374419e-8


def scope(effect: str | None = None, **states: float) -> Scope:
    known = {p.name: p.value for p in HEATER_BOARD.parameters} | POINT
    additions = []
    if effect is not None:
        declared = find_effect(effect, "heater_board")
        own = declared.start | states
        known |= {qualified(effect, name): value for name, value in own.items()}
        additions = declared.additions()
    return Scope(HEATER_BOARD, known, additions=additions)


def heats(effect: str, **states: float) -> tuple[float, float]:
    """The contribution of an effect to the heat balance of each heater, W."""
    base, more = scope(), scope(effect, **states)
    return tuple(
        2.0 * (float(more.rate(name)) - float(base.rate(name))) for name in ("temperature_1", "temperature_2")
    )


def test_each_heater_is_one_lumped_capacity() -> None:
    m = scope()
    assert m.rate("temperature_1") == pytest.approx((0.6 * 1.0 - 0.012 * 44.0) / 2.0)
    assert m.rate("temperature_2") == pytest.approx((0.1 * 1.0 - 0.012 * 14.0) / 2.0)


def test_radiation_follows_the_stefan_boltzmann_law() -> None:
    expected = [-9e-4 * SIGMA * (t**4 - 296.0**4) for t in (340.0, 310.0)]
    assert heats("radiation") == pytest.approx(expected)


def test_coupling_transfers_heat_between_the_heaters() -> None:
    one, other = heats("heater_coupling")
    assert other == pytest.approx(2e-3 * 30.0 + 2e-4 * SIGMA * (340.0**4 - 310.0**4))
    assert one == pytest.approx(-other)


def test_power_law_convection_equals_its_formula() -> None:
    expected = [-0.012 * d * ((d / 30.0) ** 0.25 - 1.0) for d in (44.0, 14.0)]
    assert heats("power_law_convection") == pytest.approx(expected, rel=1e-4)


def test_a_nonlinear_heater_equals_its_formula() -> None:
    assert heats("heater_nonlinearity") == pytest.approx([0.6 * 0.1 * 0.4, 0.1 * 0.1 * 0.9])


def test_lags_wall_capacity_and_ambient_drift_equal_their_formulas() -> None:
    assert heats("heater_lag", element_1=0.2, element_2=0.1) == pytest.approx([-0.4 * 10.0 / 10.5, 0.0])
    assert heats("wall_heat_capacity", difference_1=3.0, difference_2=-1.0) == pytest.approx(
        [-3.0 / 60.0, 1.0 / 60.0]
    )
    assert heats("ambient_drift", elapsed=1800.0) == pytest.approx([0.012 * 0.5] * 2)
    lagged = scope("sensor_lag", deviation_1=-2.0, deviation_2=0.0)
    assert lagged.total("temperature_1_reading") == pytest.approx(-2.0 * 20.0 / 20.5)
    rate = find_effect("sensor_lag", "heater_board")
    slope = rate.bind(rate.states[0].rate)(lagged)
    assert slope == pytest.approx(2.0 / 20.5 - float(lagged.rate("temperature_1")))


def test_a_heater_follows_a_step_with_one_time_constant() -> None:
    # full power: 1 W over 0.012 W/K, with the time constant 2 J/K over 0.012 W/K
    temperature, dt = 296.0, 0.05
    for _ in range(int(2.0 / 0.012 / dt)):
        known = {p.name: p.value for p in HEATER_BOARD.parameters} | POINT
        m = Scope(HEATER_BOARD, known | {"temperature_1": temperature, "heater_1": 1.0})
        temperature += dt * float(m.rate("temperature_1"))
    assert temperature - 296.0 == pytest.approx(1.0 / 0.012 * (1.0 - math.exp(-1.0)), rel=1e-3)
