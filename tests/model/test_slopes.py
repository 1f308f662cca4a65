"""Derivatives that an integration has spoilt in one record of many."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.engine.trajectories import Trajectories
from rigctl.model.fit import slopes
from rigctl.model.fit.slopes import simulate_soundly, spoilt_records


def trajectories(sensitivities: Sequence[np.ndarray]) -> Trajectories:
    """Records of five samples and one output."""
    count = len(sensitivities)
    nothing = tuple(np.zeros((5, 1)) for _ in range(count))
    return Trajectories(
        names=tuple(f"record {k}" for k in range(count)),
        times=tuple(np.arange(5.0) for _ in range(count)),
        states=nothing,
        outputs=nothing,
        sensitivities=tuple(sensitivities),
        failures=(None,) * count,
        state_names=("x",),
        output_names=("x",),
        columns=("a", "b"),
        stats=tuple(cast("Any", SimpleNamespace()) for _ in range(count)),
    )


def sound(count: int = 6) -> list[np.ndarray]:
    """Slopes of two columns, whose size differs between records as that of a viscosity does."""
    return [np.full((5, 1, 2), [1.0 + 4.0 * k, 1e6 / (1.0 + k)]) for k in range(count)]


def test_a_record_far_beyond_the_others_in_several_columns_is_spoilt() -> None:
    found = sound()
    assert spoilt_records(trajectories(found)) == []
    found[2][3] *= 1e4
    assert spoilt_records(trajectories(found)) == [2]
    found[4][1] = np.nan
    assert spoilt_records(trajectories(found)) == [2, 4]


def test_an_effect_that_acts_in_few_records_is_not() -> None:
    found = sound()
    for record in found:
        record[:, :, 0] *= 1e-9
    found[3][:, :, 0] = 1.0
    assert spoilt_records(trajectories(found)) == []


def test_few_records_tell_nothing_of_one_another() -> None:
    found = sound(3)
    found[1] *= 1e6
    assert spoilt_records(trajectories(found)) == []


def test_spoilt_derivatives_are_those_of_a_tight_integration_and_the_outputs_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def integrate(_: object, records: Sequence[int], *, tolerance: Tolerance = DEFAULT, **__: object) -> Any:
        asked.append((list(records), tolerance))
        made = [sound()[record] for record in records]
        if tolerance is DEFAULT:
            made[2] = made[2] * 1e5
        return trajectories(made)

    monkeypatch.setattr(slopes, "simulate", integrate)
    found = simulate_soundly(cast("Any", None), cast("Any", range(6)), ("a", "b"), ())
    np.testing.assert_array_equal(found.sensitivities[5], sound()[5])
    assert asked == [([0, 1, 2, 3, 4, 5], DEFAULT)]  # of a step that is taken back nobody asks for more
    for _ in range(2):
        for slope, right in zip(found.sensitivities, sound(), strict=True):
            np.testing.assert_array_equal(slope, right)
    assert asked == [([0, 1, 2, 3, 4, 5], DEFAULT), ([2], TIGHT)]
    for slope, right in zip(found.sensitivities[1:-1], sound()[1:-1], strict=True):
        np.testing.assert_array_equal(slope, right)
