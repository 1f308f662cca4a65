"""Parameters in everyday units beside SI: a leak of 3.9e-15 m³ is about 0.02 l/min."""

from __future__ import annotations

import math

from rigctl.analysis.diagnosis_result import FoundParameter
from rigctl.effects.declaration import Effect
from rigctl.model.fit.problem import Problem
from rigctl.units import parse_unit, significant

#: N of one kilogram's weight
_WEIGHT = 9.81
#: forces below this are too small for a comparison to help, N
_LEAST_FORCE = 1.0
#: a temperature coefficient is stated per this many kelvins
_WARMER = 10.0


def everyday(effect: Effect, name: str, parameter: FoundParameter, problem: Problem) -> str:
    """The consequence of a parameter, e.g. ``about 0.02 l/min at 50 bar, 60 degC``; "" if its unit suffices.

    The conditions are the highest pressure and the warmest oil of the records.
    """
    unit = parse_unit(parameter.unit)
    value = unit.to_si(parameter.value, difference=True)
    if name == "conductance" and unit.dimension == parse_unit("m^3").dimension:
        return _leak(value, problem)
    if unit.dimension == parse_unit("1/K").dimension and unit.dimension != parse_unit("1").dimension:
        return f"about {significant(100.0 * value * _WARMER, 2)} % for each {_WARMER:g} K"
    if unit.dimension == parse_unit("N").dimension and value > _LEAST_FORCE:
        return f"about the weight of {significant(value / _WEIGHT, 2)} kg"
    return ""


def _leak(conductance: float, problem: Problem) -> str:
    """The flow through a laminar gap, ``Q = k·Δp/µ`` with Vogel's µ of the model's oil."""
    pressure, temperature = (_highest(problem, unit) for unit in ("bar", "degC"))
    values = problem.model.values
    constants = [values.get(name) for name in ("vogel_a", "vogel_b", "vogel_c")]
    if pressure is None or temperature is None or None in constants:
        return ""
    a, b, c = (float(one or 0.0) for one in constants)
    flow = conductance * pressure / (a * math.exp(b / (temperature - c)))
    shown = parse_unit("l/min").from_si(flow)
    text = f"{significant(shown, 2)} l/min"
    if abs(shown) < 1e-3:
        text = f"{significant(parse_unit('ml/min').from_si(flow), 2)} ml/min"
    bar, celsius = parse_unit("bar").from_si(pressure), parse_unit("degC").from_si(temperature)
    return f"about {text} at {bar:.0f} bar, {celsius:.0f} degC"


def _highest(problem: Problem, unit: str) -> float | None:
    """The highest value of any operating variable of that kind, SI; None if the records have none."""
    from rigctl.model.measured.conditions import variable_units

    units, wanted = variable_units(problem.measurements), parse_unit(unit)
    values = [
        value
        for record in problem.records
        for name, value in record.condition.items()
        if parse_unit(units.get(name, "1")).dimension == wanted.dimension
    ]
    return max(values, default=None)
