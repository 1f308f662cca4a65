"""How right are the exponents that a diagnosis claims? ``python -m benchmarks.laws``

A flywheel whose air drags with a power of its speed, integrated by SciPy and written as a log; the model's
only effect has the square. Printed of each draw of the noise: how large the effect is, in sigmas, the
exponent by the linear problem and by the fit, and how far off the fit is in its own standard deviations.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.record import table

FAMILY = """
family: flywheel
generic_effects: false
states:
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: (gain*drive - drag)/inertia}
inputs: {drive: {value: 0 V}}
parameters:
  gain: {value: 0.05 N*m/V, bounds: [0.001 N*m/V, 1 N*m/V]}
constants: {inertia: 2e-3 kg*m^2}
slots:
  drag: {unit: N*m, meaning: against the rotation}
outputs: {speed: {unit: rad/s, formula: speed}}
"""
RIG = """
name: flywheel
model: flywheel.yaml
channels: {speed: {unit: rad/s, quantity: other, noise: NOISE rad/s}}
actuators: {drive: {kind: level, unit: V, low: -12 V, high: 12 V}}
safe_state: {drive: 0 V}
"""
FAN = """
effect: fan
family: flywheel.yaml
summary: The air drags with the square of the speed.
slot: drag
term: size*speed*absolute(speed, 0.1 rad/s)
parameters:
  size: {null_value: 0 N*m*s^2/rad^2, start: 1e-5 N*m*s^2/rad^2, bounds: [0 N*m*s^2/rad^2, 1 N*m*s^2/rad^2]}
"""
MODEL = """
model: flywheel.yaml
rig: rig.yaml
own_effects: [fan.yaml]
parameters: {gain: {value: 0.05 N*m/V, fit: true}}
"""


def write(folder: Path, exponent: float, drag: float, noise: float, seed: int) -> None:
    """The bench's files and its log: spun up by five voltages, and left to coast."""
    texts = {"flywheel": FAMILY, "rig": RIG.replace("NOISE", f"{noise}"), "fan": FAN, "model": MODEL}
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    rng, times = np.random.default_rng(seed), np.arange(0.0, 10.0, 0.1)
    strong = drag > 0.1  # N·m at 100 rad/s
    volts = (2.0, 4.0, 6.0, 9.0, 12.0) if strong else (0.2, 0.4, 0.6, 0.9, 1.2)
    with (folder / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "record", "drive [V]", "speed [rad/s]"])
        for record, (drive, start) in enumerate([*((one, 0.0) for one in volts), (0.0, 200.0)], start=1):

            def rate(t: float, y: list[float], drive: float = drive) -> list[float]:
                force = drag * float(np.sign(y[0])) * abs(y[0] / 100.0) ** exponent
                return [(0.05 * drive - force) / 2e-3]

            found = solve_ivp(rate, (0.0, 10.0), [start], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.05)
            for time, speed in zip(times, found.y[0] + noise * rng.standard_normal(times.size), strict=True):
                rows.writerow([f"{time:.3f}", record, drive, f"{speed:.4f}"])


def attempt(exponent: float, drag: float, noise: float, seed: int) -> tuple[list[str], float]:
    """A row of the table, and the error of the exponent in its standard deviations."""
    import rigctl
    from rigctl.analysis.asked_laws import asked_laws
    from rigctl.analysis.search import Search
    from rigctl.dataset.importing import import_file
    from rigctl.rig import load_rig

    with TemporaryDirectory() as name:
        folder = Path(name)
        write(folder, exponent, drag, noise, seed)
        os.chdir(folder)
        brought = import_file(folder / "log.csv", load_rig(folder / "rig.yaml"), folder / "runs")
        found = rigctl.diagnose([rigctl.open_run(brought.run)], rigctl.load_model(folder / "model.yaml"))
        os.chdir("/")
    (law,) = found.laws
    (linear,) = asked_laws(Search(found.before, found.before.whole), found.best)
    off = (law.exponent - exponent) / law.exponent_std
    size = next(one.size for one in found.ranking if one.effect == "fan")
    by_bends = f"{2.0 + linear.change:.4f} ± {linear.change_std:.4f}"
    fitted = f"{law.exponent:.4f} ± {law.exponent_std:.4f}"
    told = "told" if law.power is not None else "not told from 2"
    return [f"{exponent:g}", f"{size:.0f}", by_bends, fitted, told, f"{off:+.1f}"], off


def main() -> int:
    """Carry out and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="draws of the noise of each kind")
    asked = parser.parse_args()
    rows, errors = [], []
    for exponent, drag, noise in ((1.6, 0.3, 0.05), (1.6, 1e-3, 0.5), (1.3, 1e-3, 0.5), (2.0, 1e-3, 0.5)):
        for seed in range(asked.seeds):
            row, off = attempt(exponent, drag, noise, 20 + seed)
            rows.append(row)
            errors.append(off)
    heads = ["truth", "sigmas", "by the bends", "fitted", "", "error/std"]
    table("Exponents", [heads, *rows])
    print(f"root mean square of the last column: {math.sqrt(sum(e * e for e in errors) / len(errors)):.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
