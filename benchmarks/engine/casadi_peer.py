"""The campaign in CasADi."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats, equations, shown


class CasadiPeer:
    """CVODES with its forward sensitivities."""

    packages = ("casadi",)

    def __init__(self) -> None:
        self.system = cylinder.build()
        self.records = cylinder.campaign()
        self.sizes = np.array([100.0 * state.scale for state in self.system.states])
        self.functions: dict[tuple[str, ...], Any] = {}

    def simulate(self) -> list[Floats]:
        return [shown(self.system, states, 0.2e5) for states, _ in self._run(())]

    def jacobian(self, columns: Sequence[str]) -> list[Floats]:
        """The column of the pressure sensors' offset is known, and not integrated by CVODES."""
        moving = tuple(name for name in columns if name != "pressure_offset")
        places = [self.system.state_names.index(name) for name in self.system.output_names]
        found = []
        for _, slopes in self._run(moving):
            known = dict(zip(moving, np.moveaxis(slopes[:, places], -1, 0), strict=True))
            known["pressure_offset"] = np.broadcast_to([0.0, 1.0, 0.0, 1.0], (*slopes.shape[:1], 4))
            found.append(np.stack([known[name] for name in columns], axis=-1))
        return found

    def _run(self, columns: tuple[str, ...]) -> list[tuple[Floats, Floats]]:
        """States (samples, states) and their derivatives (samples, states, columns) of each record."""
        if columns not in self.functions:
            self.functions[columns] = self._function(columns)
        scale = np.array([cylinder.PARAMETERS[name][2] for name in columns])
        results = []
        for record in self.records:
            values = self.functions[columns](
                record.initial / self.sizes, record.inputs.T, np.zeros(len(columns))
            )
            states = np.array(values[0]).T * self.sizes
            slopes = np.array(values[1]).reshape(len(states), len(self.sizes), -1)
            results.append((states, slopes * self.sizes[:, None] / scale))
        return results

    def _function(self, columns: tuple[str, ...]) -> Any:
        """A record as one function of initial state, inputs (inputs, phases) and parameters."""
        y, u, p = ca.MX.sym("y", 7), ca.MX.sym("u", 5, 3), ca.MX.sym("p", len(columns))
        problem = self._problem(columns)
        pieces = [y]
        for phase, (seconds, _) in enumerate(cylinder.SEGMENTS):
            grid = list(np.arange(1, round(seconds * cylinder.RATE) + 1) / cylinder.RATE)
            options = {"abstol": 1e-6, "reltol": 1e-6, "max_num_steps": 100_000, "fsens_err_con": False}
            solver = ca.integrator(f"phase_{phase}", "cvodes", problem, 0.0, grid, options)
            reached = solver(x0=pieces[-1][:, -1], u=ca.repmat(u[:, phase], 1, len(grid)), p=p)
            pieces.append(reached["xf"])
        states = ca.horzcat(*pieces)
        return ca.Function("record", [y, u, p], [states, ca.jacobian(ca.vec(states), p)])

    def _problem(self, columns: tuple[str, ...]) -> dict[str, Any]:
        """The equations, with states scaled to one absolute tolerance and parameters to their sizes."""
        names: dict[str, Any] = {"exp": ca.exp, "log": ca.log, "sqrt": ca.sqrt, "tanh": ca.tanh}
        names["stack"] = ca.vertcat
        exec(equations(self.system, "stack({})"), names)
        y, u, p = ca.SX.sym("y", 7), ca.SX.sym("u", 5), ca.SX.sym("p", len(columns))
        q = [ca.SX(value) for value in self.system.nominal]
        for place, name in enumerate(columns):
            q[self.system.parameter_names.index(name)] += cylinder.PARAMETERS[name][2] * p[place]
        slope = names["rhs"](ca.vertsplit(y * self.sizes), ca.vertsplit(u), q) / self.sizes
        return {"x": y, "u": u, "p": p, "ode": slope}
