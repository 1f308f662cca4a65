"""Whether a term dissipates energy of a state, relative to whatever the family counts the state from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.linear.shape_tolerance import courses
from rigctl.discovery.formulas import Factor, Formula
from rigctl.discovery.grammar import argument, forms
from rigctl.discovery.passivity import passivity
from rigctl.effects.drivers import Driver
from rigctl.physics.family import ModelFamily
from rigctl.physics.user import parse_family

LINE = """\
family: air_line
title: Volume on a compressed-air line
states:
  pressure: {{start: 1.2 bar, scale: 50 mbar, rate: (gain*inflow + leak)/volume}}
inputs:
  inflow: {{value: 0 bar}}
  {given}
parameters:
  gain: {{value: 1 l/s, bounds: [0.01 l/s, 100 l/s]}}
constants:
  volume: 10 l
  {constant}
slots:
  leak: {{unit: bar*l/s}}
outputs:
  pressure: {{unit: bar, formula: pressure + 0*atmosphere}}
"""
AS_CONSTANT = {"given": "", "constant": "atmosphere: 1.013 bar"}
AS_INPUT = {"given": "atmosphere: {value: 1.013 bar}", "constant": ""}
COURSE = np.linspace(1.2e5, 8e5, 50)


def opened_at(family: ModelFamily, **values: float) -> Any:
    """The attributes of opened slots that are read: one record of a rising pressure."""
    names = tuple(one.name for one in family.inputs)
    record = SimpleNamespace(
        times=np.arange(50.0), input_course=lambda k: np.full(50, {"atmosphere": 1.013e5}.get(names[k], 0.0))
    )
    system = SimpleNamespace(state_names=("pressure",), input_names=names)
    problem = SimpleNamespace(
        model=SimpleNamespace(family=family, values=values),
        compiled=SimpleNamespace(system=system),
        records=[record],
    )
    simulated = SimpleNamespace(states=[COURSE[:, None]])
    seen = SimpleNamespace(problem=problem, trajectories=simulated)
    seen.values = lambda driver: np.concatenate(courses(problem, simulated, driver))
    return seen


def leak(family: ModelFamily, size: float) -> Formula:
    """A flow that grows with the pressure."""
    own = argument(Driver((("pressure", 1.0),), "Pa"), 1.2e5, 8e5, family)
    low, high = (float(end) for end in own.of(np.array([own.low, own.high])))
    one = next(form for form in forms(low, high) if form.name == "linear")
    return Formula(family.slot("leak"), (Factor(own, one, one.starts[0]),), gain=1.0, size=size, cost=0.0)


@pytest.mark.parametrize("where", [AS_CONSTANT, AS_INPUT], ids=["constant", "input"])
def test_a_leak_to_a_surrounding_pressure_takes_energy_out(where: dict[str, str]) -> None:
    """A surrounding that no channel reads is as good as a measured one."""
    family = parse_family(LINE.format(**where))
    opened = opened_at(family)
    assert passivity(leak(family, -3.0), opened) == "dissipates energy"
    assert passivity(leak(family, 3.0), opened) == "supplies energy"


def test_the_surroundings_have_the_value_of_the_model_and_not_of_the_family() -> None:
    family = parse_family(LINE.format(**AS_CONSTANT))
    assert passivity(leak(family, -3.0), opened_at(family, atmosphere=9e5)) == "supplies energy"
