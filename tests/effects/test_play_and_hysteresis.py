"""Play and Bouc-Wen hysteresis of the generic library, against simulations by SciPy alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rigctl.effects.registry import check_effect, library
from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation, Ramps
from rigctl.engine.simulate import simulate
from rigctl.model.build import build_system
from rigctl.physics.family import ModelFamily
from rigctl.physics.user import parse_family

Floats = NDArray[np.float64]
Values = dict[str, float]

STATIC = """
family: NAME
inputs: {u: {value: 0 UNIT}}
parameters:
  gain: {value: 2 N/(UNIT), bounds: [-10 N/(UNIT), 10 N/(UNIT)]}
slots:
  u_input: {unit: UNIT}
  force_reading: {unit: N, kind: sensor}
outputs:
  force: {unit: N, formula: gain*(u + u_input) + force_reading}
standard_record:
  duration: 4 s
  rate: 100 Hz
  switches: [{at: 0 s, set: {u: 1 UNIT}}]
"""
TIMES = np.arange(1601) * 0.0025


def family(unit: str, name: str) -> ModelFamily:
    return parse_family(STATIC.replace("NAME", name).replace("UNIT", unit))


def line(t: Floats) -> Floats:
    return np.asarray(np.sin(2.0 * t) * (1.0 + 0.4 * t))


def slope(t: float) -> float:
    return float(2.0 * np.cos(2.0 * t) * (1.0 + 0.4 * t) + 0.4 * np.sin(2.0 * t))


def force(chosen: ModelFamily, effect: str, values: Values) -> Floats:
    """The force over `TIMES` under `line`, by rigctl."""
    compiled = compile_system(build_system(chosen, {effect: values}))
    system = compiled.system
    starts = {f"{effect}.{state.name}": state.start for state in library(chosen)[effect].states}
    record = Excitation(
        TIMES,
        np.zeros(1),
        np.zeros((1, 1)),
        np.array([starts[name] for name in system.state_names]),
        np.array(system.nominal),
        "back and forth",
        ramps=Ramps(np.array([0]), TIMES, line(TIMES)[:, None]),
    )
    return np.asarray(simulate(compiled, [record]).require().outputs[0][:, 0])


def bending(rate: Callable[[float], float], distance: float, first: float) -> Floats:
    """z of ``dz/dt = (rate − |rate|·z)/distance``."""

    def change(t: float, z: Floats) -> Floats:
        return np.asarray((rate(t) - abs(rate(t)) * z) / distance)

    found = solve_ivp(change, (0.0, TIMES[-1]), [first], t_eval=TIMES, rtol=1e-8, atol=1e-10, max_step=0.01)
    return np.asarray(found.y[0])


def test_play_of_an_input_is_the_play_operator() -> None:
    """z stays within half the play of u and moves only when pushed: exact from sample to sample."""
    u, z = line(TIMES), np.zeros(TIMES.size)
    for k in range(1, TIMES.size):
        z[k] = min(max(z[k - 1], u[k] - 0.3), u[k] + 0.3)
    found = force(family("m", "play"), "backlash_of_u", {"share": 1.0, "limit": 0.3})
    np.testing.assert_allclose(found, 2.0 * z, atol=0.02 * np.ptp(z))


def test_hysteresis_over_a_position_is_bouc_wens() -> None:
    found = force(
        family("m", "seal"), "hysteresis_of_force_with_u", {"size": 5.0, "distance": 0.1, "side": 0.0}
    )
    expected = 2.0 * line(TIMES) + 5.0 * bending(slope, 0.1, 0.0)
    np.testing.assert_allclose(found, expected, atol=0.01 * np.ptp(expected))


@pytest.mark.parametrize("side", [0.0, -0.7])
def test_hysteresis_over_a_speed_follows_the_path_that_it_covers(side: float) -> None:
    """A damper: the force depends on the path, of which only the speed is measured."""
    values = {"size": 5.0, "distance": 0.1, "side": side}
    found = force(family("m/s", "damper"), "hysteresis_of_force_with_u", values)
    expected = 2.0 * line(TIMES) + 5.0 * bending(lambda t: float(line(np.array(t))), 0.1, side)
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_a_static_family_with_a_record_over_time_has_lag_play_and_hysteresis() -> None:
    known = library(family("m/s", "damper"))
    wanted = {"lag_of_u", "backlash_of_u", "hysteresis_of_force_with_u", "dead_band_of_u", "drift_of_force"}
    assert wanted <= set(known)
    for effect in known.values():
        check_effect(effect)
    table = STATIC.partition("standard_record")[0].replace("NAME", "rows").replace("UNIT", "m/s")
    assert not [effect.name for effect in library(parse_family(table)).values() if effect.states]
