"""The campaign in this engine."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats
from rigctl.engine.compile import compile_system
from rigctl.engine.simulate import simulate


class RigctlPeer:
    """This engine."""

    packages = ("numba", "llvmlite")

    def __init__(self) -> None:
        self.compiled = compile_system(cylinder.build())
        self.records = cylinder.campaign()

    def simulate(self) -> Sequence[Floats]:
        return simulate(self.compiled, self.records).require().outputs

    def jacobian(self, columns: Sequence[str]) -> Sequence[Floats]:
        return simulate(self.compiled, self.records, columns=columns).require().sensitivities
