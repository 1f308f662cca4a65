"""Laws that differ from those of the library: the shape tolerance keeps name, location and driver right."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.linear.shape_tolerance import FUNCTIONS, knots_of, prior_root
from rigctl.analysis.search.identity import levels_of, only_constants, same_cause, wanted_elsewhere
from rigctl.effects.declaration import Effect
from rigctl.effects.registry import find_effect

FAMILY = "hydraulic_cylinder"


def test_knots_are_dense_where_the_data_are() -> None:
    at_rest_mostly = np.concatenate([np.zeros(900), np.linspace(-1.0, 1.0, 100)])
    knots = knots_of([at_rest_mostly])
    assert knots is not None
    assert knots.size == FUNCTIONS + 4
    assert np.all(np.diff(knots) > 0.0)
    inner = knots[4:-4]
    assert np.all(np.abs(inner) < 0.2)  # most of them about standstill
    assert knots_of([np.full(50, 3.0)]) is None


def test_the_prior_is_smooth_and_of_unit_size() -> None:
    root = prior_root()
    covariance = root @ root.T
    assert np.diag(covariance) == pytest.approx(1.0, abs=1e-6)
    assert covariance[0, 1] > 0.7
    assert abs(covariance[0, -1]) < 1e-3


def test_laws_of_one_cause_share_location_and_driver() -> None:
    coulomb, stribeck, viscous, spring = (
        find_effect(f"{name}", FAMILY)
        for name in ("coulomb_friction", "stribeck_friction", "viscous_friction", "spring_load")
    )
    assert same_cause(coulomb, stribeck)
    assert not same_cause(coulomb, viscous)  # viscous friction also depends on the temperature
    assert not same_cause(coulomb, spring)


def level(classes: list[str], *, sure: bool = True, other_shape: bool = False) -> tuple[bool, bool, bool]:
    effects: dict[str, Effect] = {name: find_effect(name, FAMILY) for name in classes}
    (found,) = levels_of([classes], effects, sure=sure, other_shape=other_shape)
    return found.place_sure, found.driver_sure, found.law_sure


def test_a_level_is_claimed_only_if_the_whole_class_agrees_on_it() -> None:
    assert level(["coulomb_friction"]) == (True, True, True)
    assert level(["coulomb_friction"], other_shape=True) == (True, True, False)
    assert level(["coulomb_friction", "stribeck_friction"]) == (True, True, False)
    assert level(["coulomb_friction", "viscous_friction"]) == (True, False, False)
    assert level(["coulomb_friction", "spring_load"]) == (False, False, False)
    assert level(["coulomb_friction"], sure=False) == (False, False, False)


def test_remainders_unusual_sizes_and_constants_withdraw_levels_of_an_answer() -> None:
    effects: dict[str, Effect] = {
        name: find_effect(name, FAMILY) for name in ("spring_load", "constant_load", "pump_slip")
    }

    def levels(name: str, **known: object) -> tuple[bool, bool, bool]:
        (one,) = levels_of([[name]], effects, sure=True, other_shape=False, **known)
        return one.place_sure, one.driver_sure, one.law_sure

    assert levels("spring_load", complete=False) == (True, True, False)
    assert levels("spring_load", usual=False) == (True, True, False)  # another law may do it at a usual size
    assert levels("spring_load", constant={"spring_load": ["position"]}) == (True, False, True)
    assert levels("spring_load", constant={"spring_load": []}) == (True, True, True)
    assert levels("constant_load", complete=False) == (
        True,
        False,
        False,
    )  # the remainder may not be constant
    steady = levels("constant_load", complete=False, steady=["constant_load"])
    assert steady == (True, True, False)  # it is how its size scatters
    assert levels("constant_load", varying=["constant_load"]) == (True, False, True)
    drifts = [effects["spring_load"], effects["constant_load"]]
    assert wanted_elsewhere(drifts, "flow_p_to_tank")
    assert not wanted_elsewhere(drifts, "load")
    assert not wanted_elsewhere(drifts, "")
    assert not wanted_elsewhere([effects["spring_load"]], "flow_p_to_tank")
    offset = find_effect("position_offset", FAMILY)
    assert only_constants([effects["constant_load"], offset])
    assert not only_constants(drifts)
    assert not only_constants([offset])  # a single one is judged by its law
