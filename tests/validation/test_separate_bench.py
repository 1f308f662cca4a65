"""The separate bench compared with SciPy and published numbers: rigctl is tested against it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigctl_validation.bench import equations, rosenbrock
from rigctl_validation.bench.campaign import Campaign, Scatter, simulate_campaign
from rigctl_validation.bench.compiled import compiled, folder_of
from rigctl_validation.bench.parameters import BenchParameters, Sensors, Switching
from rigctl_validation.bench.record import STANDARD, Condition, initial_state, simulate_record
from rigctl_validation.bench.sensing import Noise, coloured, play

STROKES = {20.0: 77.4, 30.0: 94.9, 40.0: 109.6, 50.0: 122.6}  # mm at 20 degC, an independent calculation


def stroke(pressure: float, oil: float = 20.0, **secrets: float) -> float:
    """Stroke of a standard record in mm."""
    trace = simulate_record(BenchParameters(**secrets), Condition(oil=oil + 273.15, setting=pressure * 1e5))
    end = trace.states[np.flatnonzero(trace.command > 0)[-1] + 50, equations.X]
    return 1e3 * float(end - trace.states[0, equations.X])


@pytest.mark.parametrize("pressure", STROKES)
def test_strokes_agree_with_an_independent_calculation(pressure: float) -> None:
    assert stroke(pressure) == pytest.approx(STROKES[pressure], abs=0.5)


def test_the_textbook_stroke_increases_with_temperature() -> None:
    cold = stroke(30.0)
    assert stroke(30.0, 60.0) / cold == pytest.approx(1.014, abs=0.002)
    assert stroke(30.0, 80.0) / cold == pytest.approx(1.022, abs=0.002)


def test_trajectories_agree_with_lsoda() -> None:
    bench, condition = (
        BenchParameters(coulomb=60.0, static=30.0, air=0.005),
        Condition(oil=313.15, setting=30e5),
    )
    trace = simulate_record(bench, condition)
    state, states = initial_state(bench, condition), []
    for command, duration in STANDARD:
        inputs = np.array([command, condition.setting, 0.0, condition.ambient])

        def rhs(_t: float, y: np.ndarray, inputs: np.ndarray = inputs) -> np.ndarray:
            f = np.empty(equations.STATES)
            equations.rhs(y, inputs, bench, f)
            return f

        grid = np.linspace(0.0, duration, round(duration * 100) + 1)
        done = solve_ivp(rhs, (0.0, duration), state, "LSODA", grid, rtol=1e-9, atol=1e-11)
        assert done.success
        states.append(done.y.T[:-1])
        state = done.y[:, -1]
    expected = np.concatenate([*states, state[None]])
    peak = np.abs(expected).max(axis=0) + 1e-12
    used = [equations.T_OIL, equations.PS, equations.PA, equations.PB, equations.X]
    assert np.all(np.abs(trace.states - expected)[:, used].max(axis=0) < 2e-4 * peak[used])


def test_every_hidden_parameter_acts_and_is_off_by_default() -> None:
    plain = simulate_record(BenchParameters(), Condition(oil=333.15, setting=50e5)).states
    secrets = {
        "piston_gap": 3e-5, "spool_leak": 4e-15, "cap_leak": 1e-14, "rod_leak": 1e-14, "pump_slip": 3.5e-14,
        "relief_extra_r": 1e9, "relief_drift": -2e-3, "transition": 100.0, "throttle_drift": -1e-3,
        "line_length": 2.0, "line_zeta": 5.0, "barus": 2e-8, "air": 0.01, "hose": 1e-10, "coulomb": 80.0,
        "static": 40.0, "film": 1000.0, "seal_friction": 2e-5, "load_mass": 10.0, "spring": 2e3,
        "constant_load": 500.0, "spool_second": 0.02, "wall_capacity": 5e4, "radiation": 1.0,
    }  # fmt: skip
    for name, value in secrets.items():
        assert getattr(BenchParameters(), name) == 0.0, name
        extra = {"piston_gap": 3e-5} if name == "barus" else {}  # viscosity shows only where it acts
        base = (
            plain if not extra else simulate_record(BenchParameters(**extra), Condition(333.15, 50e5)).states
        )
        changed = simulate_record(BenchParameters(**{name: value, **extra}), Condition(333.15, 50e5)).states
        assert np.abs(changed - base)[:, : equations.BRISTLE].max() > 0.0, name


def test_valve_delays_shift_the_motion_in_time_only() -> None:
    condition = Condition(oil=293.15, setting=30e5)
    late = simulate_record(
        BenchParameters(), condition, switching=Switching(open_delay=0.05, close_delay=0.05)
    )
    plain = simulate_record(BenchParameters(), condition)
    moved = late.states[10:300, equations.X] - plain.states[5:295, equations.X]
    assert np.abs(moved).max() < 2e-6


def test_backlash_and_coloured_noise_follow_their_parameters() -> None:
    walk = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)])
    followed = play(walk, 0.1)
    assert followed[49] == pytest.approx(0.95)
    assert followed[51] == pytest.approx(0.95)
    e = coloured(np.random.default_rng(3), 200_000, 2.0, 0.6)
    assert e.std() == pytest.approx(2.0, rel=0.02)
    assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(0.6, abs=0.01)


def test_campaign_is_reproducible_and_repeats_conditions() -> None:
    campaign = Campaign(temperatures=(20.0, 60.0), pressures=(20.0, 50.0), repeated=1, seed=7,
                        scatter=Scatter(setting=0.002), noise=Noise(correlation=0.6),
                        sensors=Sensors(position_gain=0.01))  # fmt: skip
    first, second = simulate_campaign(campaign), simulate_campaign(campaign)
    assert first.equals(second)
    assert first["record"].nunique() == 5
    conditions = first.groupby("record")["pressure_setpoint [bar]"].first()
    assert conditions.value_counts().max() == 3


def test_compiled_machine_code_is_reused_from_the_cache() -> None:
    simulate_record(BenchParameters(), Condition(300.0, 30e5))
    later = compiled(rosenbrock.integrate.py_func)
    bench, inputs, scale = BenchParameters(), np.array([0.0, 30e5, 0.0, 295.0]), np.array(equations.SCALE)
    later(initial_state(bench, Condition(300.0, 30e5)), 1e-4, 1e-5, inputs, bench, scale, 1e-6)
    assert (sum(later.stats.cache_hits.values()), sum(later.stats.cache_misses.values())) == (1, 0)


@pytest.mark.parametrize("changed", ["equations.py", "parameters.py", "rosenbrock.py"])
def test_changed_equations_do_not_reuse_cached_machine_code(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIGCTL_CACHE_DIR", str(tmp_path / "cache"))
    copies = [
        Path(shutil.copytree(Path(equations.__file__).parent, tmp_path / name))
        for name in ("first", "same", "other")
    ]
    with (copies[-1] / changed).open("a", encoding="utf-8") as file:
        file.write("# another\n")
    first, same, other = map(folder_of, copies)
    assert first == same
    assert first != other


def test_the_bench_works_without_a_writable_cache_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").write_text("no folder")
    monkeypatch.setenv("RIGCTL_CACHE_DIR", str(tmp_path / "cache"))
    package = Path(shutil.copytree(Path(equations.__file__).parent, tmp_path / "package"))
    assert folder_of(package) is None
