"""The heat balance: limits, times, and agreement with a numerical solution."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.families.hydraulic_cylinder.forecast import Tank, tank_of
from rigctl.physics.oil import HL32
from rigctl.rig import load_rig, parse_rig

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"
TANK = Tank(
    fill=0.08, oil=HL32, heater=2000.0, pump_displacement=14e-3 / 60.0 / 0.9, loss=12.0, ambient=295.15
)


def test_the_shipped_rig_has_the_heat_capacity_and_powers_of_its_data() -> None:
    tank = tank_of(load_rig(RIG))
    assert tank is not None
    assert tank.heat_capacity(288.15) == pytest.approx(870.0 * 0.08 * 1900.0)
    assert tank.power(20e5, heating=False) == pytest.approx(466.7 / 0.9, rel=1e-3)
    assert tank.power(50e5, heating=True) == pytest.approx(2000.0 + 1166.7 / 0.9, rel=1e-3)


def test_only_the_declared_share_of_the_pump_power_heats_the_tank() -> None:
    rig = load_rig(RIG)
    cooled = tank_of(rig.model_copy(update={"constants": {**rig.constants, "pump_heat_share": 0.4}}))
    assert cooled is not None
    assert cooled.power(20e5, heating=False) == pytest.approx(0.4 * 466.7 / 0.9, rel=1e-3)


def test_heating_rates_agree_with_the_published_ones() -> None:
    """The heaters give 0.9 K/min; at 50 bar the pump adds 0.5, before its efficiency."""
    adiabatic = Tank(0.08, HL32, 2000.0, 14e-3 / 60.0, 0.0, 295.15)
    minute = adiabatic.after(293.15, 60.0, 0.0, heating=True) - 293.15
    assert minute == pytest.approx(0.9, abs=0.03)
    pump = adiabatic.after(293.15, 60.0, 50e5, heating=False) - 293.15
    assert pump == pytest.approx(0.5, abs=0.04)


@given(st.floats(283.0, 350.0), st.floats(283.0, 350.0), st.floats(0.0, 60e5), st.booleans())
def test_the_time_to_a_temperature_leads_to_that_temperature(
    start: float, target: float, pressure: float, heating: bool
) -> None:
    seconds = TANK.time_to(target, start, pressure, heating)
    limit = TANK.limit(pressure, heating)
    if math.isinf(seconds):
        assert target == limit or (target - start) * (limit - target) <= 0.0
    else:
        assert seconds >= 0.0
        assert TANK.after(start, seconds, pressure, heating) == pytest.approx(target, abs=0.05)


def test_the_heating_time_agrees_with_a_numerical_solution() -> None:
    temperature, step = 293.15, 1.0
    for _ in range(3600):
        power = TANK.power(30e5, heating=True) - TANK.loss * (temperature - TANK.ambient)
        temperature += power * step / TANK.heat_capacity(temperature)
    assert TANK.time_to(temperature, 293.15, 30e5, heating=True) == pytest.approx(3600.0, rel=2e-3)


def test_an_unreachable_temperature_takes_infinite_time() -> None:
    assert TANK.time_to(400.0, 350.0, 0.0, heating=False) == math.inf
    assert TANK.time_to(290.0, 300.0, 0.0, heating=False) == math.inf
    assert TANK.time_to(300.0, 300.0, 0.0, heating=False) == 0.0
    without_loss = Tank(0.08, HL32, 2000.0, 0.0, 0.0, 295.15)
    assert without_loss.time_to(290.0, 300.0, 0.0, heating=True) == math.inf
    assert without_loss.limit(0.0, heating=True) == math.inf
    assert without_loss.limit(0.0, heating=False) == 295.15


@pytest.mark.parametrize("line", ["  tank_fill: 80 l", "    power: 2000 W", "  heat: {actuator: heater"])
def test_a_rig_without_the_data_of_its_tank_has_no_heat_balance(line: str) -> None:
    lines = RIG.read_text(encoding="utf-8").splitlines()
    without = parse_rig("\n".join(text for text in lines if not text.startswith(line)))
    assert tank_of(without) is None
