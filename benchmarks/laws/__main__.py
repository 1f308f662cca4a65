"""Accuracy of the exponents claimed by a diagnosis: ``python -m benchmarks.laws``

A flywheel with air drag that is a power of its speed, integrated by SciPy and written as a log; the model's
only effect is quadratic. Printed for each draw of the noise: the size of the effect in sigmas, the exponent
by the linear problem and by the fit, and the error of the fit in its standard deviations.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.record import table

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))  # the flywheel is part of the tests
import flywheel


def attempt(exponent: float, drag: float, noise: float, seed: int) -> tuple[list[str], float]:
    """A row of the table, and the error of the exponent in its standard deviations."""
    import rigctl
    from rigctl.analysis.laws.posterior import estimated_laws
    from rigctl.analysis.search.search import Search
    from rigctl.dataset.importing import import_file
    from rigctl.rig import load_rig

    with TemporaryDirectory() as name:
        folder = Path(name)
        volts = flywheel.FAST if drag > 0.1 else flywheel.SLOW
        torque = partial(flywheel.drag, exponent=exponent, at_100=drag)
        flywheel.write_bench(folder, torque, seed=seed, noise=noise, volts=volts)
        os.chdir(folder)
        brought = import_file(folder / "log.csv", load_rig(folder / "rig.yaml"), folder / "runs")
        found = rigctl.diagnose([rigctl.open_run(brought.run)], rigctl.load_model(folder / "model.yaml"))
        os.chdir("/")
    (law,) = found.laws
    (linear,) = estimated_laws(Search(found.before, found.before.whole), found.best)
    off = (law.exponent - exponent) / law.exponent_std
    size = next(one.size for one in found.ranking if one.effect == "fan")
    by_splines = f"{2.0 + linear.change:.4f} ± {linear.change_std:.4f}"
    fitted = f"{law.exponent:.4f} ± {law.exponent_std:.4f}"
    told = "told" if law.power is not None else "not told from 2"
    return [f"{exponent:g}", f"{size:.0f}", by_splines, fitted, told, f"{off:+.1f}"], off


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
    heads = ["truth", "sigmas", "by splines", "fitted", "", "error/std"]
    table("Exponents", [heads, *rows])
    print(f"root mean square of the last column: {math.sqrt(sum(e * e for e in errors) / len(errors)):.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
