"""The solution of the equations by independent methods: Radau at 1e-9, CVODES with sensitivities.

Two records of the campaign, all 28 columns. CVODES integrates the variational equations, written down with
CasADi's derivatives, at 1e-8.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats, equations, shown
from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.system import System
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance

RECORDS = (7, 11)
COLUMNS = list(cylinder.PARAMETERS)


def ourselves() -> tuple[Floats, Floats]:
    """Outputs and all columns of the whole campaign at a tolerance of 1e-9."""
    compiled = compile_system(cylinder.build())
    tolerance = Tolerance(relative=1e-9, absolute=1e-6)
    found = simulate(compiled, cylinder.campaign(), columns=COLUMNS, tolerance=tolerance).require()
    return np.stack(found.outputs), np.stack(found.sensitivities)


def results() -> dict[str, Any]:
    """The errors of both tolerances, as shares of an output's peak and of a column's length."""
    compiled = compile_system(cylinder.build())
    records = [cylinder.campaign()[number] for number in RECORDS]
    exact = [radau(compiled.system, record) for record in records]
    slopes = columns_by_cvodes(compiled.system, records)
    found: dict[str, Any] = {"records": list(RECORDS)}
    for name, tolerance in (("default", DEFAULT), ("tight", TIGHT)):
        ours = simulate(compiled, records, columns=COLUMNS, tolerance=tolerance).require()
        peaks = [
            np.abs(a - b).max(axis=0) / np.abs(b).max(axis=0)
            for a, b in zip(ours.outputs, exact, strict=True)
        ]
        found[name] = {"output_error": float(np.max(peaks))}
        if slopes is not None:
            errors = column_errors(ours.sensitivities, slopes)
            found[name] |= {
                "columns": len(errors),
                "column_error_median": float(np.median(errors)),
                "column_error_largest": float(errors.max()),
            }
    return found


def column_errors(ours: tuple[Floats, ...], exact: list[Floats]) -> Floats:
    """L2 errors of every column of every output of every record; a column that is 0 has none."""
    found = []
    for a, b in zip(ours, exact, strict=True):
        wrong, whole = np.linalg.norm(a - b, axis=0), np.linalg.norm(b, axis=0)
        found.append((wrong / np.where(whole > 0.0, whole, 1.0))[whole > 0.0])
    return np.concatenate(found)


def radau(system: System, record: Excitation) -> Floats:
    """Outputs (samples, outputs) by SciPy's Radau at 1e-9, on the printed equations."""
    import numba
    from scipy.integrate import solve_ivp

    names: dict[str, Any] = {"exp": math.exp, "log": math.log, "sqrt": math.sqrt, "tanh": math.tanh}
    exec(equations(system, "({})"), names)
    rhs = numba.njit(error_model="numpy")(names["rhs"])
    y, pieces = record.initial, [record.initial[None]]
    for k, (start, end) in enumerate(pairwise([*record.switch_times, record.times[-1]])):
        grid = record.times[(record.times > start) & (record.times <= end)]
        tolerance = 1e-6 * np.array([state.scale for state in system.states])
        found = solve_ivp(
            lambda _, y, u: rhs(y, u, record.parameters), (start, end), y, "Radau", grid,
            args=(record.inputs[k],), rtol=1e-9, atol=tolerance,
        )  # fmt: skip
        pieces.append(found.y.T)
        y = found.y[:, -1]
    return np.asarray(shown(system, np.concatenate(pieces), cylinder.PARAMETERS["pressure_offset"][1]))


def columns_by_cvodes(system: System, records: list[Excitation]) -> list[Floats] | None:
    """∂outputs/∂parameters (samples, outputs, columns) of each record; None without CasADi."""
    try:
        import casadi as ca
    except ImportError:
        return None
    count, states = len(COLUMNS), len(system.states)
    sizes = 100.0 * np.array([state.scale for state in system.states])
    scale = np.array([cylinder.PARAMETERS[name][2] for name in COLUMNS])
    names: dict[str, Any] = {"exp": ca.exp, "log": ca.log, "sqrt": ca.sqrt, "tanh": ca.tanh}
    names["stack"] = ca.vertcat
    exec(equations(system, "stack({})"), names)
    y, u, q = ca.SX.sym("y", states), ca.SX.sym("u", len(system.inputs)), ca.SX.sym("q", count)
    rate = names["rhs"](ca.vertsplit(y * sizes), ca.vertsplit(u), ca.vertsplit(q * scale)) / sizes
    s = ca.SX.sym("s", states, count)
    variation = ca.jacobian(rate, y) @ s + ca.jacobian(rate, q)
    nominal = ca.DM(np.array(system.nominal) / scale)
    problem = {"x": ca.vertcat(y, ca.vec(s)), "p": u}
    problem["ode"] = ca.substitute(ca.vertcat(rate, ca.vec(variation)), q, nominal)
    return [cvodes(problem, record, sizes, scale, system) for record in records]


def cvodes(
    problem: dict[str, Any], record: Excitation, sizes: Floats, scale: Floats, system: System
) -> Floats:
    import casadi as ca

    states, count = len(sizes), len(scale)
    state = np.concatenate([record.initial / sizes, np.zeros(states * count)])
    pieces = [state[:, None]]
    for k, (start, end) in enumerate(pairwise([*record.switch_times, record.times[-1]])):
        grid = list(record.times[(record.times > start) & (record.times <= end)])
        options = {"abstol": 1e-9, "reltol": 1e-8, "max_num_steps": 200_000}
        solver = ca.integrator("solver", "cvodes", problem, start, grid, options)
        pieces.append(np.array(solver(x0=state, p=record.inputs[k])["xf"]))
        state = pieces[-1][:, -1]
    flat = np.concatenate(pieces, axis=1)[states:]
    slopes = flat.reshape(count, states, -1).transpose(2, 1, 0) * sizes[:, None] / scale
    seen = slopes[:, [system.state_names.index(name) for name in system.output_names]].copy()
    # the pressure sensors' offset is in no equation of motion
    for row, name in enumerate(system.output_names):
        if name in ("supply", "pressure_cap"):
            seen[:, row, COLUMNS.index("pressure_offset")] = 1.0
    return seen
