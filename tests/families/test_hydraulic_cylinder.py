"""The cylinder's equations compared with an independent implementation and with published numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from families.plain_cylinder import PlainCylinder
from rigctl.engine.symbols import Graph
from rigctl.errors import RigctlError
from rigctl.families.hydraulic_cylinder import restrictions
from rigctl.families.hydraulic_cylinder.family import FAMILY as HYDRAULIC_CYLINDER
from rigctl.physics.scope import Addition, Scope
from rigctl.units import parse_unit

FAMILY = HYDRAULIC_CYLINDER
STATES = [state.name for state in FAMILY.states]


def scope(throttle: str = "meter_in", **values: float) -> Scope:
    """The base model on plain numbers."""
    known: dict[str, float] = {p.name: p.value for p in FAMILY.parameters}
    known |= {item.name: item.value for item in FAMILY.inputs}
    known |= {state.name: state.start for state in FAMILY.states}
    return Scope(FAMILY, known | values, options={"throttle": throttle})


def rates(throttle: str = "meter_in", **values: float) -> dict[str, float]:
    m = scope(throttle, **values)
    return {name: float(m.rate(name)) for name in STATES}


def near(a: float, b: float, scale: float) -> bool:
    return abs(a - b) <= 1e-5 * abs(b) + scale


@settings(max_examples=200)
@given(
    temperature=st.floats(5.0, 90.0),
    spool=st.floats(-1.0, 1.0).filter(lambda u: abs(u) > 1e-3),
    pressures=st.tuples(*[st.floats(1e5, 60e5)] * 3),
    position=st.floats(1e-3, 0.249),
    velocity=st.floats(-0.3, 0.3),
    command=st.sampled_from([-1.0, 0.0, 1.0]),
    p_set=st.floats(10e5, 60e5),
    throttle=st.sampled_from(["meter_in", "meter_out", "both"]),
)
def test_every_rate_agrees_with_an_independent_implementation(
    temperature: float,
    spool: float,
    pressures: tuple[float, float, float],
    position: float,
    velocity: float,
    command: float,
    p_set: float,
    throttle: str,
) -> None:
    ps, pa, pb = pressures
    drops = (ps - pa, pa, ps - pb, pb)
    if min(map(abs, drops)) < 2e5:  # there the square root is smoothed
        return
    plain = PlainCylinder(p_set=p_set, heater=1500.0, throttle=throttle)
    expected = plain.rates(np.array([temperature, spool, ps, pa, pb, position, velocity]), command)
    found = rates(
        throttle,
        oil_temperature=temperature + 273.15,
        spool=spool,
        supply_pressure=ps,
        pressure_a=pa,
        pressure_b=pb,
        position=position,
        velocity=velocity,
        valve=command,
        pressure_setpoint=p_set,
        heater_power=1500.0,
    )
    # the relief's corner is rounded over 1e-6 m^3/s, which is 3.5e6 Pa/s of the line
    scales = (1e-9, 1e-9, 4e6, 1e5, 1e5, 1e-12, 0.1)
    for name, reference, scale in zip(STATES, expected, scales, strict=True):
        assert near(found[name], reference, scale), name


def integrate(pressure: float, celsius: float) -> float:
    """The stroke of one timed extension, by SciPy on the family's own equations."""
    y = np.array([celsius + 273.15, 0.0, pressure, 0.0, 0.9 * pressure, 0.0, 0.0])
    for command, duration in ((1.0, 1.05), (0.0, 1.0)):
        inputs = {"valve": command, "pressure_setpoint": pressure}

        def slope(_: float, y: np.ndarray, inputs: Mapping[str, float] = inputs) -> list[float]:
            return list(rates(**dict(zip(STATES, map(float, y), strict=True)), **inputs).values())

        done = solve_ivp(
            slope, (0.0, duration), y, method="Radau", rtol=1e-6, atol=[1e-4, 1e-6, 10, 10, 10, 1e-8, 1e-6]
        )
        assert done.success
        y = done.y[:, -1]
    return float(y[5])


@pytest.mark.parametrize(("bar", "stroke"), [(20, 77.4), (30, 94.9), (40, 109.6), (50, 122.6)])
def test_strokes_agree_with_the_published_bench(bar: int, stroke: float) -> None:
    found = integrate(bar * 1e5, 20.0)
    assert 1e3 * found == pytest.approx(stroke, abs=0.1)
    assert found == pytest.approx(PlainCylinder(p_set=bar * 1e5).stroke(20.0), abs=5e-5)


@pytest.mark.parametrize(("celsius", "percent"), [(60, 1.4), (80, 2.2)])
def test_hot_oil_of_lower_density_gives_a_longer_stroke(celsius: int, percent: float) -> None:
    cold, hot = integrate(30e5, 20.0), integrate(30e5, float(celsius))
    assert 100.0 * (hot / cold - 1.0) == pytest.approx(percent, abs=0.05)


@pytest.mark.parametrize(("bar", "watts"), [(20, 467), (30, 700), (40, 933), (50, 1167)])
def test_the_pump_power_over_the_relief_valve_heats_the_oil(bar: int, watts: int) -> None:
    m = scope(
        supply_pressure=bar * 1e5,
        pressure_setpoint=bar * 1e5,
        oil_temperature=295.15,
        hydromechanical_efficiency=1.0,
    )
    heat = float(m.rate("oil_temperature")) * float(m.heat_capacity)
    assert heat == pytest.approx(watts, abs=0.5)
    assert float(m.supply_pressure * m.flow_relief) == pytest.approx(watts, abs=1.0)


def test_the_heaters_warm_the_oil_by_the_published_rate() -> None:
    heated = scope(heater_power=2000.0, supply_pressure=0.0, pump=0.0, oil_temperature=295.15)
    assert 60.0 * float(heated.rate("oil_temperature")) == pytest.approx(0.9, abs=0.02)


def test_a_stopped_pump_has_no_flow() -> None:
    m = scope(pump=0.0, supply_pressure=5e5)
    assert float(m.flow_from_pump) == pytest.approx(0.0, abs=1e-8)
    slipping = Scope(
        FAMILY,
        {p.name: p.value for p in FAMILY.parameters} | {"pump": 0.0},
        additions=[Addition("flow_p_to_tank", "slip", lambda _: 1e-5)],
    )
    assert float(slipping.flow_from_pump) == pytest.approx(0.0, abs=1e-8)


def test_blocked_ports_pass_a_negligible_flow() -> None:
    m = scope(supply_pressure=50e5, pressure_a=10e5, pressure_b=20e5, spool=0.0)
    flows = (m.flow_supply_to_a, m.flow_supply_to_b, m.flow_a_to_return, m.flow_b_to_return)
    # 1e-11 m^3/s moves a blocked chamber of 60 cm^3 by 2 mbar in a second
    assert max(abs(float(flow)) for flow in flows) < 1e-11


def test_vapour_keeps_the_pressure_above_minus_one_bar() -> None:
    pressure, volume = 0.0, 60e-6
    pulled = 0.0
    while pulled < 8.0 * volume:  # expand the chamber to nine times its volume
        m = scope(pressure_a=pressure, velocity=0.1, position=0.0, spool=0.0)
        step = min(1e-3, 1e3 / abs(float(m.rate("pressure_a"))))
        pressure += step * float(m.rate("pressure_a"))
        pulled += step * 0.1 * float(m.area_a)
    assert -1e5 < pressure < -0.7e5


@given(
    area=st.floats(1e-7, 1e-4),
    drop=st.floats(-100e5, 100e5).filter(lambda dp: abs(dp) > 1e5),
    resistance=st.floats(0.0, 1e12),
    turbulence=st.floats(0.0, 1e16),
)
def test_pressure_drops_of_orifice_and_line_in_series_add_up(
    area: float, drop: float, resistance: float, turbulence: float
) -> None:
    k = restrictions.conductance(0.62, area, 860.0)
    q = abs(float(restrictions.restricted_flow(k, drop, resistance, turbulence)))
    assert q * q / float(k) ** 2 + resistance * q + turbulence * q * q == pytest.approx(abs(drop), rel=1e-4)


def test_the_end_stops_push_back_and_act_nowhere_else() -> None:
    for position, push in ((-20e-6, 4000.0), (0.25 + 20e-6, -4000.0)):
        assert float(scope(position=position).end_stops) == pytest.approx(push, rel=0.01)
    assert abs(float(scope(position=1e-3, velocity=0.1).end_stops)) < 1.0


def test_all_equations_have_the_declared_dimensions() -> None:
    graph = Graph()
    known = {
        item.name: graph.variable(item.name, parse_unit(item.unit).dimension)
        for item in (*FAMILY.states, *FAMILY.inputs, *FAMILY.parameters)
    }
    m = Scope(FAMILY, known)
    from rigctl.engine.symbols import check_dimension

    for definition in FAMILY.definitions:
        check_dimension(
            graph.expression(m[definition.name]), parse_unit(definition.unit).dimension, definition.name
        )
    for output in FAMILY.outputs:
        check_dimension(graph.expression(output.formula(m)), parse_unit(output.unit).dimension, output.name)


def test_a_misspelt_name_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(RigctlError, match="did you mean 'pressure_a'"):
        _ = scope().presure_a
    with pytest.raises(RigctlError, match="did you mean 'meter_in'"):
        _ = scope("meter_on").flow_supply_to_a


def test_a_circular_equation_is_refused_with_its_names() -> None:
    circular = Addition("line_temperature", "mine", lambda m: 1e-3 * m.density)
    m = Scope(
        FAMILY,
        {"oil_temperature": 300.0, "density_15": 870.0, "thermal_expansion": 7e-4},
        additions=[circular],
    )
    with pytest.raises(
        RigctlError, match="density -> line_temperature -> mine at line_temperature -> density"
    ):
        _ = m.density
