"""A discharge of a battery cell whose resistance falls as it warms: an effect that the library lacks.

A flexible effect, a hysteresis with four parameters none of which these data determine, explains most of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import answer

FAMILY = """\
family: cell
states:
  charge: {start: 0.95, scale: 0.1, rate: "-current/capacity"}
  polarisation: {start: 0 V, scale: 0.05 V, rate: "(current*r1 - polarisation)/(r1*c1)"}
  temperature:
    start: 22 degC
    scale: 1 K
    rate: "(r0*current^2 + polarisation^2/r1 - k*(temperature - ambient) + extra_heat)/heat_capacity"
inputs: {current: {value: 0 A}}
parameters:
  capacity: {value: 2.5 A*h, bounds: [1 A*h, 5 A*h]}
  r0: {value: 0.05 ohm, bounds: [0.001 ohm, 1 ohm]}
  r1: {value: 0.03 ohm, bounds: [0.001 ohm, 1 ohm]}
  c1: {value: 700 F, bounds: [10 F, 10000 F]}
  heat_capacity: {value: 40 J/K, bounds: [4 J/K, 400 J/K]}
  k: {value: 0.1 W/K, bounds: [0.001 W/K, 10 W/K]}
  ambient: {value: 22 degC, bounds: [10 degC, 40 degC]}
slots:
  extra_heat: {unit: W, kind: process}
  voltage_reading: {unit: V, kind: sensor}
  temperature_reading: {unit: K, kind: sensor}
outputs:
  voltage: {unit: V, formula: "3.3 V + 0.85 V*charge - r0*current - polarisation + voltage_reading"}
  case_temperature: {unit: degC, formula: "temperature + temperature_reading"}
"""
RIG = """\
name: cell
model: family.yaml
channels:
  voltage: {unit: V, quantity: voltage}
  case_temperature: {unit: degC, quantity: temperature}
actuators:
  current: {kind: level, unit: A, low: 0 A, high: 4 A}
safe_state: {current: 0 A}
simulation:
  initial: {voltage: 4.1 V, case_temperature: 22 degC}
"""
MODEL = """\
model: family.yaml
rig: rig.yaml
parameters:
  capacity: {value: 2.5 A*h, fit: true}
  r0: {value: 0.05 ohm, fit: true}
  r1: {value: 0.03 ohm, fit: true}
  c1: {value: 700 F, fit: true}
  heat_capacity: {value: 40 J/K, fit: true}
  k: {value: 0.1 W/K, fit: true}
  ambient: {value: 22 degC, fit: true}
"""
#: times at which the current changes, s, and the currents from there, A
SWITCHES, CURRENTS = np.array([0.0, 60.0, 900.0, 1200.0, 1800.0, 2100.0]), np.array([0, 2, 0, 4, 0, 1.0])


def discharge(share: float) -> str:
    """A log in minutes, of a cell whose resistance falls by `share` for each kelvin above 25 °C."""
    rng = np.random.default_rng(20260126)
    times = np.arange(0.0, 2700.0, 5.0)
    values = np.empty((3, times.size))
    state = np.array([0.95, 0.0, 22.0])
    current = CURRENTS[np.searchsorted(SWITCHES, times, side="right") - 1]

    def resistance(temperature: np.ndarray | float) -> np.ndarray | float:
        return 0.045 * np.exp(-share * (temperature - 25.0))

    for begin, end, now in zip(SWITCHES, [*SWITCHES[1:], 2700.0], CURRENTS, strict=True):

        def rates(_: float, y: np.ndarray, i: float = float(now)) -> list[float]:
            heat = resistance(y[2]) * i**2 + y[1] ** 2 / 0.03 - 0.11 * (y[2] - 22.0)
            return [-i / 9360.0, (i * 0.03 - y[1]) / 24.0, float(heat) / 42.0]

        here = (times >= begin) & (times < end)
        found = solve_ivp(rates, (begin, end), state, t_eval=[*times[here], end], rtol=1e-8, atol=1e-10)
        values[:, here], state = found.y[:, :-1], found.y[:, -1]
    charge, polarisation, temperature = values
    voltage = 3.3 + 0.85 * charge - resistance(temperature) * current - polarisation
    rows = zip(
        times / 60.0,
        current,
        voltage + rng.normal(0.0, 0.002, times.size),
        temperature + rng.normal(0.0, 0.05, times.size),
        strict=True,
    )
    head = "Time (min),Current (A),Voltage (V),Case temperature (degC)\n"
    return head + "".join(f"{t:.4f},{i:.2f},{u:.3f},{c:.2f}\n" for t, i, u, c in rows)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("family", FAMILY), ("rig", RIG), ("model", MODEL)):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_effect_with_undetermined_parameters_is_not_named_as_missing(project: Path) -> None:
    (project / "log.csv").write_text(discharge(0.03), encoding="utf-8")
    answer("import", "log.csv", "--rig", "rig.yaml")
    found = answer("diagnose", "latest", "--model", "model.yaml")
    assert found["verdict"] in ("ambiguous", "outside_library")
    assert not any(each[level]["sure"] for each in found["levels"] for level in ("place", "driver", "law"))


def test_a_constant_resistance_agrees_with_the_model(project: Path) -> None:
    (project / "log.csv").write_text(discharge(0.0), encoding="utf-8")
    answer("import", "log.csv", "--rig", "rig.yaml")
    assert answer("diagnose", "latest", "--model", "model.yaml")["verdict"] == "adequate"
