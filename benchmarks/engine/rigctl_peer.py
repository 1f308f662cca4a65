"""The campaign in this engine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats
from rigctl.engine.compile import compile_system
from rigctl.engine.simulate import simulate
from rigctl.engine.tolerance import Tolerance


class RigctlPeer:
    """This engine."""

    name = "rigctl (ESDIRK3(2), exact tangents)"
    packages = ("numba", "llvmlite")

    def __init__(self) -> None:
        self.compiled = compile_system(cylinder.build())
        self.records = cylinder.campaign()

    def simulate(self) -> Floats:
        return np.stack(simulate(self.compiled, self.records).require().outputs)

    def jacobian(self, columns: Sequence[str]) -> Floats:
        return np.stack(simulate(self.compiled, self.records, columns=columns).require().sensitivities)

    def exact(self) -> tuple[Floats, Floats]:
        """Outputs and the first 8 columns at a tolerance of 1e-9, which the tests hold to other solvers."""
        columns = list(cylinder.NUISANCES)
        tolerance = Tolerance(relative=1e-9, absolute=1e-6)
        found = simulate(self.compiled, self.records, columns=columns, tolerance=tolerance).require()
        return np.stack(found.outputs), np.stack(found.sensitivities)
