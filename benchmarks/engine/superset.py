"""The shipped cylinder and rig with the whole library at null, as differentiated by a diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.engine.common import Floats
from benchmarks.engine.timing import best
from rigctl.effects.registry import library
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.system import System
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.files.shipped import shipped
from rigctl.model import build_system, superset
from rigctl.physics.families import find_family
from rigctl.rig import Rig
from rigctl.rig.load import load_rig

FAMILY = "hydraulic_cylinder"
RIG = "hl32-bench-instrumented.yaml"
BAR = 1e5
#: relative changes of a reading below this are rounding
ROUNDING = 1e-12
SEGMENTS = ((0.0, 1.0), (2.5, 0.0), (4.5, -1.0))
CONDITIONS = [(celsius, bar) for celsius in range(20, 51, 5) for bar in range(20, 51, 10)]


def rig() -> Rig:
    """The bench with a transducer at each side of the cylinder."""
    return load_rig(shipped("rigs", RIG))


def build(bench: Rig | None = None) -> System:
    """The family's equations with every effect of the library in them."""
    return build_system(FAMILY, superset(FAMILY), bench or rig())


def campaign(system: System, records: int = len(CONDITIONS)) -> list[Excitation]:
    """7 s at 100 Hz each: extend, hold, retract, at seven temperatures and four pressures."""
    times = np.arange(701) / 100.0
    switch_times = np.array([start for start, _ in SEGMENTS])
    found = []
    for number in range(records):
        celsius, bar = CONDITIONS[number % len(CONDITIONS)]
        given = {"pressure_setpoint": bar * BAR, "ambient_temperature": 295.15, "pump": 1.0}
        rows = [
            [valve if name == "valve" else given.get(name, 0.0) for name in system.input_names]
            for _, valve in SEGMENTS
        ]
        start = {"oil_temperature": celsius + 273.15, "supply_pressure": bar * BAR, "position": 0.005}
        start |= {"pressure_a": 7.5 * BAR, "pressure_b": 10.0 * BAR}
        initial = [start.get(name, 0.0) for name in system.state_names]
        name = f"{celsius} degC, {bar} bar"
        found.append(Excitation(times, switch_times, np.array(rows), initial, system.nominal, name))
    return found


def results(runs: int = 5) -> dict[str, Any]:
    """Seconds of a simulation and of all columns, and the errors at each tolerance."""
    compiled = compile_system(build())
    system = compiled.system
    records, columns = campaign(system), list(system.parameter_names)
    return {
        "rig": RIG,
        "states": len(system.states),
        "columns": len(columns),
        "outputs": len(system.outputs),
        "simulate": best(lambda: simulate(compiled, records).require(), runs),
        "all_columns": best(lambda: simulate(compiled, records, columns=columns).require(), runs),
        **errors(compiled, records, columns),
    }


def errors(
    compiled: CompiledSystem, records: list[Excitation], columns: list[str]
) -> dict[str, dict[str, float]]:
    """Each tolerance against 1e-9: outputs as a share of the peak, columns in L2 over all records."""
    finest = simulate(compiled, records, columns=columns, tolerance=Tolerance(1e-9, 1e-6)).require()
    exact, slopes = np.stack(finest.outputs), np.stack(finest.sensitivities)
    acts = lengths(slopes) * typical_sizes(columns, compiled.system) > ROUNDING * lengths(exact)[:, None]
    found = {}
    for name, tolerance in (("default", DEFAULT), ("tight", TIGHT)):
        ours = simulate(compiled, records, columns=columns, tolerance=tolerance).require()
        wrong = np.abs(np.stack(ours.outputs) - exact)
        peak = np.abs(exact).max(axis=(0, 1))
        off = lengths(np.stack(ours.sensitivities) - slopes) / np.maximum(lengths(slopes), 1e-300)
        acting = off[acts]
        found[name] = {
            "output_error": float((wrong.max(axis=(0, 1)) / peak).max()),
            "output_error_rms": float((np.sqrt(np.square(wrong).mean(axis=(0, 1))) / peak).max()),
            "column_error_median": float(np.median(acting)),
            "column_error_largest": float(acting.max()),
            "columns_that_act": int(acts.any(axis=0).sum()),
        }
    return found


def typical_sizes(columns: list[str], system: System) -> Floats:
    """(columns): typical deviation of each parameter from its value; one unit if not declared."""
    effects = library(find_family(FAMILY))
    found = []
    for name, value in zip(columns, system.nominal, strict=True):
        effect, _, own = name.partition(".")
        parameter = effects[effect].parameter(own) if own else None
        found.append(abs(value) if parameter is None else abs(parameter.start - parameter.at_null))
    return np.array([size or 1.0 for size in found])


def lengths(columns: Floats) -> Floats:
    """(outputs, columns) or (outputs): L2 over records and samples."""
    return np.sqrt(np.square(columns).sum(axis=(0, 1)))
