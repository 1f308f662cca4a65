"""A law whose fit has become the one that is nested in it is not told from it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.rivals import _nested
from rigctl.engine.least_squares import Unknown

HYSTERESIS: Any = SimpleNamespace(name="hysteresis", becomes=(("distance", 0.0, "coulomb"),))


def fitted(distance: float, std: float, at_bound: bool) -> Any:
    unknowns = (
        Unknown("hysteresis.size", 2.0, 0.0, 10.0),
        Unknown("hysteresis.distance", 1e-3, 1e-7, 1.0),
    )
    return SimpleNamespace(
        problem=SimpleNamespace(shared=unknowns),
        values=np.array([2.0, distance]),
        std={"hysteresis.size": 0.1, "hysteresis.distance": std},
        at_bound=frozenset({"hysteresis.distance"} if at_bound else ()),
    )


@pytest.mark.parametrize(
    ("distance", "std", "at_bound", "nested"),
    [
        (2e-3, 1e-4, False, False),  # a distance of its own
        (2e-3, 4e-3, False, True),  # within chance of none
        (1e-7, 0.0, True, True),  # it wanted to go on towards none, and a bound held it
        (1.0, 0.0, True, False),  # the other bound is no limit
    ],
)
def test_within_chance_of_the_limit_or_stopped_on_the_way_to_it(
    distance: float, std: float, at_bound: bool, nested: bool
) -> None:
    found = _nested(fitted(distance, std, at_bound), HYSTERESIS, "coulomb")
    assert found == ("distance 0" if nested else "")
    assert _nested(fitted(distance, std, at_bound), HYSTERESIS, "stribeck") == ""


def test_a_bound_beside_a_limit_that_lies_inside_says_nothing() -> None:
    power: Any = SimpleNamespace(name="hysteresis", becomes=(("distance", 0.5, "leak"),))
    for bound in (1e-7, 1.0):
        assert _nested(fitted(bound, 0.0, True), power, "leak") == ""
