"""Commands logged with samples: heaters and motor simulated by SciPy, without hidden effects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, told
from rigctl.cli.commands.init import create_project

Floats = NDArray[np.float64]

GAINS, CAPACITY, CONVECTION = (1.05, 0.96), 2.0, 0.0152
#: levels of the heaters in %, and the times from which they apply
PLANS = (
    ((30.0, (70.0, 0.0)), (500.0, (70.0, 40.0)), (800.0, (0.0, 40.0))),
    ((42.0, (0.0, 55.0)), (400.0, (30.0, 55.0)), (900.0, (30.0, 0.0))),
    ((25.0, (45.0, 45.0)), (600.0, (0.0, 0.0)), (850.0, (20.0, 60.0))),
    ((60.0, (90.0, 20.0)), (450.0, (20.0, 80.0)), (700.0, (0.0, 10.0))),
)


def lumps(plan: Any, room: float, times: Floats, switches: list[float]) -> Floats:
    """(n, 2) degC of two lumps that lose heat to the room; exact between the switches."""
    ends = [*switches, times[-1] + 1.0]
    temperature, at = np.full(2, room), 0.0
    found = np.full((times.size, 2), room)
    commands = [(0.0, 0.0), *(command for _, command in plan)]
    rate = CONVECTION / CAPACITY
    for end, command in zip(ends, commands, strict=True):
        settled = room + np.array(GAINS) * np.array(command) / 100.0 / CONVECTION
        inside = (times > at) & (times <= end)
        decay = np.exp(-rate * (times[inside] - at))[:, None]
        found[inside] = settled + (temperature - settled) * decay
        temperature = settled + (temperature - settled) * np.exp(-rate * (end - at))
        at = end
    return found


def heater_file(path: Path, step: float, late: str, seed: int) -> None:
    """Four records every `step` s; commands act at `late` of an interval, logged with the next sample."""
    generator = np.random.default_rng(seed)
    times = np.arange(0.0, 1100.0, step)
    lines = ["time [s],record,heater_1 [%],heater_2 [%],temperature_1 [degC],temperature_2 [degC]"]
    for number, plan in enumerate(PLANS, start=1):
        places = [int(np.searchsorted(times, moment)) for moment, _ in plan]
        share = {"first": 0.0, "middle": 0.5, "last": 1.0}.get(late)
        shares = generator.uniform(0.0, 1.0, 3) if share is None else np.full(3, share)
        acts = [float(times[k] - step * (1.0 - part)) for k, part in zip(places, shares, strict=True)]
        truth = lumps(plan, 22.0 + generator.normal(0.0, 0.5), times, acts)
        read = truth + generator.normal(0.0, 0.1, truth.shape)
        for k, time in enumerate(times):
            command = next(
                (c for p, (_, c) in zip(places[::-1], plan[::-1], strict=True) if k >= p), (0.0, 0.0)
            )
            cells = [f"{time:g}", str(number), *(f"{one:g}" for one in (*command, *read[k].round(4)))]
            lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("step", "late", "seed"),
    [(1.0, "anywhere", 1), (1.0, "last", 2), (5.0, "anywhere", 3), (5.0, "first", 4)],
)
def test_heaters_with_nothing_hidden_are_adequate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: float, late: str, seed: int
) -> None:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    heater_file(tmp_path / "log.csv", step, late, seed)
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    found = answer("compare", "latest", "--model", "models/heater-board.yaml")
    assert found["adequate"], found["statement"]
    for name in ("temperature_1", "temperature_2"):
        assert found["channels"][name]["rmse"] == pytest.approx(0.1, rel=0.07 if step == 1.0 else 0.2)
    assert found["parameters"]["convection"]["value"] == pytest.approx(CONVECTION, rel=0.01)


def test_a_command_may_change_between_the_first_two_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    times, acts = np.arange(0.0, 600.0), 0.4
    truth = lumps(((acts, (60.0, 0.0)),), 23.0, times, [acts])
    read = truth + np.random.default_rng(5).normal(0.0, 0.1, truth.shape)
    rows = [f"{t:g},{0 if t < 1 else 60},0,{a:.4f},{b:.4f}" for t, (a, b) in zip(times, read, strict=True)]
    head = "time [s],heater_1 [%],heater_2 [%],temperature_1 [degC],temperature_2 [degC]"
    (tmp_path / "log.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    assert answer("compare", "latest", "--model", "models/heater-board.yaml")["adequate"]


MOTOR = """
family: dc_motor
title: Brushed motor with a flywheel
states:
  current: {start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - torque_constant*speed)/inductance}
  speed: {start: 0 1/s, scale: 0.1 1/s, rate: (torque_constant*current - friction*speed)/inertia}
inputs:
  voltage: {value: 0 V}
parameters:
  resistance: {value: 1.2 V/A, bounds: [0.1 V/A, 10 V/A]}
  torque_constant: {value: 0.05 V*s, bounds: [0.001 V*s, 1 V*s]}
  friction: {value: 2e-4 J*s, bounds: [0 J*s, 0.01 J*s]}
  inertia: {value: 5e-4 J*s^2, bounds: [1e-6 J*s^2, 1 J*s^2]}
constants:
  inductance: 0.02 V*s/A
outputs:
  current: {unit: A, formula: current}
  speed: {unit: 1/s, formula: speed}
"""
MOTOR_RIG = """
name: motor
model: families/motor.yaml
channels:
  current: {unit: A, quantity: other, noise: 0.01 A}
  speed: {unit: 1/s, quantity: other, noise: 0.05 1/s}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
backend: {kind: simulated}
safe_state: {voltage: 0 V}
monitor_rate: 10 Hz
"""
MOTOR_MODEL = """
model: families/motor.yaml
rig: rigs/motor.yaml
parameters:
  resistance: {value: 1.2 V/A, fit: true}
  torque_constant: {value: 0.05 V*s, fit: true}
  friction: {value: 2e-4 J*s, fit: true}
  inertia: {value: 5e-4 J*s^2, fit: true}
"""
CURRENT_NOISE, SPEED_NOISE = 0.0098, 0.05


def motor(times: Floats, moments: Floats, volts: Floats) -> Floats:
    """(n, 2) current and speed, by the exponential of the equations' matrix."""
    from scipy.linalg import expm

    matrix = np.array([[-1.2 / 0.02, -0.05 / 0.02], [0.05 / 5e-4, -2e-4 / 5e-4]])
    gain = np.array([1.0 / 0.02, 0.0])
    found = np.zeros((times.size, 2))
    state, at, u = np.zeros(2), 0.0, 0.0
    for time, is_sample, place in sorted(
        [(float(t), 0, k) for k, t in enumerate(times)] + [(float(t), 1, k) for k, t in enumerate(moments)]
    ):
        settled = -np.linalg.solve(matrix, gain * u)
        state, at = settled + expm(matrix * (time - at)) @ (state - settled), time
        if is_sample:
            u = float(volts[place])
        else:
            found[place] = state
    return found


def motor_project(folder: Path, records: list[tuple[Floats, Floats]], step: float, seed: int) -> None:
    """Samples every `step` s of records with voltages from given moments on, each beside the next sample."""
    create_project(folder)
    for name, text in (("families/motor", MOTOR), ("rigs/motor", MOTOR_RIG), ("models/motor", MOTOR_MODEL)):
        (folder / f"{name}.yaml").parent.mkdir(exist_ok=True)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    generator = np.random.default_rng(seed)
    times = np.arange(300) * step
    lines = ["time [s],record,voltage [V],current [A],speed [1/s]"]
    for number, (moments, volts) in enumerate(records, start=1):
        read = motor(times, moments, volts)
        read += generator.normal(0.0, 1.0, read.shape) * [CURRENT_NOISE, SPEED_NOISE]
        for k, time in enumerate(times):
            given = np.flatnonzero(moments <= time)
            command = volts[given[-1]] if given.size else 0.0
            lines.append(f"{time:.6g},{number},{command:g},{read[k, 0]:.6f},{read[k, 1]:.6f}")
    (folder / "log.csv").write_text("\n".join(lines), encoding="utf-8")


def test_a_motor_with_its_true_parameters_has_an_error_equal_to_the_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = np.random.default_rng(7)
    steps = [
        (np.array([0.2, 1.1, 2.0]) + generator.uniform(0.0, 0.01, 3), np.array([12.0, top, 0.0]))
        for top in (6.0, 18.0, -6.0)
    ]
    motor_project(tmp_path, steps, 0.01, 8)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/motor.yaml")
    for options in ([], ["--no-fit"]):
        found = answer("compare", "latest", "--model", "models/motor.yaml", *options)
        assert found["adequate"], found["statement"]
        assert found["channels"]["current"]["rmse"] == pytest.approx(CURRENT_NOISE, rel=0.1)


def test_a_record_with_a_hundred_steps_is_fitted_with_accurate_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = np.random.default_rng(9)
    noise = [
        (np.sort(generator.choice(np.arange(5, 295), 100, False)) * 0.01 - generator.uniform(0.0, 0.01, 100),
         generator.choice([4.0, 12.0, 20.0], 100))
        for _ in range(3)
    ]  # fmt: skip
    motor_project(tmp_path, noise, 0.01, 10)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/motor.yaml")
    found = answer("compare", "latest", "--model", "models/motor.yaml")
    assert found["adequate"], found["statement"]
    assert found["parameters"]["resistance"]["value"] == pytest.approx(1.2, rel=0.03)
    assert found["parameters"]["inertia"]["value"] == pytest.approx(5e-4, rel=0.03)


def test_switching_on_and_off_may_have_different_time_offsets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A host switches on just after a sample; the board's clock switches off just before one."""
    on, off = 0.2 + 1e-9, 1.7 - 1e-9
    records = [(np.array([on, off]), np.array([volts, 0.0])) for volts in (6.0, 9.0, 12.0, 15.0, 18.0, 21.0)]
    motor_project(tmp_path, records, 0.01, 12)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/motor.yaml")
    found = answer("compare", "latest", "--model", "models/motor.yaml")
    assert found["adequate"], found["statement"]
    assert found["parameters"]["record.switching_up"]["value"] < -0.3
    assert found["parameters"]["record.switching_off"]["value"] > 0.3
    assert found["parameters"]["resistance"]["value"] == pytest.approx(1.2, rel=0.02)


def rubbed_motor_file(path: Path, friction: float, seed: int) -> None:
    """Every 20 ms a motor whose winding needs 1.7 ms, with dry friction; commands act exactly at samples."""
    from scipy.integrate import solve_ivp

    generator = np.random.default_rng(seed)
    lines = ["record,time [s],voltage [V],current [A],speed [rad/s]"]
    times = np.arange(0.0, 4.0, 0.02)
    for number, top in enumerate((3.0, 6.0, 12.0, -9.0)):
        commands = ((0.5, 0.0), (2.5, top), (3.2, 0.5 * top), (4.0, 0.0))
        state, begin, found = [0.0, 0.0], 0.0, []
        for end, volt in commands:

            def rate(_: float, y: Floats, volt: float = volt) -> list[float]:
                rubs = friction * np.tanh(y[1] / 0.05)
                return [
                    (volt - 1.2 * y[0] - 0.05 * y[1]) / 2e-3,
                    (0.05 * y[0] - 1e-4 * y[1] - rubs) / 2e-4,
                ]

            inside = times[(times >= begin - 1e-9) & (times < end - 1e-9)]
            solved = solve_ivp(
                rate, (begin, end), state, method="Radau", rtol=1e-8, atol=1e-10, t_eval=[*inside, end]
            )
            found += [(volt, *y) for y in solved.y.T[:-1]]
            state, begin = list(solved.y[:, -1]), end
        for time, (volt, current, speed) in zip(times, found, strict=True):
            read = (current + generator.normal(0.0, 0.02), speed + generator.normal(0.0, 0.5))
            lines.append(f"{number},{time:.3f},{volt:.1f},{read[0]:.4f},{read[1]:.3f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_winding_faster_than_its_sampling_is_not_taken_for_another_effect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    rubbed_motor_file(tmp_path / "log.csv", 0.01, 5)
    told("family", "new", "rubbed", "--csv", "log.csv", "--template", "motor")
    told("import", "log.csv", "--rig", "rigs/rubbed.yaml")
    found = answer("diagnose", "latest", "--model", "models/rubbed.yaml", "--apply")
    assert [step["effects"] for step in found["steps"]] == [["coulomb_on_extra_torque"]]
    assert found["verdict"] != "outside_library"


CARRIAGE = """
family: carriage
title: A carriage on a screw
states:
  position: {start: 0 mm, scale: 1 mm, rate: velocity}
  velocity: {start: 0 m/s, scale: 1 mm/s, rate: (force_per_volt*voltage - viscous*velocity)/mass}
inputs:
  voltage: {value: 0 V}
parameters:
  mass: {value: 80 kg, bounds: [10 kg, 1000 kg]}
  viscous: {value: 200 N*s/m, bounds: [0 N*s/m, 5000 N*s/m]}
constants:
  force_per_volt: 35 N/V
outputs:
  position: {unit: mm, formula: position}
"""
CARRIAGE_RIG = """
name: carriage
model: families/carriage.yaml
channels:
  position: {unit: mm, quantity: position}
actuators:
  voltage: {kind: level, unit: V, low: -10 V, high: 10 V}
safe_state: {voltage: 0 V}
"""
CARRIAGE_MODEL = """
model: families/carriage.yaml
rig: rigs/carriage.yaml
parameters:
  mass: {value: 80 kg, fit: true}
  viscous: {value: 200 N*s/m, fit: true}
"""


def carriage_project(folder: Path, load: float) -> None:
    """A controller moves a carriage to and fro, and writes a voltage at every sample; `load` N pushes it."""
    create_project(folder)
    generator = np.random.default_rng(4)
    step, position, velocity, lines = 0.01, 0.0, 0.0, ["time [s],voltage [V],position [mm]"]
    for k in range(500):
        time = k * step
        wanted, speed = 0.1 - 0.1 * np.cos(3.0 * time), 0.3 * np.sin(3.0 * time)
        voltage = 150.0 * (wanted - position) + 40.0 * (speed - velocity) + generator.normal(0.0, 0.2)
        lines.append(f"{time:.2f},{voltage:.6f},{1e3 * (position + generator.normal(0.0, 2e-5)):.5f}")
        for _ in range(20):  # the voltage is held until the next sample
            rate = (35.0 * voltage + load - 210.0 * velocity) / 95.0
            velocity += rate * step / 20
            position += velocity * step / 20
    files = {
        "families/carriage.yaml": CARRIAGE,
        "rigs/carriage.yaml": CARRIAGE_RIG,
        "models/carriage.yaml": CARRIAGE_MODEL,
        "log.csv": "\n".join(lines) + "\n",
    }
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def test_a_command_written_at_every_sample_has_one_delay_that_hides_no_constant_load(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Delays of rises and falls of their own, and scattered times, explained the drift of the position."""
    carriage_project(tmp_path, load=3.0)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/carriage.yaml")
    compared = answer("compare", "latest", "--model", "models/carriage.yaml")
    assert not compared["adequate"]
    assert "record.switching_down" not in compared["parameters"]
    found = answer("diagnose", "latest", "--model", "models/carriage.yaml")
    assert {"offset_on_velocity", "offset_of_voltage"} & set(found["effects"])
