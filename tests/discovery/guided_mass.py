"""A mass on a guide with a force that no library has, integrated by SciPy instead of rigctl's engine.

m·dv/dt = F − k·x − c·v − hidden(x, v),   read: x with white noise
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

MASS, STIFFNESS, DAMPING = 1.5, 400.0, 12.0
NOISE = 0.05  # mm
PERIOD, LENGTH = 0.01, 3.0
#: N, of the records: the force of each of two steps
LEVELS = ((20, -10), (35, 5), (-25, 10), (10, 40), (-40, 0), (15, -30), (5, 25), (-15, 20))

FAMILY = """\
family: guided_mass
title: Mass on a guide, pushed and pulled
states:
  position: {start: 0 mm, scale: 0.1 mm, rate: velocity}
  velocity:
    start: 0 mm/s
    scale: 1 mm/s
    rate: (force - stiffness*position - damping*velocity)/mass
inputs:
  force: {value: 0 N, meaning: of the drive}
parameters:
  stiffness: {value: 400 N/m, bounds: [50 N/m, 5000 N/m]}
  damping: {value: 12 N*s/m, bounds: [0 N*s/m, 100 N*s/m]}
constants:
  mass: 1.5 kg
outputs:
  position: {unit: mm, formula: position}
"""
MODEL = """\
model: family.yaml
rig: rig.yaml
description: Linear spring and damper
parameters:
  stiffness: {value: 420 N/m, fit: true}
  damping: {value: 11 N*s/m, fit: true}
"""
RIG = """\
name: guided mass
description: A mass on a guide
model: family.yaml
channels:
  position: {unit: mm, quantity: position, range: [-250 mm, 250 mm]}
actuators:
  force: {kind: level, unit: N, low: -60 N, high: 60 N}
safe_state: {force: 0 N}
"""
Hidden = Callable[[float, float], float]


def nothing(_x: float, _v: float) -> float:
    return 0.0


def worn_spot(x: float, _v: float) -> float:
    """A groove of the guide at 40 mm that holds the mass: force in N from m and m/s."""
    return 0.12 * float(np.exp(-(((x - 0.04) / 0.02) ** 2)))


def rubbing_spot(x: float, v: float) -> float:
    """Viscous drag of the guide at 40 mm."""
    return 0.3 * float(np.exp(-(((x - 0.04) / 0.02) ** 2))) * v


def write_bench(
    folder: Path, hidden: Hidden, *, seed: int = 0, levels: Sequence[tuple[float, float]] = LEVELS
) -> Path:
    """A user's folder: family, rig, model and the log of a campaign, which is returned."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("family", FAMILY), ("model", MODEL), ("rig", RIG)):
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(seed)
    lines = ["time [s],record,force [N],position [mm]"]
    for record, steps in enumerate(levels, start=1):
        time = np.arange(round(LENGTH / PERIOD) + 1) * PERIOD
        switches = [0.2 + PERIOD * rng.uniform(0.1, 0.9), 1.6 + PERIOD * rng.uniform(0.1, 0.9)]
        position, force = _followed(hidden, time, switches, steps)
        read = 1e3 * position + NOISE * rng.standard_normal(time.size)
        lines += [f"{t:.6g},{record},{f:g},{x:.9g}" for t, f, x in zip(time, force, read, strict=True)]
    log = folder / "log.csv"
    log.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return log


def _followed(
    hidden: Hidden, time: np.ndarray, switches: Sequence[float], steps: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    position, force = np.zeros(time.size), np.zeros(time.size)
    state, begin = np.zeros(2), 0.0
    for end, held in zip((*switches, float(time[-1])), (0.0, *steps), strict=True):

        def rates(_t: float, y: np.ndarray, u: float = held) -> list[float]:
            push = u - STIFFNESS * y[0] - DAMPING * y[1] - hidden(float(y[0]), float(y[1]))
            return [y[1], push / MASS]

        done = solve_ivp(rates, (begin, end), state, rtol=1e-8, atol=1e-11, dense_output=True, max_step=0.05)
        inside = (time >= begin) & (time <= end)
        position[inside] = done.sol(time[inside])[0]
        force[(time > begin) & (time <= end)] = held
        state, begin = done.y[:, -1], end
    return position, force
