"""An oven with one thermometer, and a log of it as a user writes one: steps of the heater's power.

``C·dT/dt = gain·P - G·(T - room)``, integrated exactly from sample to sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rigctl.dataset import Run, open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.rig.load import load_rig

#: J/K, W/K, degC and K: the bench itself
HEAT_CAPACITY, CONDUCTANCE, ROOM, NOISE = 130.0, 1.6, 19.0, 0.04
SAMPLES, PERIOD = 420, 4.0

FAMILY = """
family: oven
title: Oven with one thermometer
states:
  oven:
    start: 20 degC
    scale: 0.1 K
    rate: (gain*heater - conductance*(oven - room) + extra)/heat_capacity
inputs:
  heater: {{value: 0 W, meaning: commanded}}
parameters:
  gain: {{value: {gain}, bounds: {gain_bounds}, meaning: of the power stage}}
  heat_capacity: {{value: {heat_capacity}, bounds: {heat_capacity_bounds}, meaning: of the oven}}
  conductance: {{value: 1.5 W/K, bounds: {conductance_bounds}, meaning: of its walls}}
  room: {{value: 20 degC, bounds: [0 degC, 50 degC], meaning: around it}}
slots:
  extra: {{unit: W, meaning: what else heats it}}
  oven_reading: {{unit: K, kind: sensor, meaning: what the thermometer adds}}
outputs:
  oven: {{unit: degC, formula: oven + oven_reading}}
"""
RIG = """
name: oven
model: families/oven.yaml
channels:
  oven: {unit: degC, quantity: temperature}
actuators:
  heater: {kind: level, unit: W, low: 0 W, high: 100 W}
safe_state: {heater: 0 W}
"""
USUAL = {
    "conductance_bounds": "[0.1 W/K, 20 W/K]",
    "gain": "1",
    "gain_bounds": "[0.1, 10]",
    "heat_capacity": "100 J/K",
    "heat_capacity_bounds": "[10 J/K, 1000 J/K]",
}


def heated(radiation: float = 0.0, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """(n) W and degC: rests and steps of power, with noise; `radiation` is a loss in W/K²."""
    power = np.repeat([0.0, 60.0, 0.0, 90.0, 30.0, 0.0], SAMPLES // 6)
    oven, values = ROOM, np.empty(SAMPLES)
    for k in range(SAMPLES):
        values[k] = oven
        for _ in range(20):
            away = oven - ROOM
            lost = CONDUCTANCE * away + radiation * away * abs(away)
            oven += PERIOD / 20.0 * (power[k] - lost) / HEAT_CAPACITY
    return power, values + NOISE * np.random.default_rng(seed).standard_normal(SAMPLES)


def oven_project(
    folder: Path, free: Mapping[str, str], *, radiation: float = 0.0, **family: str
) -> tuple[Run, Model]:
    """A user's folder with a log, imported; `free` are the fitted parameters with their values.

    `family` replaces entries of `USUAL`.
    """
    lines = [f"  {name}: {{value: {value}, fit: true}}" for name, value in free.items()]
    model = "model: families/oven.yaml\nrig: rigs/oven.yaml\nparameters:\n" + "\n".join(lines) + "\n"
    for name, text in {
        "families/oven.yaml": FAMILY.format(**{**USUAL, **family}),
        "rigs/oven.yaml": RIG,
        "models/oven.yaml": model,
        "rigctl.toml": "",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    power, oven = heated(radiation)
    rows = np.column_stack([np.arange(SAMPLES) * PERIOD, power, np.round(oven, 3)])
    log = folder / "log.csv"
    np.savetxt(log, rows, "%.7g", ",", header="time [s],heater [W],oven [degC]", comments="")
    run = import_file(log, load_rig(folder / "rigs/oven.yaml"), folder / "runs").path
    return open_run(run), load_model(folder / "models/oven.yaml")
