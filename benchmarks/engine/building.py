"""From an installation that has compiled nothing to a model that runs, and what later starts cost.

    python -m benchmarks.engine.building

Each start is a new process with a new cache. Imports are given separately: they are the same for all.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time

STAGES = ("imports", "integrator", "superset", "own_effect", "cached")


def results(runs: int = 2) -> dict[str, dict[str, float]]:
    """Wall and CPU time of each stage, s, the shortest with `runs` fresh caches."""
    runs_of: dict[str, list[dict[str, float]]] = {stage: [] for stage in STAGES}
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "RIGCTL_CACHE_DIR": folder}
            cold, cached = (
                json.loads(
                    subprocess.run(
                        [sys.executable, "-m", "benchmarks.engine.building"],
                        env=environment, check=True, capture_output=True, text=True,
                    ).stdout.splitlines()[-1]
                )
                for _ in range(2)
            )  # fmt: skip
        runs_of["imports"].append(cached["imports"])
        for stage in ("integrator", "superset", "own_effect"):
            runs_of[stage].append(cold[stage])
        # a later process loads integrator and model together
        both = [cached["integrator"], cached["superset"]]
        runs_of["cached"].append({kind: sum(one[kind] for one in both) for kind in ("wall", "cpu")})
    return {
        stage: {kind: min(one[kind] for one in found) for kind in ("wall", "cpu")}
        for stage, found in runs_of.items()
    }


def one_start() -> dict[str, dict[str, float]]:
    """The stages in this process, with whatever the cache has."""
    found: dict[str, dict[str, float]] = {}

    def stage(name: str, wall: float, cpu: float) -> tuple[float, float]:
        now, used = time.perf_counter(), time.process_time()
        found[name] = {"wall": now - wall, "cpu": used - cpu}
        return now, used

    start = time.perf_counter(), time.process_time()
    from benchmarks.engine import superset
    from rigctl.effects.user import load_effect
    from rigctl.engine import simulate, straight_line  # noqa: F401
    from rigctl.engine.compile import compile_system
    from rigctl.engine.system import SystemBuilder
    from rigctl.files.shipped import shipped
    from rigctl.model import build_system
    from rigctl.model import superset as whole_library

    bench = superset.rig()
    start = stage("imports", *start)
    builder = SystemBuilder()
    x = builder.state("x", "m", scale=1e-2)
    builder.equation("x", -x / builder.constant(1.0, "s"))
    builder.output("x", "m", x)
    smallest = builder.build()
    compile_system(smallest)
    start = stage("integrator", *start)
    compile_system(superset.build(bench))
    start = stage("superset", *start)
    effect = load_effect(shipped("models", "effects", "piston-leakage-eccentric.yaml"))
    chosen = whole_library(superset.FAMILY) | {effect.name: effect.null}
    compile_system(build_system(superset.FAMILY, chosen, bench, own_effects=[effect]))
    stage("own_effect", *start)
    return found


if __name__ == "__main__":
    print(json.dumps(one_start()))
