"""A long record whose input is commanded at every sample: a mass on a hardening spring, 48 640 rows.

With the environment variable RIGCTL_REAL_DATA it is measured: the folder it names has
``silverbox/SNLS80mV.csv.xz``, the Silverbox benchmark of nonlinear system identification, columns V1, V2 at
610.35 Hz, of which the multisines are used. It is an electronic Duffing oscillator: T. Wigren, J. Schoukens,
*Three free data sets for development and benchmarking in nonlinear system identification*, ECC 2013. Without
the variable a bench with the same equations is simulated.

    m·x'' + d·x' + k·x + c·x³ = gain·u        (volts; u is held between samples)
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

#: of the multisines in the measured file, after the sweep with growing amplitude
FIRST, ROWS = 40_650, 48_640
RATE = 610.35
#: of the simulated bench: values found in the literature for the circuit, noise as in its data
MASS, DAMPING, STIFFNESS, CUBIC, NOISE = 5.0e-6, 2.8e-4, 1.0, 3.8, 3e-4
#: integration steps for each sample of the simulated bench
_STEPS = 8

FAMILY = """\
family: oscillator
title: Mass, damper and linear spring, as an electronic circuit
source: Newton's second law
states:
  position: {start: {value: 0 V, std: 0.1 V}, scale: 1 mV, rate: speed}
  speed:
    start: {value: 0 V/s, std: 30 V/s}
    scale: 1 V/s
    rate: (gain*drive - damping*speed - stiffness*position + force)/mass
inputs:
  drive: {value: 0 V}
parameters:
  stiffness: {value: 1, bounds: [0.1, 10]}
  damping: {value: 0.3 ms, bounds: [0.01 ms, 3 ms]}
  gain: {value: 1, bounds: [0.1, 10]}
constants:
  mass: {value: 5e-6 s^2}
slots:
  force: {unit: V, meaning: on the mass}
outputs:
  position: {unit: V, formula: position}
standard_record:
  description: a step of the drive and back
  duration: 200 ms
  rate: 600 Hz
  switches:
    - {at: 0 s, set: {drive: 50 mV}}
    - {at: 100 ms, set: {drive: 0 V}}
"""
RIG = """\
name: oscillator
model: oscillator-family.yaml
channels:
  position: {unit: V, quantity: voltage}
actuators:
  drive: {kind: level, by: operator, prompt: set the drive to, unit: V, low: -1 V, high: 1 V}
"""
MODEL = """\
model: oscillator-family.yaml
rig: oscillator-rig.yaml
parameters:
  stiffness: {value: 1, fit: true}
  damping: {value: 0.3 ms, fit: true}
  gain: {value: 1, fit: true}
effects: {}
"""


def write_long(folder: Path) -> tuple[Path, str]:
    """Write the log, the family, the rig and the model of a long record; return the log, and what it is."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("family", FAMILY), ("rig", RIG), ("model", MODEL)):
        (folder / f"oscillator-{name}.yaml").write_text(text, encoding="utf-8")
    drive, position, source = _measured() or _simulated()
    times = np.round(np.arange(drive.size) / RATE, 7)
    columns = {"time [s]": times, "drive [V]": drive, "position [V]": position}
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv", source


def _measured() -> tuple[NDArray[np.float64], NDArray[np.float64], str] | None:
    if "RIGCTL_REAL_DATA" not in os.environ:
        return None
    path = Path(os.environ["RIGCTL_REAL_DATA"]) / "silverbox" / "SNLS80mV.csv.xz"
    table = pd.read_csv(path, usecols=["V1", "V2"]).iloc[FIRST : FIRST + ROWS]
    return table["V1"].to_numpy(), table["V2"].to_numpy(), "Silverbox, measured"


def _simulated() -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
    """A multisine of random phases up to 200 Hz, and the response, by the classical Runge-Kutta method."""
    rng = np.random.default_rng(1)
    spectrum = np.zeros(ROWS // 2 + 1, dtype=complex)
    excited = np.arange(1, int(200.0 / RATE * ROWS))
    spectrum[excited] = np.exp(2j * np.pi * rng.random(excited.size))
    drive = np.fft.irfft(spectrum, ROWS)
    drive *= 0.0224 / drive.std()
    position = _response(drive) + NOISE * rng.standard_normal(ROWS)
    return np.round(drive, 7), np.round(position, 5), "simulated"


def _response(drive: NDArray[np.float64]) -> NDArray[np.float64]:
    h = 1.0 / (RATE * _STEPS)
    x, v = 0.0, 0.0
    result = np.empty(drive.size)
    for k, u in enumerate(drive.tolist()):
        result[k] = x

        def rate(x: float, v: float, u: float = u) -> float:
            return (u - DAMPING * v - STIFFNESS * x - CUBIC * x**3) / MASS

        for _ in range(_STEPS):
            k1, l1 = v, rate(x, v)
            k2, l2 = v + h / 2 * l1, rate(x + h / 2 * k1, v + h / 2 * l1)
            k3, l3 = v + h / 2 * l2, rate(x + h / 2 * k2, v + h / 2 * l2)
            k4, l4 = v + h * l3, rate(x + h * k3, v + h * l3)
            x, v = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), v + h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
    return result
