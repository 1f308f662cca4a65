"""Derivatives that are inaccurate in one record of many."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.system import SystemBuilder
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.engine.trajectories import Trajectories
from rigctl.model.fit import slopes
from rigctl.model.fit.slopes import beyond_the_others, simulate_soundly

EQUATIONS: Any = SimpleNamespace(cascade=None)  #: a system without programs


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
    """Slopes of two columns, whose size varies between records as with a viscosity."""
    return [np.full((5, 1, 2), [1.0 + 4.0 * k, 1e6 / (1.0 + k)]) for k in range(count)]


def beyond(found: Sequence[np.ndarray]) -> list[int]:
    return list(beyond_the_others(trajectories(found)))


def test_a_record_with_far_larger_derivatives_in_several_columns_is_suspect() -> None:
    found = sound()
    assert beyond(found) == []
    found[2][3] *= 1e4
    assert beyond(found) == [2]
    found[4][1] = np.nan
    assert beyond(found) == [2, 4]


def test_large_derivatives_in_a_single_column_are_not_suspect() -> None:
    found = sound()
    for record in found:
        record[:, :, 0] *= 1e-9
    found[3][:, :, 0] = 1.0
    assert beyond(found) == []


def test_three_records_are_too_few_to_suspect_one() -> None:
    found = sound(3)
    found[1] *= 1e6
    assert beyond(found) == []


def in_doubt(
    monkeypatch: pytest.MonkeyPatch, made: Callable[[int, Tolerance], np.ndarray]
) -> tuple[Trajectories, list[tuple[list[int], Tolerance]]]:
    """The result of `simulate_soundly` on six records whose integration gives `made`, and its requests."""
    asked = []

    def integrate(_: object, records: Sequence[int], *, tolerance: Tolerance = DEFAULT, **__: object) -> Any:
        asked.append((list(records), tolerance))
        return trajectories([made(record, tolerance) for record in records])

    monkeypatch.setattr(slopes, "simulate", integrate)
    return simulate_soundly(EQUATIONS, cast("Any", range(6)), ("a", "b"), ()), asked


@pytest.mark.parametrize("share", [1e6, 1e3, np.nan])
def test_inaccurate_derivatives_are_replaced_by_those_of_a_tight_integration(
    monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """Whether the finer steps give derivatives as inaccurate, less so, or NaN."""

    def made(record: int, tolerance: Tolerance) -> np.ndarray:
        wrong = {DEFAULT: -1e5, TIGHT: 1.0}.get(tolerance, share)
        return sound()[record] * (wrong if record == 2 else 1.0)

    found, asked = in_doubt(monkeypatch, made)
    np.testing.assert_array_equal(found.sensitivities[5], sound()[5])
    assert asked == [
        ([0, 1, 2, 3, 4, 5], DEFAULT)
    ]  # a rejected step needs no derivatives: nothing more is computed
    for _ in range(2):
        for slope, right in zip(found.sensitivities, sound(), strict=True):
            np.testing.assert_array_equal(slope, right)
    assert [records for records, _ in asked] == [[0, 1, 2, 3, 4, 5], [2], [2]]
    assert asked[1][1].relative < DEFAULT.relative
    assert asked[2][1] == TIGHT
    for slope, right in zip(found.sensitivities[1:-1], sound()[1:-1], strict=True):
        np.testing.assert_array_equal(slope, right)


def test_large_derivatives_confirmed_by_finer_steps_are_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def made(record: int, tolerance: Tolerance) -> np.ndarray:
        large = 1e5 if tolerance is DEFAULT else 0.8e5
        return sound()[record] * (large if record == 2 else 1.0)

    found, asked = in_doubt(monkeypatch, made)
    np.testing.assert_array_equal(found.sensitivities[2], 0.8e5 * sound()[2])
    assert [records for records, _ in asked] == [[0, 1, 2, 3, 4, 5], [2]]


def test_the_large_derivatives_of_an_undamped_oscillation_are_accurate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Five records of an overdamped oscillator and one with hardly any damping, where stiffness and damping
    shift the phase of every period."""
    builder = SystemBuilder()
    x, v = builder.state("x", "m", scale=1e-4), builder.state("v", "m/s", scale=1e-2)
    u = builder.input("u", "m/s^2")
    stiffness = builder.parameter("stiffness", "1/s^2", 1e4)
    damping = builder.parameter("damping", "1/s", 1e4)
    builder.equation("x", v)
    builder.equation("v", u - stiffness * x - damping * v)
    builder.output("x", "m", x)
    times = np.arange(501) * 0.01
    records = [
        Excitation(times, [0.0], [[100.0]], [0.0, 0.0], [1e4, rate], f"damped by {rate:g}/s")
        for rate in (9e3, 1e4, 1.1e4, 1.2e4, 1.3e4, 0.05)
    ]
    compiled = compile_system(builder.build())
    tolerances = []

    def counted(*arguments: Any, **named: Any) -> Trajectories:
        tolerances.append(named.get("tolerance", DEFAULT))
        return simulate(*arguments, **named)

    monkeypatch.setattr(slopes, "simulate", counted)
    found = simulate_soundly(compiled, records, ("stiffness", "damping"), ())
    by_stiffness = found.sensitivities[5][:, 0, 0]
    assert len(tolerances) == 2
    assert TIGHT not in tolerances
    # x = u/k·(1 − e^(−dt/2)·(cos wt + d/(2w)·sin wt)), w² = k − d²/4, by central differences of it
    wanted = (_swing(times, 1e4 + 1.0) - _swing(times, 1e4 - 1.0)) / 2.0
    assert np.linalg.norm(by_stiffness - wanted) < 0.1 * np.linalg.norm(wanted)


def _swing(times: np.ndarray, stiffness: float, damping: float = 0.05, push: float = 100.0) -> np.ndarray:
    w = math.sqrt(stiffness - damping**2 / 4.0)
    ringing = np.cos(w * times) + damping / (2.0 * w) * np.sin(w * times)
    return push / stiffness * (1.0 - np.exp(-damping * times / 2.0) * ringing)
