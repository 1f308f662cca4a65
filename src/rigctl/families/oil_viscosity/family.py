"""The declaration of the viscosity table."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar
from rigctl.physics import oil
from rigctl.physics.family import Definition, InputVariable, ModelFamily, OutputVariable, Slot
from rigctl.physics.family import ParameterDeclaration as Parameter
from rigctl.physics.oil import HL32
from rigctl.physics.scope import Scope
from rigctl.physics.standard_record import StandardRecord, grid


def temperature(m: Scope) -> Scalar:
    """Temperature of the oil in the viscometer."""
    return m.oil_temperature + m.total("temperature")


def density(m: Scope) -> Scalar:
    """Density at atmospheric pressure, in kg/m^3."""
    base = oil.density(m.temperature, m.density_15, m.thermal_expansion)
    return base * m.factor("density")


def dynamic_viscosity(m: Scope) -> Scalar:
    """Vogel's law times the factors of effects, in Pa*s."""
    return oil.vogel(m.temperature, m.vogel_a, m.vogel_b, m.vogel_c) * m.factor("viscosity")


def true_kinematic(m: Scope) -> Scalar:
    """``nu = mu / rho``, in m^2/s, at the pressure of the row."""
    return oil.kinematic_viscosity(m.true_dynamic_viscosity, m.true_density)


def kinematic_reading(m: Scope) -> Scalar:
    """Kinematic viscosity read by the viscometer: the true value plus the terms of effects."""
    return m.true_kinematic_viscosity + m.total("kinematic_viscosity_reading")


_TEMPERATURES = tuple(273.15 + 5.0 * index for index in range(21))
_PRESSURES = (0.0, 300e5)

#: neither bound is physical
_USUAL = (True, True)

#: each row of the table lasts a second and is read in the middle of it
STANDARD_RECORD = StandardRecord(
    "0 to 100 degC in steps of 5, at 0 and then at 300 bar, a row each second",
    times=grid(len(_TEMPERATURES) * len(_PRESSURES) - 0.5, 1.0, 0.5),
    switches=tuple(
        (float(row), {"oil_temperature": temperature, "pressure": pressure})
        for row, (pressure, temperature) in enumerate((p, t) for p in _PRESSURES for t in _TEMPERATURES)
    ),
)

FAMILY = ModelFamily(
    name="oil_viscosity",
    title="Viscosity of an oil over temperature and pressure",
    source="Vogel (1921); density by thermal expansion",
    states=(),
    inputs=(
        InputVariable("oil_temperature", "K", 313.15, "as the thermometer reads"),
        InputVariable("pressure", "Pa", 0.0, "gauge"),
    ),
    parameters=(
        Parameter("vogel_a", "Pa*s", HL32.vogel.a, "a of Vogel's law", 1e-7, 1e-2, usual=_USUAL),
        Parameter("vogel_b", "K", HL32.vogel.b, "b of Vogel's law", 100.0, 5e3, usual=_USUAL),
        Parameter("vogel_c", "K", HL32.vogel.c, "c of Vogel's law", 50.0, 260.0, usual=(True, False)),
        Parameter("density_15", "kg/m^3", HL32.density_15, "density at 15 degC", 500.0, 1500.0, usual=_USUAL),
        Parameter(
            "thermal_expansion", "1/K", HL32.thermal_expansion, "alpha_v", 0.0, 3e-3, usual=(False, True)
        ),
    ),
    definitions=(
        Definition("temperature", "K", temperature, "oil in the viscometer"),
        Definition("true_density", "kg/m^3", density, "at atmospheric pressure"),
        Definition("true_dynamic_viscosity", "Pa*s", dynamic_viscosity, "at the pressure"),
        Definition("true_kinematic_viscosity", "m^2/s", true_kinematic, "at the pressure"),
    ),
    slots=(
        Slot("temperature", "K", "of the oil, above what the thermometer reads", kind="sensor"),
        Slot("density", "1", "of the linear law", combine="product"),
        Slot("viscosity", "1", "of Vogel's law", combine="product"),
        Slot("kinematic_viscosity_reading", "m^2/s", "of the viscometer, beside the truth", kind="sensor"),
    ),
    outputs=(
        OutputVariable("kinematic_viscosity", "m^2/s", kinematic_reading, "viscometer"),
        OutputVariable("dynamic_viscosity", "Pa*s", lambda m: m.true_dynamic_viscosity, "worked out with it"),
        OutputVariable("density", "kg/m^3", lambda m: m.true_density, "hydrometer"),
    ),
    standard_record=STANDARD_RECORD,
    generic=False,
)
