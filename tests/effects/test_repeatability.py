"""Inputs that are set anew for each record: their errors are relative to the zero of their scale."""

from __future__ import annotations

from typing import Any

import pytest

from rigctl.effects.record_level import record_level
from rigctl.physics.user import parse_family

OVEN = """
family: oven
states:
  probe: {start: 20 degC, scale: 0.1 K, rate: (oven - probe)/lag}
inputs: {oven: {value: 20 degC}, fan: {value: 0 %}}
parameters: {lag: {value: 3 s, bounds: [0.1 s, 100 s]}}
outputs: {probe: {unit: degC, formula: probe}}
"""
CELSIUS = 273.15


def test_an_error_is_a_share_of_the_setting_as_it_is_written() -> None:
    """One percent of 60 degC is 0.6 K, not 3.3 K."""
    family = parse_family(OVEN)
    level = record_level(family).with_repeatability({"oven": (0.01, CELSIUS), "fan": (0.0, 0.0)}, family)
    assert [one.name for one in level.quantities] == ["record.setting_of_oven"]
    assert level.quantities[0].std(None) == 0.01
    assert level.effect is not None
    ((_, term),) = level.effect.terms
    arguments: tuple[Any, Any] = ({"oven": CELSIUS + 60.0}, {"setting_of_oven": 0.01})
    assert term(*arguments) == pytest.approx(0.6)


def test_equal_statements_make_equal_equations() -> None:
    """A system that was compiled for one is used for the other."""
    family = parse_family(OVEN)
    one, other = (
        record_level(family).with_repeatability({"oven": (0.01, CELSIUS)}, family).effect for _ in range(2)
    )
    assert one == other
