"""Common parts of all peers that simulate the benchmark's campaign.

All use the printed equations of one model, so that they solve the same problem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.engine import cylinder
from rigctl.engine.symbols import to_text
from rigctl.engine.system import System

Floats = NDArray[np.float64]

EIGHT = list(cylinder.NUISANCES)
OURS = "rigctl"


@dataclass(frozen=True)
class Entry:
    """The package of a peer, and its environment."""

    package: str
    module: str
    kind: str


PEERS: Mapping[str, Entry] = {
    OURS: Entry("numba", "rigctl_peer", "RigctlPeer"),
    "scipy": Entry("scipy", "scipy_peer", "ScipyPeer"),
    "casadi": Entry("casadi", "casadi_peer", "CasadiPeer"),
    "diffrax": Entry("diffrax", "diffrax_peer", "DiffraxPeer"),
}


class Peer(Protocol):
    """One way to simulate the campaign."""

    packages: tuple[str, ...]

    def simulate(self) -> Sequence[Floats] | Floats:
        """Outputs of each record (samples, outputs)."""
        ...

    def jacobian(self, columns: Sequence[str]) -> Sequence[Floats] | Floats:
        """∂outputs/∂parameters of each record (samples, outputs, columns)."""
        ...


def equations(system: System, result: str) -> str:
    """The source of ``rhs(y, u, q)``; `result` is the format of the derivatives' list: ``"({})"``."""
    lines = ["def rhs(y, u, q):"]
    for array, names in (("y", system.state_names), ("u", system.input_names), ("q", system.parameter_names)):
        lines += [f"    {name} = {array}[{place}]" for place, name in enumerate(names)]
    terms = ", ".join(to_text(expr) for expr in system.rhs)
    return "\n".join([*lines, f"    return {result.format(terms)}"])


def shown(system: System, states: Any, offset: Any) -> Any:
    """The outputs of the benchmark's model from its states (..., states), for numpy and jax alike."""
    places = [system.state_names.index(name) for name in system.output_names]
    return states[..., np.array(places)] + offset * np.array([0.0, 1.0, 0.0, 1.0])
