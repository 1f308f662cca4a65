"""A heated jar with a stirrer, simulated by SciPy: water in a shell, in a room.

The stirrer heats the water with a power of its speed, which no generic effect does: these depend on one of
the states, or on one temperature's excess over another.

``python tests/benches/stirred_jar.py FOLDER`` writes the files of a project and the log, for inspection.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

NOISE = 0.05  # K
#: heating power in W, stirrer speed in rpm
CONDITIONS = tuple((power, speed) for power in (400.0, 800.0, 1200.0) for speed in (120.0, 300.0, 600.0))
SWITCHES = (200.0, 2400.0, 3000.0, 3600.0)  # s
WATER, SHELL, FILM, LOSS = 21e3, 3.5e3, 35.0, 4.2  # J/K, J/K, W/K, W/K

FAMILY = """family: jar
title: Stirred jar with a shell
states:
  water:
    start: {value: 21 degC, std: 2 K}
    scale: 0.5 K
    rate: (heater - through + water_heat)/water_capacity
  shell:
    start: {value: 21 degC, std: 2 K}
    scale: 0.5 K
    rate: (through - loss + shell_heat)/shell_capacity
inputs:
  heater: {value: 0 W, role: heat}
  stirrer: {value: 300 rpm}
  ambient: {value: 21 degC}
parameters:
  water_capacity: {value: 18 kJ/K, bounds: [1 kJ/K, 100 kJ/K]}
  shell_capacity: {value: 4 kJ/K, bounds: [0.1 kJ/K, 50 kJ/K]}
  film: {value: 30 W/K, bounds: [1 W/K, 500 W/K]}
  loss_coefficient: {value: 4 W/K, bounds: [0.1 W/K, 50 W/K]}
definitions:
  through: {unit: W, formula: film*wall*(water - shell)}
  loss: {unit: W, formula: loss_coefficient*(shell - ambient)}
slots:
  water_heat: {unit: W}
  shell_heat: {unit: W}
  wall: {combine: product}
  water_reading: {unit: K, kind: sensor}
  shell_reading: {unit: K, kind: sensor}
outputs:
  water: {unit: degC, formula: water + water_reading}
  shell: {unit: degC, formula: shell + shell_reading}
"""
RIG = """name: jar
model: families/jar.yaml
channels:
  ambient: {unit: degC, quantity: temperature}
  water: {unit: degC, quantity: temperature}
  shell: {unit: degC, quantity: temperature}
actuators:
  heater: {kind: level, unit: W, low: 0 W, high: 1500 W}
  stirrer: {kind: level, unit: rpm, low: 0 rpm, high: 700 rpm}
safe_state: {heater: 0 W, stirrer: 0 rpm}
"""
MODEL = """model: families/jar.yaml
rig: rigs/jar.yaml
parameters:
  water_capacity: {value: 18 kJ/K, fit: true}
  shell_capacity: {value: 4 kJ/K, fit: true}
  film: {value: 30 W/K, fit: true}
  loss_coefficient: {value: 4 W/K, fit: true}
"""


def write_project(folder: Path) -> None:
    """The files of family, rig and model, in a project's folders."""
    for kind, text in (("families", FAMILY), ("rigs", RIG), ("models", MODEL)):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        (folder / kind / "jar.yaml").write_text(text, encoding="utf-8")


def write_log(path: Path, stirring: float, seed: int) -> None:
    """A log of nine records; `stirring` is the heat of the stirrer at 600 rpm, W."""
    rng = np.random.default_rng(seed)
    lines = ["time [s],record,heater [W],stirrer [rpm],ambient [degC],water [degC],shell [degC]"]
    times = np.arange(0.0, 5400.1, 40.0)
    for number, condition in enumerate(CONDITIONS, start=1):
        ambient = 21.0 + rng.normal()
        start = [ambient + rng.normal(0.0, 0.3) + 1.0, ambient + 1.0]
        readings = _record(times, condition, ambient, start, stirring)
        readings += rng.normal(0.0, NOISE, readings.shape)
        for time, (water, shell) in zip(times, readings, strict=True):
            power, speed = _commands(condition, time)
            room = ambient + rng.normal(0.0, 0.02)
            lines.append(f"{time:.0f},{number},{power:g},{speed:g},{room:.2f},{water:.2f},{shell:.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _commands(condition: tuple[float, float], time: float) -> tuple[float, float]:
    """Heating power, W, and speed, rpm: the stirrer slows down for ten minutes."""
    power, speed = condition
    return power * (200.0 <= time < 3600.0), speed * (0.5 if 2400.0 <= time < 3000.0 else 1.0)


def _record(
    times: Floats, condition: tuple[float, float], ambient: float, start: Sequence[float], stirring: float
) -> Floats:
    """(n, 2) temperatures of water and shell, degC, integrated from switch to switch."""
    result = np.empty((times.size, 2))
    state = np.array(start)
    for begin, end in zip([0.0, *SWITCHES], [*SWITCHES, times[-1]], strict=True):
        power, speed = _commands(condition, begin)
        gained = power + stirring * (speed / 600.0) ** 2.7

        def rate(_: float, y: Floats, gained: float = gained) -> list[float]:
            through = FILM * (y[0] - y[1])
            return [(gained - through) / WATER, (through - LOSS * (y[1] - ambient)) / SHELL]

        inside = (times >= begin) & (times <= end)
        solved = solve_ivp(rate, (begin, end), state, t_eval=times[inside], rtol=1e-8, atol=1e-9)
        result[inside] = solved.y.T
        state = solved.y[:, -1]  # every switch is at a sample
    return result


if __name__ == "__main__":
    write_project(Path(sys.argv[1]))
    write_log(Path(sys.argv[1]) / "log.csv", 60.0, 4)
