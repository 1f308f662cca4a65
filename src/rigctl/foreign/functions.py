"""A user's functions ``dx/dt = rates(t, x, u, p)`` and ``y = readings(x, u, p)`` as the program of a model.

They are called with numbers, in processes of their own: one that never returns is ended, and each core has
one. No file holds them: the user has given the functions themselves, and so has asked for them to be run.
"""

from __future__ import annotations

import base64
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from rigctl.foreign.process import PATIENCE, ProgramProcess


@dataclass(frozen=True)
class FunctionProgram:
    """Two functions with the names of what they are given and return: a `rigctl.foreign.program.Program`.

    Attributes
    ----------
    name: the model's.
    token: names these functions, whose content cannot be compared.
    code: the two, pickled; the first is None for a model without states.
    why: they are called with numbers, in a clause.
    states: of each its value at the start and a change that matters, SI.
    inputs, outputs, parameters: in order.
    sizes: of each parameter a change that matters, SI.
    settable: the outputs that read a state of the same name.
    constants: the parameters that no fit changes, SI.
    patience: longest time of one simulation, s.
    """

    name: str
    token: str
    code: bytes = field(repr=False)
    why: str
    states: Mapping[str, tuple[float, float]]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    sizes: Mapping[str, float]
    settable: tuple[str, ...]
    constants: Mapping[str, float]
    patience: float = PATIENCE

    @property
    def tunable(self) -> tuple[str, ...]:
        """All parameters: each call of a function is given them."""
        return self.parameters

    @property
    def noun(self) -> str:
        """What they are, in messages."""
        return "the functions"

    @property
    def location(self) -> None:
        """They are in no file."""

    def with_constants(self, values: Mapping[str, float]) -> Self:
        """The same with values of what no fit changes, SI."""
        return replace(self, constants=dict(values))

    def allow(self) -> None:
        """Whoever has the functions may run them."""

    def require_allowed(self) -> None:
        """Whoever has the functions may run them."""

    def process(self, patience: float | None = None) -> FunctionProcess:
        """A process that simulates them."""
        return FunctionProcess(self, self.patience if patience is None else patience)


class FunctionProcess(ProgramProcess):
    """A process that simulates a user's functions; a context."""

    def __init__(self, program: FunctionProgram, patience: float) -> None:
        slow = "Give 'time_limit' to 'Model.from_function' if they need longer"
        super().__init__("rigctl.foreign.function_worker", program.noun, patience, slow)
        self._program = program

    def setup(self, folder: Path) -> dict[str, Any]:
        """The functions, and the names of what they are given."""
        del folder
        program = self._program
        return {
            "code": base64.b85encode(program.code).decode("ascii"),
            "path": [folder for folder in sys.path if folder],
            "states": {name: list(pair) for name, pair in program.states.items()},
            "inputs": list(program.inputs),
            "outputs": list(program.outputs),
            "parameters": list(program.parameters),
            "settable": list(program.settable),
            "constants": dict(program.constants),
        }
