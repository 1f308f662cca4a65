"""The viscosity table and its effects, compared with hand calculations."""

from __future__ import annotations

import math

import pytest

from rigctl.effects import find_effect, qualified
from rigctl.families.oil_viscosity.family import FAMILY as OIL_VISCOSITY
from rigctl.physics import oil
from rigctl.physics.scope import Scope


def scope(effect: str | None = None, celsius: float = 60.0, bar: float = 0.0, **values: float) -> Scope:
    known = {p.name: p.value for p in OIL_VISCOSITY.parameters}
    known |= {"oil_temperature": celsius + 273.15, "pressure": bar * 1e5}
    additions = []
    if effect is not None:
        declared = find_effect(effect, "oil_viscosity")
        known |= {qualified(effect, name): value for name, value in (declared.start | values).items()}
        additions = declared.additions()
    return Scope(OIL_VISCOSITY, known, additions=additions)


def read(name: str, m: Scope) -> float:
    return float(next(output for output in OIL_VISCOSITY.outputs if output.name == name).formula(m))


def test_vogels_law_reproduces_the_printed_table() -> None:
    for celsius, printed in ((20.0, 85.19009), (60.0, 16.42916), (80.0, 9.213226)):
        assert read("kinematic_viscosity", scope(celsius=celsius)) / 1e-6 == pytest.approx(printed, abs=5e-6)


def test_pressure_raises_the_viscosity_by_barus_and_by_the_modulus_law() -> None:
    base = read("dynamic_viscosity", scope())
    assert read("dynamic_viscosity", scope("barus", bar=200.0)) == pytest.approx(
        base * math.exp(2e-8 * 200e5)
    )
    modulus = math.exp(200 / (334 + 3.2557 * 60 + (0.026266 + 0.000315 * 60) * 200))
    assert read("dynamic_viscosity", scope("modulus_viscosity", bar=200.0)) == pytest.approx(base * modulus)


def test_walthers_law_replaces_vogels() -> None:
    a, b = oil.walther_constants(313.15, 33.81e-6, 373.15, 5.74e-6)
    for celsius in (20.0, 60.0, 100.0):
        expected = oil.walther(celsius + 273.15, a, b)
        assert read("kinematic_viscosity", scope("walther", celsius=celsius)) == pytest.approx(expected)
    half = read("kinematic_viscosity", scope("walther", share=0.5))
    whole, none = read("kinematic_viscosity", scope("walther")), read("kinematic_viscosity", scope())
    assert half == pytest.approx(math.sqrt(whole * none))


def test_density_curvature_equals_its_formula() -> None:
    assert read("density", scope("density_curvature")) == pytest.approx(
        870 * (1 - 7e-4 * 45) * (1 - 3e-7 * 45**2)
    )


def test_the_end_correction_is_the_inverse_of_the_viscometer_formula() -> None:
    # the true viscosity is nu = k*t - c/t, the reading k*t
    constant, correction = 0.03e-6, 1e-12 / 0.03e-6
    reading = read("kinematic_viscosity", scope("capillary_end_correction", celsius=80.0))
    time = reading / constant
    true = constant * time - correction / time
    assert true == pytest.approx(read("kinematic_viscosity", scope(celsius=80.0)))
    assert reading > true


def test_an_oil_colder_than_its_thermometer_reads_more_viscous() -> None:
    colder = read("kinematic_viscosity", scope("thermometer_offset", offset=-2.0))
    assert colder == pytest.approx(read("kinematic_viscosity", scope(celsius=58.0)))
