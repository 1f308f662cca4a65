"""A device whose clock is off is not taken for missing physics, within what is stated or beyond it.

The benches are integrated by SciPy, and their readings taken at other times than they say.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from commands import answer, refusal, told
from rigctl.cli.commands.init import create_project

Floats = NDArray[np.float64]

MOTOR = """
family: motor
states:
  current: {start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - kt*speed)/inductance}
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: (kt*current - damping*speed)/inertia}
inputs:
  voltage: {value: 0 V}
parameters:
  resistance: {value: 1.8 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {value: 0.045 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
  damping: {value: 2e-4 N*m*s/rad, bounds: [0 N*m*s/rad, 0.1 N*m*s/rad]}
constants: {inertia: 2e-4 kg*m^2, inductance: 20 mH}
outputs:
  current: {unit: A, formula: current}
  speed: {unit: rad/s, formula: speed}
"""
MOTOR_RIG = """
name: motor
model: family.yaml
channels:
  current: {unit: A, quantity: current, noise: 10 mA}
  speed: {unit: rad/s, quantity: angular_speed, noise: 0.3 rad/s}
  housing: {unit: degC, quantity: temperature}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
safe_state: {voltage: 0 V}
"""
MOTOR_MODEL = """
model: family.yaml
rig: rig.yaml
parameters:
  resistance: {value: 1.8 ohm, fit: true}
  kt: {value: 0.045 N*m/A, fit: true}
  damping: {value: 2e-4 N*m*s/rad, fit: true}
"""
#: s, V from each time on, in two records
EDGES, VOLTAGES = (0.0, 0.205, 0.805, 1.305), ((0.0, 6.0, 0.0, 12.0), (0.0, 12.0, 3.0, -6.0))
#: s, 95 %
STATED = 0.02


def write_files(**texts: str) -> None:
    for name, text in texts.items():
        Path(f"{name}.yaml").write_text(text, "utf-8")


def write_log(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    with Path("log.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([head, *rows])


def course(
    rates: Callable[[float, Sequence[float]], Sequence[float]],
    start: Sequence[float],
    times: Floats,
    late: Sequence[float],
    step: float,
) -> list[Floats]:
    """Each state of a bench at the times of its own clock, which is behind by `late`, s."""
    grids = [np.clip(times + one, 0.0, None) for one in late]
    every = np.unique(np.concatenate(grids))
    found = solve_ivp(
        rates, (0.0, every[-1] + step), start, t_eval=every, rtol=1e-8, atol=1e-9, max_step=step
    )
    return [y[np.searchsorted(every, grid)] for y, grid in zip(found.y, grids, strict=True)]


def clock(channels: str, stated: float = STATED, offset: float = 0.0) -> str:
    known = f"offset: {1e3 * offset:g} ms, " if offset else ""
    return f"clocks:\n  logger_b: {{channels: [{channels}], {known}uncertainty: {1e3 * stated:g} ms}}\n"


def write_motor(clocks: str, late: tuple[float, float], *, dead: float = 0.0) -> None:
    """A motor whose current and speed are dated by clocks that are behind, and whose commands act `dead` s
    late."""
    write_files(family=MOTOR, rig=MOTOR_RIG + clocks, model=MOTOR_MODEL)
    rng, times, rows = np.random.default_rng(1), np.arange(0.0, 2.0, 0.01), []
    for record, volts in enumerate(VOLTAGES, 1):

        def voltage(t: float, volts: tuple[float, ...] = volts) -> float:
            return volts[max(int(np.searchsorted(EDGES, t, side="right")) - 1, 0)]

        def rates(t: float, y: Sequence[float], voltage: Callable[[float], float] = voltage) -> list[float]:
            u = voltage(t - dead)
            return [(u - 2.0 * y[0] - 0.05 * y[1]) / 20e-3, (0.05 * y[0] - 1e-4 * y[1]) / 2e-4]

        current, speed = course(rates, [0.0, 0.0], times, late, 2e-3)
        current += 0.01 * rng.standard_normal(times.size)
        speed += 0.3 * rng.standard_normal(times.size)
        rows += [(t, record, voltage(t), i, w) for t, i, w in zip(times, current, speed, strict=True)]
    write_log(["time [s]", "record", "voltage [V]", "current [A]", "speed [rad/s]"], rows)
    told("import", "log.csv", "--rig", "rig.yaml")


def judged(command: str = "compare") -> dict[str, Any]:
    return answer(command, "latest", "--model", "model.yaml")


def offset(found: Mapping[str, Any]) -> dict[str, Any]:
    (one,) = found["clocks"]
    assert one["clock"] == "logger_b"
    return dict(one)


def require_found(found: Mapping[str, Any], late: float, stated: float) -> None:
    """The offset, within what is stated or beyond it, and nothing else."""
    one, beyond = offset(found), abs(late) > stated
    assert one["beyond"] is beyond
    assert abs(one["behind"] - late) < 4.0 * one["std"]
    assert one["std"] < 0.1 * stated
    assert found["adequate"] is not beyond
    assert found["explained_by"] == "clock"
    assert "the clock logger_b is" in found["statement"]
    assert ("more than is stated" in found["statement"]) is beyond


@pytest.mark.parametrize("share", [0.3, -0.8, 1.5])
def test_a_late_tachometer_is_the_clock_of_its_logger(tmp_path: Path, share: float) -> None:
    with chdir(tmp_path):
        write_motor(clock("speed"), (0.0, share * STATED))
        require_found(judged(), share * STATED, STATED)


@pytest.mark.parametrize("late", [0.0312, -0.0488])
def test_a_stated_offset_is_the_centre_of_the_prior(tmp_path: Path, late: float) -> None:
    """With it the model agrees, exact clocks or not; without it the clock is off by more than is stated."""
    stated = 0.004
    with chdir(tmp_path):
        write_motor(clock("speed", stated), (0.0, late))
        without = judged()
        write_motor(clock("speed", stated, late), (0.0, late))
        found = judged()
    assert not without["adequate"]
    assert found["adequate"]
    assert found["explained_by"] is None, "what is left of the offset explains nothing"
    assert offset(found)["offset"] == pytest.approx(late)
    assert abs(offset(found)["behind"] - late) < 4.0 * offset(found)["std"]
    assert any("the clock logger_b is" in note for note in found["notes"])


def test_an_offset_beyond_the_stated_one_is_told_from_zero(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write_motor(clock("speed", 0.004, 0.03), (0.0, 0.037))
        found = judged()
    one = offset(found)
    assert one["beyond"]
    assert abs(one["behind"] - 0.037) < 4.0 * one["std"]
    assert "the clock logger_b is 37 ms behind (stated 30 ms ±4 ms)" in found["statement"]


def test_a_late_measured_input_is_read_at_its_times(tmp_path: Path) -> None:
    late = 1.5
    with chdir(tmp_path):
        write_bath(clock("bath", 0.2, late), late)
        found = judged()
    assert found["adequate"]
    assert found["explained_by"] is None
    assert abs(offset(found)["behind"] - late) < 4.0 * offset(found)["std"]


def test_an_offset_of_half_a_record_is_refused(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write_motor(clock("speed", 0.004, 1.2), (0.0, 0.0))
        message = refusal("compare", "latest", "--model", "model.yaml")
    assert "a clock is off by more than half of record" in message
    assert "less than 0.995 s" in message


def test_an_offset_of_all_channels_and_a_dead_time_are_both_named(tmp_path: Path) -> None:
    """In every record they are the same: what separates them is a measurement of the offset."""
    with chdir(tmp_path):
        write_motor(clock("current, speed"), (0.0, 0.0), dead=0.8 * STATED)
        found = judged("diagnose")
    assert found["verdict"] == "adequate"
    assert found["explained_by"] == "clock"
    assert offset(found)["behind"] == pytest.approx(-0.8 * STATED, abs=1e-3)
    assert found["with_exact_sensors"]["effects"] == ["dead_time_of_voltage"]
    assert any("with exact clocks, dead_time_of_voltage" in one for one in found["evidence"])
    assert any("measure the offset of the clock logger_b" in one for one in found["decided_by"])


def test_a_dead_time_far_beyond_the_stated_offset_is_an_effect(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write_motor(clock("current, speed"), (0.0, 0.0), dead=5.0 * STATED)
        found = judged("diagnose")
    assert found["effects"] == ["dead_time_of_voltage"]
    assert found["explained_by"] is None


def test_a_clock_that_dates_nothing_of_the_model_changes_no_bit(tmp_path: Path) -> None:
    with chdir(tmp_path):
        answers = []
        for clocks in ("", clock("housing")):
            write_motor(clocks, (0.0, 0.0))
            found = judged()
            answers.append(json.loads(json.dumps(found).replace(found["runs"][0], "run")))
    assert answers[0] == answers[1]


def test_a_clock_that_may_be_off_by_a_quarter_of_a_record_is_refused(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write_motor(clock("speed", 1.2), (0.0, 0.0))
        message = refusal("compare", "latest", "--model", "model.yaml")
    assert "the clock 'logger_b' may be off by more than a quarter of record" in message
    assert "less than ±0.4975 s" in message


@pytest.mark.parametrize("share", [0.8, 1.5])
def test_late_thermometers_of_the_heater_board_are_its_loggers_clock(tmp_path: Path, share: float) -> None:
    stated, levels = 20.0, (0.0, 0.8, 0.2, 1.0, 0.0)
    create_project(tmp_path)
    times = np.arange(0.0, 1500.0, 2.0)

    def rates(t: float, y: Sequence[float]) -> list[float]:
        power = levels[min(int((t + 1.0) // 300.0), 4)]  # switched between two samples
        return [(power - 0.016 * (y[0] - 23.0)) / 2.0, -0.016 * (y[1] - 23.0) / 2.0]

    readings = course(rates, [23.0, 23.0], times, [share * stated] * 2, 10.0)
    rng = np.random.default_rng(2)
    one, two = (each + 0.1 * rng.standard_normal(times.size) for each in readings)
    with chdir(tmp_path):
        rig = Path("rigs/heater-board.yaml")
        text = rig.read_text("utf-8").replace("uncertainty: 1 K", "uncertainty: 1 mK")
        text = text.replace("    raw: {bits: 10, low: 0, high: 1023, unit: count}\n", "")
        text = text.replace("[-50.0, 0.32258065]", "[0, 1]")
        rig.write_text(text + clock("temperature_1, temperature_2", stated), "utf-8")
        heater = [100.0 * levels[int(t // 300.0)] for t in times]
        rows = [(t, p, 0, a, b) for t, p, a, b in zip(times, heater, one, two, strict=True)]
        head = ["time [s]", "heater_1 [%]", "heater_2 [%]", "temperature_1 [degC]", "temperature_2 [degC]"]
        write_log(head, rows)
        told("import", "log.csv", "--rig", str(rig))
        found = answer("compare", "latest", "--model", "models/heater-board.yaml")
    require_found(found, share * stated, stated)


BATH = """
family: bath
states:
  probe: {start: 20 degC, scale: 0.1 K, rate: (bath - probe)/lag}
inputs:
  bath: {value: 20 degC}
parameters:
  lag: {value: 3 s, bounds: [0.1 s, 100 s]}
outputs:
  probe: {unit: degC, formula: probe}
"""
BATH_RIG = """
name: bath
model: family.yaml
channels:
  probe: {unit: degC, quantity: temperature, noise: 50 mK}
  bath: {unit: degC, quantity: temperature}
"""


def write_bath(clocks: str, late: float) -> None:
    """A probe in a bath whose temperature is read by a clock that is behind by `late`, s."""
    times = np.arange(0.0, 60.0, 0.2)

    def bath(t: float | Floats) -> Any:
        return 20.0 + 8.0 * np.sin(0.3 * t) ** 2 * (1.0 + np.sin(0.83 * t))

    (probe,) = course(lambda t, y: [(bath(t) - y[0]) / 4.0], [20.0], times, [0.0], 0.05)
    probe += 0.05 * np.random.default_rng(3).standard_normal(times.size)
    write_files(
        family=BATH,
        rig=BATH_RIG + clocks,
        model="model: family.yaml\nrig: rig.yaml\nparameters: {lag: {value: 3 s, fit: true}}\n",
    )
    rows = list(zip(times, bath(times + late), probe, strict=True))
    write_log(["time [s]", "bath [degC]", "probe [degC]"], rows)
    told("import", "log.csv", "--rig", "rig.yaml")


@pytest.mark.parametrize("share", [0.8, 1.5])
def test_a_late_measured_input_is_its_loggers_clock(tmp_path: Path, share: float) -> None:
    stated = 1.0
    with chdir(tmp_path):
        write_bath(clock("bath", stated), share * stated)
        found = judged()
    require_found(found, share * stated, stated)
    budget = {one["parameter"]: one["shares"] for one in found["uncertainty_budget"]}
    assert sum(budget["lag"].values()) == pytest.approx(1.0)
