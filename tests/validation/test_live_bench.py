"""The separate bench behind the runner, advanced step by step: the same machine as in whole campaigns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from rigctl_validation.bench import equations
from rigctl_validation.bench.campaign import Campaign, Scatter
from rigctl_validation.bench.parameters import BenchParameters, Sensors, Switching
from rigctl_validation.bench.record import RATE, STANDARD, Condition, simulate_record
from rigctl_validation.bench.running import RunningBench
from rigctl_validation.bench.sensing import Noise
from rigctl_validation.live_bench import SeparateBench, SeparatePlant

_QUIET = Noise(sigma=dict.fromkeys(Noise().sigma, 0.0))
_WARM = Condition(oil=333.15, setting=40e5)


def _followed(bench: RunningBench, schedule: tuple[tuple[float, float], ...]) -> np.ndarray:
    """The states at every sample of a schedule of valve commands, given one by one."""
    rows, index, edge = [bench.state], 0, 0.0
    for command, duration in schedule:
        bench.valve(command)
        edge += duration
        while (index + 1) / RATE <= edge + 1e-9:
            index += 1
            bench.advance(index / RATE)
            rows.append(bench.state)
    return np.array(rows)


@pytest.mark.parametrize(
    "switching", [Switching(), Switching(open_delay=0.013, close_delay=0.0271, delay_per_kelvin=1e-4)]
)
def test_the_live_bench_agrees_with_simulated_whole_records(switching: Switching) -> None:
    hidden = BenchParameters(coulomb=150.0, spool_leak=4e-15, pressure_time=0.01)
    whole = simulate_record(hidden, _WARM, switching=switching)
    live = _followed(RunningBench(Campaign(bench=hidden, switching=switching), _WARM), STANDARD)
    # steps end at other times, so the two differ by the tolerance of the integrator
    for state, small in ((equations.X, 1e-6), (equations.PS, 200.0), (equations.T_OIL, 1e-6)):
        assert np.max(np.abs(live[:, state] - whole.states[:, state])) < small


def test_readings_have_the_gain_and_the_backlash_of_their_sensor() -> None:
    campaign = Campaign(sensors=Sensors(position_gain=0.02, position_backlash=2e-3), noise=_QUIET)
    bench = RunningBench(campaign, _WARM)
    held = bench.state[equations.X]
    assert bench.read()["position"] == pytest.approx(1.02 * (held + 1e-3), abs=1e-9)  # as after a retract
    _followed(bench, ((0.0, 0.1), (1.0, 0.5)))
    out = bench.state[equations.X]
    assert bench.read()["position"] == pytest.approx(1.02 * (out - 1e-3), abs=1e-9)


def test_noise_has_the_configured_standard_deviation_and_correlation() -> None:
    noise = Noise(correlation=0.6)
    bench = RunningBench(Campaign(noise=noise, seed=4), _WARM)
    still = bench.state[equations.PS]
    drawn = np.array([bench.read()["supply_pressure"] for _ in range(8000)]) - still
    assert drawn.std() == pytest.approx(noise.sigma["supply_pressure"], rel=0.05)
    assert np.corrcoef(drawn[1:], drawn[:-1])[0, 1] == pytest.approx(0.6, abs=0.05)


def test_a_procedure_runs_on_the_live_bench(tmp_path: Path) -> None:
    bench = SeparateBench(
        Campaign(scatter=Scatter(setting=0.002), seed=2), shipped("rigs", "hl32-bench.yaml"), tmp_path
    )
    plan = bench.plan(shipped("procedures", "stroke.yaml"), {})
    ended = bench.measure(plan, 1, "")
    assert ended.status == "finished"
    (stroke,) = open_run(ended.folder).records["stroke"]
    assert 85.0 < stroke < 100.0  # of the published bench at 30 bar and 20 °C, in mm


def test_the_rig_of_another_bench_is_refused() -> None:
    rig = load_rig(shipped("rigs", "tclab-board.yaml"))
    with pytest.raises(RigctlError, match="not the bench that is simulated"):
        SeparatePlant(rig, RunningBench(Campaign(), replace(_WARM)))
