"""The campaign in SciPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats, equations, shown


class ScipyPeer:
    """LSODA on compiled equations, and forward differences, the usual approach."""

    packages = ("scipy", "numba")

    def __init__(self) -> None:
        import numba

        self.system = cylinder.build()
        names: dict[str, Any] = {"exp": math.exp, "log": math.log, "sqrt": math.sqrt, "tanh": math.tanh}
        exec(equations(self.system, "({})"), names)
        compiled = numba.njit(error_model="numpy")(names["rhs"])
        self.rhs: Callable[..., Any] = lambda t, y, u, q: compiled(y, u, q)
        self.records = cylinder.campaign()
        self.atol = 1e-2 * np.array([state.scale for state in self.system.states])

    def _run(self, change: int | None = None, step: float = 0.0) -> list[Floats]:
        from scipy.integrate import solve_ivp

        outputs = []
        for record in self.records:
            q = record.parameters.copy()
            if change is not None:
                q[change] += step
            y, pieces = record.initial, [record.initial[None]]
            for k, (start, end) in enumerate(pairwise([*record.switch_times, record.times[-1]])):
                grid = record.times[(record.times > start) & (record.times <= end)]
                found = solve_ivp(
                    self.rhs,
                    (start, end),
                    y,
                    "LSODA",
                    grid,
                    args=(record.inputs[k], q),
                    rtol=1e-6,
                    atol=self.atol,
                )
                pieces.append(found.y.T)
                y = found.y[:, -1]
            outputs.append(shown(self.system, np.concatenate(pieces), q[7]))
        return outputs

    def simulate(self) -> list[Floats]:
        return self._run()

    def jacobian(self, columns: Sequence[str]) -> Floats:
        base = np.stack(self._run())
        found = []
        for name in columns:
            step = 1e-4 * cylinder.PARAMETERS[name][2]
            place = self.system.parameter_names.index(name)
            found.append((np.stack(self._run(place, step)) - base) / step)
        return np.stack(found, axis=-1)
