"""An FMU of three states as the model: ``python -m benchmarks.fmu_models [--switches 0 8] [--records 28]``.

A motor whose resistance rises with the temperature of its winding is written in equations and exported as an
FMU. SciPy makes the log of another motor: records of 700 samples with four unknown parameters, in which the
voltage is constant, or switched eight times between two samples each; for ``diagnose`` the speed is read 2
rad/s too high. Measured are whole commands without results of earlier ones: required are 30 s for ``compare``
and 120 s for ``diagnose``, of wall time on two cores. Where others use them, the processor time of the
command and its processes tells more; half of it is the least that two cores take. Beside it stands the same
command with the equations.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.record import keep, table

Floats = NDArray[np.float64]

PERIOD, SAMPLES = 10e-3, 700
LEVELS = (-12.0, -9.0, -6.0, -3.0, 3.0, 6.0, 9.0, 12.0)
#: of the readings of speed, rad/s, in what is diagnosed
OFFSET = 2.0
REQUIRED = {"compare": 30.0, "diagnose": 120.0}
#: of the motor behind the log; the model starts elsewhere
RESISTANCE, CONSTANT, DAMPING, COOLING = 2.0, 0.05, 1e-4, 0.25

PARAMETERS = """
  resistance: {value: 1.8 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {value: 0.045 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
  damping: {value: 2e-4 N*m*s/rad, bounds: [0 N*m*s/rad, 0.1 N*m*s/rad]}
  cooling: {value: 0.2 W/K, bounds: [0.001 W/K, 100 W/K]}
"""
EQUATIONS = f"""
family: motor
states:
  current:
    start: 0 A
    scale: 1 mA
    rate: (voltage - resistance*(1 + alpha*rise)*current - kt*speed)/inductance
  speed: {{start: 0 rad/s, scale: 0.1 rad/s, rate: (kt*current - damping*speed)/inertia}}
  rise: {{start: 0 K, scale: 0.1 K, rate: (resistance*current^2 - cooling*rise)/capacity}}
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS}
constants: {{inertia: 2e-4 kg*m^2, inductance: 20 mH, capacity: 2 J/K, alpha: 0.004 1/K}}
outputs:
  current: {{unit: A, formula: current}}
  speed: {{unit: rad/s, formula: speed}}
"""
FAMILY = f"""
family: motor_fmu
fmu: motor.fmu
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS}
outputs:
  current: {{unit: A, scale: 1 mA}}
  speed: {{unit: rad/s, scale: 0.1 rad/s}}
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
  cooling: {value: 0.2 W/K, fit: true}
"""


def write_bench(folder: Path, records: int, switches: int, offset: float) -> None:
    """The files of the bench, and its log, whose speed is read too high by `offset`."""
    texts = {"equations": EQUATIONS, "family": FAMILY, "rig": RIG}
    texts |= {"model": f"model: family.yaml\n{MODEL}", "written": f"model: equations.yaml\n{MODEL}"}
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(7)
    with (folder / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "record", "voltage [V]", "current [A]", "speed [rad/s]"])
        for record in range(1, records + 1):
            for at, volts, current, speed in _record(rng, switches):
                rows.writerow([f"{at:.6g}", record, volts, f"{current:.7g}", f"{speed + offset:.7g}"])


def _record(rng: np.random.Generator, switches: int) -> Floats:
    """(samples, 4) time, voltage, current and speed; each switch acts at some time in the interval before it
    is logged."""
    times = PERIOD * np.arange(SAMPLES)
    logged = np.sort(rng.choice(np.arange(20, SAMPLES - 20, 10), switches, replace=False))
    levels = [rng.choice(LEVELS)]
    for _ in logged:
        levels.append(rng.choice([volts for volts in (0.0, *LEVELS) if volts != levels[-1]]))
    edges = [0.0, *(PERIOD * (row - rng.random()) for row in logged), times[-1] + PERIOD]
    course, state = np.zeros((SAMPLES, 3)), np.zeros(3)
    for volts, begin, end in zip(levels, edges, edges[1:], strict=False):
        inside = (times >= begin) & (times < end)
        found = solve_ivp(
            _rates, (begin, end), state, t_eval=[*times[inside], end], args=(volts,), rtol=1e-9, atol=1e-10
        )
        course[inside], state = found.y.T[:-1], found.y[:, -1]
    voltage = np.array(levels)[np.searchsorted(logged, np.arange(SAMPLES), side="right")]
    noise = rng.standard_normal((SAMPLES, 2)) * (0.01, 0.3)
    return np.column_stack([times, voltage, course[:, :2] + noise])


def _rates(t: float, state: Floats, volts: float) -> list[float]:
    current, speed, rise = state
    return [
        (volts - RESISTANCE * (1.0 + 0.004 * rise) * current - CONSTANT * speed) / 20e-3,
        (CONSTANT * current - DAMPING * speed) / 2e-4,
        (RESISTANCE * current**2 - COOLING * rise) / 2.0,
    ]


def measured(folder: Path, *arguments: str) -> dict[str, Any]:
    """Wall and processor time of a command with all its processes, s, and its answer."""
    environment = {**os.environ, "RIGCTL_RESULTS": "off"}
    wall, before = time.perf_counter(), os.times()
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", *arguments, "--json"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    after = os.times()
    if not done.stdout:
        sys.exit(done.stderr)
    answer = json.loads(done.stdout)
    return {
        "wall": time.perf_counter() - wall,
        "cpu": after.children_user + after.children_system - before.children_user - before.children_system,
        "answer": answer.get("verdict") or ("adequate" if answer["models"][0]["adequate"] else "disagrees"),
    }


def prepared(folder: Path, records: int, switches: int, offset: float) -> None:
    """The bench with its FMU and its imported run."""
    write_bench(folder, records, switches, offset)
    for arguments in (
        ("model", "export", "written.yaml", "-o", "motor.fmu"),
        ("import", "log.csv", "--rig", "rig.yaml"),
    ):
        subprocess.run(
            [sys.executable, "-m", "rigctl", *arguments], cwd=folder, check=True, capture_output=True
        )


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description="Compare and diagnose an FMU.")
    parser.add_argument("--records", type=int, default=28)
    parser.add_argument("--switches", type=int, nargs="+", default=[0, 8], help="of the command, in a record")
    parser.add_argument("--commands", nargs="+", choices=list(REQUIRED), default=list(REQUIRED))
    given = parser.parse_args()
    of_fmu = ("--model", "model.yaml", "--family", "motor.fmu")
    rows = [("switches", "command", "model", "wall, s", "processor, s", "required, s", "answer")]
    results: dict[str, Any] = {"records": given.records}
    for switches in given.switches:
        for command in given.commands:
            with TemporaryDirectory() as place:
                folder = Path(place)
                prepared(folder, given.records, switches, OFFSET if command == "diagnose" else 0.0)
                for model, arguments in (("FMU", of_fmu), ("equations", ("--model", "written.yaml"))):
                    found = measured(folder, command, "latest", *arguments)
                    results[f"{command}, {switches} switches, {model}"] = found
                    cost = f"{found['wall']:.1f}", f"{found['cpu']:.1f}"
                    required = f"{REQUIRED[command]:g}" if model == "FMU" else ""
                    rows.append((str(switches), command, model, *cost, required, found["answer"]))
                    print(" ".join(rows[-1]), flush=True)
    table(f"{given.records} records of {SAMPLES} samples", rows)
    print(f"kept in {keep(Path(__file__).parent, results, 'numpy', 'scipy', 'fmpy')}")


if __name__ == "__main__":
    main()
