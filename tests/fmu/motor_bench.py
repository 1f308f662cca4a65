"""A motor as an FMU and in equations, its bench, and logs that SciPy makes of a motor of its own."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from commands import answer
from foreign_fmus import motor_fmu

PARAMETERS = """
  resistance: {VARIABLE_R value: 1.8 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {VARIABLE_k value: 0.045 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
  damping: {VARIABLE_b value: 2e-4 N*m*s/rad, bounds: [0 N*m*s/rad, 0.1 N*m*s/rad]}
"""
FAMILY = f"""
family: motor_fmu
fmu: motor.fmu
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS.replace("VARIABLE_", "variable: ").replace(" value", ", value")}
outputs:
  current: {{unit: A, scale: 1 mA}}
  speed: {{unit: rad/s, scale: 0.1 rad/s}}
"""
#: the same motor in equations
EQUATIONS = f"""
family: motor
states:
  current: {{start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - kt*speed)/inductance}}
  speed: {{start: 0 rad/s, scale: 0.1 rad/s, rate: (kt*current - damping*speed)/inertia}}
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS.replace("VARIABLE_R", "").replace("VARIABLE_k", "").replace("VARIABLE_b", "")}
constants: {{inertia: 2e-4 kg*m^2, inductance: 20 mH}}
outputs:
  current: {{unit: A, formula: current}}
  speed: {{unit: rad/s, formula: speed}}
"""
RIG = """
name: motor
channels:
  current: {unit: A, quantity: current, noise: 10 mA}
  speed: {unit: rad/s, quantity: other, noise: 0.3 rad/s}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
safe_state: {voltage: 0 V}
"""
MODEL = """
rig: rig.yaml
parameters:
  resistance: {value: 1.8 ohm, fit: true}
  kt: {value: 0.045 N*m/A, fit: true}
  damping: {value: 2e-4 N*m*s/rad, fit: true}
"""
#: with which the resistance may change, and that neither the FMU nor its family above has
CONDITION = "conditions:\n  winding: {value: 20 degC}\nparameters:"
SENSOR = "  winding: {unit: degC, quantity: temperature, noise: 0.1 K}\nactuators:"
WINDINGS = (20.0, 45.0, 30.0, 60.0, 25.0)
PERIOD = 10e-3
VOLTAGES = (3.0, 6.0, -9.0, 12.0, 1.5)

Floats = NDArray[np.float64]


def write_bench(
    folder: Path,
    *,
    inside: Callable[[float], float] = lambda speed: 0.0,
    command: Callable[[float], float] = lambda volts: volts,
    reading: Callable[[Floats], Floats] = lambda speed: speed,
    version: str = "2.0",
    acceleration: str | None = None,
    resistance: Callable[[float, float, float], float] | None = None,
    variability: str = "fixed",
) -> str:
    """The files of the bench; the log has what is missing inside the motor, at its command or at a reading.

    A `resistance` by time, voltage and temperature of the winding adds that temperature to the log.

    Returns the run into which the log is imported.
    """
    given = {} if acceleration is None else {"acceleration": acceleration}
    motor_fmu(folder / "motor.fmu", version, variability=variability, **given)
    files = {"family": FAMILY, "equations": EQUATIONS, "rig": RIG}
    if resistance is not None:
        files["family"] = FAMILY.replace("parameters:", CONDITION)
        files["rig"] = RIG.replace("actuators:", SENSOR)
    files |= {"model": f"model: family.yaml\n{MODEL}", "written": f"model: equations.yaml\n{MODEL}"}
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(7)
    times = np.arange(60) * PERIOD

    def rates(t: float, y: Any, volts: float, winding: float) -> list[float]:
        ohms = 2.0 if resistance is None else resistance(t, volts, winding)
        return [
            (volts - ohms * y[0] - 0.05 * y[1]) / 20e-3,
            (0.05 * y[0] - 1e-4 * y[1] + inside(y[1])) / 2e-4,
        ]

    with (folder / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        temperature = [] if resistance is None else ["winding [degC]"]
        rows.writerow(["time [s]", "record", "voltage [V]", "current [A]", "speed [rad/s]", *temperature])
        for record, (volts, winding) in enumerate(zip(VOLTAGES, WINDINGS, strict=True), start=1):
            found = solve_ivp(
                rates,
                (0.0, times[-1]),
                (0.0, 0.0),
                t_eval=times,
                args=(command(volts), winding),
                rtol=1e-9,
                atol=1e-10,
            )
            current = found.y[0] + 0.01 * rng.standard_normal(times.size)
            speed = reading(found.y[1]) + 0.3 * rng.standard_normal(times.size)
            read = winding + 0.1 * rng.standard_normal((times.size, len(temperature)))
            for time, *values in zip(times, current, speed, *read.T, strict=True):
                rows.writerow([f"{time:.6g}", record, volts, *(f"{value:.7g}" for value in values)])
    return str(answer("import", "log.csv", "--rig", "rig.yaml")["run"])


def fitted(found: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """The value and the standard deviation of each parameter of a comparison."""
    (model,) = found["models"]
    return {name: (one["value"], one["std"]) for name, one in model["parameters"].items()}
