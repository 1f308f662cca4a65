"""A flywheel on a motor, integrated by SciPy, as a user describes and logs it: five spin-ups, one coast-down.

What drags on it is a function of its speed; the files know a fan whose air drags with the square.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

#: N·m/V and kg·m², as in the files
GAIN, INERTIA = 0.05, 2e-3
#: V of the five spin-ups from rest; the sixth record coasts down from 200 rad/s
FAST, SLOW = (2, 4, 6, 9, 12), (0.2, 0.4, 0.6, 0.9, 1.2)

FAN = """
effect: fan
family: flywheel.yaml
summary: The air drags with the square of the speed.
slot: drag
term: size*speed*absolute(speed, 0.1 rad/s)
parameters:
  size: {null_value: 0 N*m*s^2/rad^2, start: 1e-5 N*m*s^2/rad^2, bounds: [0 N*m*s^2/rad^2, 1 N*m*s^2/rad^2]}
"""


def family(*, damped: bool = False) -> str:
    """The motor against whatever drags, with a damping in its bearing where it is `damped`."""
    damping = "  damping: {value: 1e-3 N*m*s/rad, bounds: [0 N*m*s/rad, 1 N*m*s/rad]}\n" if damped else ""
    return f"""
family: flywheel
generic_effects: false
states:
  speed:
    start: 0 rad/s
    scale: 0.1 rad/s
    rate: (gain*drive - {"damping*speed - " if damped else ""}drag)/inertia
inputs:
  drive: {{value: 0 V}}
parameters:
  gain: {{value: {GAIN} N*m/V, bounds: [0.001 N*m/V, 1 N*m/V]}}
{damping}constants:
  inertia: {INERTIA} kg*m^2
slots:
  drag: {{unit: N*m, meaning: against the rotation}}
outputs:
  speed: {{unit: rad/s, formula: speed}}
"""


def rig(noise: float) -> str:
    """A tachometer with noise in rad/s, and a drive of ±12 V."""
    return f"""
name: flywheel
model: flywheel.yaml
channels:
  speed: {{unit: rad/s, quantity: other, noise: {noise} rad/s}}
actuators:
  drive: {{kind: level, unit: V, low: -12 V, high: 12 V}}
safe_state: {{drive: 0 V}}
"""


def model(effects: Sequence[str] = ("fan.yaml",), rig: str = "rig.yaml", *, damped: bool = False) -> str:
    """The textbook model, whose gain is fitted, with a user's own effects beside it."""
    damping = "  damping: {value: 1e-3 N*m*s/rad, fit: true}\n" if damped else ""
    return f"""
model: flywheel.yaml
rig: {rig}
own_effects: [{", ".join(effects)}]
parameters:
  gain: {{value: {GAIN} N*m/V, fit: true}}
{damping}"""


def drag(speed: float, exponent: float, at_100: float = 4e-3) -> float:
    """N·m that grow with a power of the speed, `at_100` at 100 rad/s."""
    return at_100 * float(np.sign(speed)) * abs(speed / 100.0) ** exponent


def write_log(
    path: Path,
    torque: Callable[[float], float],
    *,
    seed: int,
    noise: float = 0.5,
    volts: Sequence[float] = SLOW,
    step: float = 0.1,
) -> None:
    """A log of 10 s records, a reading every `step` s with `noise` rad/s; `torque` N·m drags at a speed."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 10.0, step)
    with path.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "record", "drive [V]", "speed [rad/s]"])
        for record, (drive, start) in enumerate([*((one, 0.0) for one in volts), (0, 200.0)], start=1):

            def rate(t: float, y: list[float], drive: float = drive) -> list[float]:
                return [(GAIN * drive - torque(y[0])) / INERTIA]

            speeds = solve_ivp(rate, (0.0, 10.0), [start], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.05)
            for time, speed in zip(times, speeds.y[0] + noise * rng.standard_normal(times.size), strict=True):
                rows.writerow([f"{time:.3f}", record, drive, f"{speed:.4f}"])


def write_bench(
    folder: Path,
    torque: Callable[[float], float],
    *,
    seed: int,
    noise: float = 0.5,
    volts: Sequence[float] = SLOW,
) -> None:
    """The files of the bench, and its log."""
    texts = {"flywheel": family(), "rig": rig(noise), "fan": FAN, "model": model()}
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    write_log(folder / "log.csv", torque, seed=seed, noise=noise, volts=volts)
