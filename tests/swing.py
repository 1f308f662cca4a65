"""A mass on a spring that never rests, and a log of it as a user writes one: a multisine, one record."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig

FAMILY = """
family: swing
title: Mass on a spring
source: a drawing
states:
  x: {start: {value: 0 m, std: 1 m}, scale: 1 mm, rate: v}
  v: {start: {value: 0 m/s, std: 0.5 m/s}, scale: 3 mm/s, rate: (force - stiffness*x - damping*v)/mass}
inputs:
  force: {value: 0 N, meaning: commanded}
parameters:
  stiffness: {value: 4 N/m, bounds: [0.1 N/m, 100 N/m], meaning: of the spring}
  damping: {value: 0.15 N*s/m, bounds: [0.0001 N*s/m, 10 N*s/m], meaning: of the damper}
  zero: {value: 0 m, bounds: [-1 m, 1 m], meaning: of the reading}
constants:
  mass: 1 kg
outputs:
  position: {unit: m, formula: x + zero, meaning: as measured}
"""
RIG = """
name: swing
model: families/swing.yaml
channels:
  position: {unit: m, quantity: position%s}
actuators:
  force: {kind: level, unit: N, low: -100 N, high: 100 N}
safe_state: {force: 0 N}
"""
MODEL = """
model: families/swing.yaml
rig: rigs/swing.yaml
parameters:
  stiffness: {value: 4 N/m, fit: true}
  damping: {value: 0.15 N*s/m, fit: true}
  zero: {value: 0 m, fit: true}
"""
SAMPLES, PERIOD, STEPS = 800, 0.1, 10
WHITE = 0.005


@cache
def swung(cubic: float = 0.0, seed: int = 1, held: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """(n) force and position: a multisine, held for so many samples, by Runge and Kutta's method."""
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) // held * held * PERIOD
    frequencies, phases = rng.uniform(0.03, 0.5, 12), rng.uniform(0.0, 2.0 * np.pi, 12)
    force = 0.5 * np.sin(2.0 * np.pi * np.outer(t, frequencies) + phases).sum(axis=1)

    def rate(state: np.ndarray, pushed: float) -> np.ndarray:
        x, v = state
        return np.array([v, pushed - 3.6 * x - 0.2 * v - cubic * x**3])

    state, position, h = np.zeros(2), np.empty(SAMPLES), PERIOD / STEPS
    for i in range(SAMPLES):
        position[i] = state[0] + 0.02
        for _ in range(STEPS):
            k1 = rate(state, force[i])
            k2 = rate(state + 0.5 * h * k1, force[i])
            k3 = rate(state + 0.5 * h * k2, force[i])
            k4 = rate(state + h * k3, force[i])
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return force, position


def white(rng: np.random.Generator) -> np.ndarray:
    return WHITE * rng.standard_normal(SAMPLES)


def slow(rng: np.random.Generator) -> np.ndarray:
    """A correlation of 0.95 from sample to sample, with a standard deviation of 3·WHITE, on white noise."""
    values = rng.standard_normal(SAMPLES)
    for i in range(1, SAMPLES):
        values[i] = 0.95 * values[i - 1] + np.sqrt(1.0 - 0.95**2) * values[i]
    return 3.0 * WHITE * values + white(rng)


def project(
    folder: Path,
    noise: Callable[[np.random.Generator], np.ndarray],
    cubic: float = 0.0,
    stated: str = "",
    held: int = 1,
) -> None:
    """A user's folder, with a log of the bench."""
    for name, text in {
        "families/swing.yaml": FAMILY,
        "rigs/swing.yaml": RIG % (f", noise: {stated}" if stated else ""),
        "models/swing.yaml": MODEL,
        "rigctl.toml": "",
    }.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    force, position = swung(cubic, held=held)
    readings = position + noise(np.random.default_rng(7))
    rows = np.column_stack([np.arange(SAMPLES) * PERIOD, force, readings])
    np.savetxt(folder / "log.csv", rows, "%.7g", ",", header="time [s],force [N],position [m]", comments="")


def diagnosed(folder: Path) -> Diagnosis:
    """Import the log of a user's folder, and diagnose it with the model there."""
    imported = import_file(folder / "log.csv", load_rig(folder / "rigs/swing.yaml"), folder / "runs")
    return diagnose([open_run(imported.path)], load_model(folder / "models/swing.yaml"))
