"""The equations of the oil compared with published tables and known limits."""

from __future__ import annotations

import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.engine.symbols import Graph, dimension_of, evaluate
from rigctl.errors import RigctlError
from rigctl.physics import oil
from rigctl.physics.constants import ATMOSPHERE, ZERO_CELSIUS
from rigctl.physics.oil import HL32
from rigctl.units import parse_unit

# the theoretical columns exactly as printed: every digit counts
PRINTED = (
    (20, "85.19009", "0.073855979"),
    (25, "66.05621", "0.057066616"),
    (30, "52.07592", "0.044830334"),
    (35, "41.67615", "0.035750638"),
    (40, "33.81235", "0.028901952"),
    (45, "27.77659", "0.023658158"),
    (50, "23.08004", "0.019587686"),
    (55, "19.37928", "0.016387891"),
    (60, "16.42916", "0.013843125"),
    (65, "14.05212", "0.011797454"),
    (70, "12.11776", "0.010136569"),
    (75, "10.52912", "0.008775604"),
    (80, "9.213226", "0.007650801"),
)


def rounded_like(value: float, printed: str) -> str:
    return str(Decimal(value).quantize(Decimal(printed)))


@pytest.mark.parametrize(("celsius", "kinematic", "dynamic"), PRINTED)
def test_every_printed_digit_of_the_published_table_is_reproduced(
    celsius: int, kinematic: str, dynamic: str
) -> None:
    temperature = celsius + ZERO_CELSIUS
    assert rounded_like(HL32.dynamic_viscosity(temperature), dynamic) == dynamic
    assert rounded_like(HL32.kinematic_viscosity(temperature) / 1e-6, kinematic) == kinematic


def test_the_three_printed_points_give_their_own_vogel_constants() -> None:
    points = [(20, 7.3856e-2), (40, 2.8900e-2), (100, 4.697e-3)]
    solved = oil.vogel_from_points([(t + ZERO_CELSIUS, mu) for t, mu in points])
    assert solved.a == pytest.approx(3.1132e-5, abs=5e-10)
    assert solved.b == pytest.approx(1132.001, abs=5e-4)
    assert solved.c == pytest.approx(147.4921, abs=5e-5)
    for t, mu in points:
        assert solved.viscosity(t + ZERO_CELSIUS) == pytest.approx(mu, rel=1e-12)


@given(
    a=st.floats(1e-6, 1e-4),
    b=st.floats(300.0, 2000.0),
    c=st.floats(80.0, 220.0),
    start=st.floats(260.0, 320.0),
    gaps=st.tuples(st.floats(10.0, 60.0), st.floats(10.0, 60.0)),
    order=st.permutations([0, 1, 2]),
)
def test_three_points_determine_a_vogel_law(
    a: float, b: float, c: float, start: float, gaps: tuple[float, float], order: list[int]
) -> None:
    temperatures = [start, start + gaps[0], start + sum(gaps)]
    law = oil.VogelConstants(a, b, c)
    solved = oil.vogel_from_points([(temperatures[i], law.viscosity(temperatures[i])) for i in order])
    between = start + 0.5 * gaps[0]
    assert solved.viscosity(between) == pytest.approx(law.viscosity(between), rel=1e-6)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(293.0, 0.07), (313.0, 0.03)], "three constants"),
        ([(293.0, 0.07), (293.0, 0.03), (373.0, 0.005)], "same temperature"),
        ([(293.0, 0.07), (313.0, 0.08), (373.0, 0.005)], "fall as temperature rises"),
        ([(293.0, 0.07), (313.0, 0.03), (373.0, -0.005)], "must be positive"),
        ([(300.0, 0.09), (310.0, 0.08), (320.0, 0.01)], "no Vogel law"),
    ],
)
def test_points_without_a_vogel_law_are_refused(points: list[tuple[float, float]], message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        oil.vogel_from_points(points)


def test_a_temperature_below_the_pole_of_vogels_law_is_refused() -> None:
    with pytest.raises(RigctlError, match="no value at this temperature"):
        HL32.dynamic_viscosity(100.0)


def test_the_misfit_to_the_measured_viscosity_is_relative_and_largest_when_hot() -> None:
    rows = oil.misfit(
        HL32.kinematic_viscosity, [(p.temperature, p.kinematic_measured) for p in oil.published_viscosity()]
    )
    percent = {round(row.temperature - ZERO_CELSIUS): round(100.0 * row.error, 2) for row in rows}
    assert (percent[25], percent[30], percent[70], percent[80]) == (1.73, 2.16, 2.08, 3.11)
    assert oil.largest_misfit(rows).temperature == pytest.approx(353.15)


def test_the_shipped_table_is_complete_in_si_and_consistent() -> None:
    table = oil.published_viscosity()
    assert [round(p.temperature - ZERO_CELSIUS) for p in table] == list(range(20, 85, 5))
    assert table[0].kinematic_measured == pytest.approx(85.19e-6)
    assert table[-1].dynamic_measured == pytest.approx(0.007889)
    # the two measured columns differ by the density, to the printed digits
    for point in table:
        ratio = point.dynamic_measured / point.kinematic_measured
        assert ratio == pytest.approx(HL32.density(point.temperature), rel=3e-4)


def test_density_falls_linearly_with_its_expansion_coefficient() -> None:
    assert HL32.density(288.15) == 870.0
    assert HL32.density(388.15) == pytest.approx(870.0 * 0.93)


def test_pressure_laws_of_viscosity_have_the_values_of_their_sources() -> None:
    # 0.00215 1/bar at 40 degC and low pressure, to be compared with Barus' 0.002
    assert oil.modulus_coefficient(0.0, 313.15, HL32.modulus) * 1e5 == pytest.approx(2.154e-3, rel=1e-3)
    at_300_bar = 1.0 / (334 + 3.2557 * 40 + (0.026266 + 0.000315 * 40) * 300)
    assert oil.modulus_factor(300e5, 313.15, HL32.modulus) == pytest.approx(math.exp(300 * at_300_bar))
    assert oil.barus_factor(100e5, 2e-8) == pytest.approx(math.exp(0.2))
    assert HL32.dynamic_viscosity(313.15, 100e5) == pytest.approx(0.028901952 * math.exp(0.2), rel=1e-7)
    with pytest.raises(RigctlError, match="did you mean 'barus'"):
        HL32.dynamic_viscosity(313.15, law="baruss")


def test_walther_passes_through_its_two_points() -> None:
    a, b = oil.walther_constants(313.15, 33.81e-6, 373.15, 5.7e-6)
    assert oil.walther(313.15, a, b) == pytest.approx(33.81e-6)
    assert oil.walther(373.15, a, b) == pytest.approx(5.7e-6)
    # a mineral oil of VI 100 at 40 and 100 degC is about 88 cSt at 20 degC
    assert 75e-6 < oil.walther(293.15, a, b) < 100e-6


@given(
    pressure=st.floats(0.5e5, 400e5),
    fraction=st.floats(0.0, 0.1),
    exponent=st.floats(1.0, 1.4),
)
def test_the_effective_bulk_modulus_agrees_with_the_derivative_of_the_volume(
    pressure: float, fraction: float, exponent: float
) -> None:
    def volume(p: float) -> float:
        liquid = (1.0 - fraction) * (1.0 - (p - pressure) / 1.4e9)
        return liquid + fraction * (ATMOSPHERE / p) ** (1.0 / exponent)

    step = 1e-4 * pressure
    slope = (volume(pressure + step) - volume(pressure - step)) / (2.0 * step)
    expected = volume(pressure) / -slope
    found = 1.0 / (1.0 / 1.4e9 + oil.air_compliance(pressure, fraction, 1.4e9, exponent))
    assert found == pytest.approx(expected, rel=1e-5)


def test_air_reduces_the_bulk_modulus_and_its_absence_adds_no_compliance() -> None:
    assert oil.air_compliance(20e5, 0.0, 1.4e9) == 0.0
    assert oil.air_compliance(ATMOSPHERE, 0.01, 1.4e9) > 49.0 / 1.4e9


def test_viscosity_laws_accept_arrays_and_expressions() -> None:
    temperatures = np.array([293.15, 313.15, 353.15])
    vogel = HL32.vogel
    curve = oil.vogel(temperatures, vogel.a, vogel.b, vogel.c)  # type: ignore[arg-type]
    np.testing.assert_allclose(
        np.asarray(curve), [HL32.dynamic_viscosity(float(t)) for t in temperatures], rtol=1e-14
    )

    graph = Graph()
    kelvin, pascal_second = parse_unit("K").dimension, parse_unit("Pa*s").dimension
    temperature = graph.variable("T", kelvin)
    a = graph.variable("a", pascal_second)
    law = oil.vogel(temperature, a, graph.constant(vogel.b, kelvin), graph.constant(vogel.c, kelvin))
    assert dimension_of(graph.expression(law)) == pascal_second
    number = evaluate(graph.expression(law), {"T": 313.15, "a": vogel.a})
    assert number == pytest.approx(HL32.dynamic_viscosity(313.15), rel=1e-14)


def test_an_unknown_oil_is_refused_with_the_nearest_name() -> None:
    assert oil.find_oil("hl32") is HL32
    with pytest.raises(RigctlError, match="did you mean 'HL32'"):
        oil.find_oil("HL23")
