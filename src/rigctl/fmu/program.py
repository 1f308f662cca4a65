"""An FMU as a part of a model: which of its variables are connected, and whether it may run.

An FMU is a program with the user's permissions. A file that names one never makes it run: the user names the
FMU itself on the command line (`allow`), as for a family of models in Python. What is allowed is its content.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rigctl.errors import Location, RigctlError
from rigctl.fmu.description import Kind, Port
from rigctl.fmu.process import FmuProcess
from rigctl.foreign.process import PATIENCE

#: SHA-256 of the FMUs that the user has named in this command
_ALLOWED: set[str] = set()


@dataclass(frozen=True)
class FmuProgram:
    """An FMU with its connected variables, by their names in the model: a `rigctl.foreign.program.Program`.

    Attributes
    ----------
    path, sha256: of the file.
    kind: how it is simulated.
    inputs, outputs, parameters: those that the model uses, in order.
    sizes: of each parameter a change that matters, SI.
    starts: of each output the variable that sets its value at the start; None if it cannot be set.
    tunable: the parameters that can be set during a simulation, in order.
    """

    path: Path
    sha256: str
    kind: Kind
    inputs: Mapping[str, Port]
    outputs: Mapping[str, Port]
    parameters: Mapping[str, Port]
    sizes: Mapping[str, float]
    starts: Mapping[str, Port | None]
    tunable: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Of its file."""
        return self.path.name

    @property
    def noun(self) -> str:
        """What it is, in messages."""
        return "the FMU"

    @property
    def why(self) -> str:
        """Nothing to say: nobody expects to see the inside of an FMU."""
        return ""

    @property
    def location(self) -> Location:
        """Its file."""
        return Location(self.path)

    @property
    def settable(self) -> tuple[str, ...]:
        """The outputs whose value at the start can be set."""
        return tuple(name for name, port in self.starts.items() if port is not None)

    def with_constants(self, values: Mapping[str, float]) -> Self:
        """The FMU itself: what no fit changes keeps the value that it has in the FMU."""
        del values
        return self

    def allow(self) -> None:
        """Let it run in this process and those that it starts."""
        allow(self.sha256)

    def require_allowed(self) -> None:
        """Refuse to run an FMU that only a file names.

        Raises
        ------
        RigctlError
            the user has not named it, or it has changed since its family file was read.
        """
        if self.sha256 not in _ALLOWED:
            raise RigctlError(
                "an FMU is a program, and is not run because a file names it",
                where=self.location,
                hint=f"If you trust it, name it on the command line: '--family {self.path.as_posix()}'",
            )

    def process(self, patience: float | None = None) -> FmuProcess:
        """A process that simulates it."""
        return FmuProcess(
            self.path,
            self.kind,
            list(self.inputs.values()),
            list(self.outputs.values()),
            [*self.parameters.values(), *(one for one in self.starts.values() if one is not None)],
            tunable=[self.parameters[name] for name in self.tunable],
            patience=PATIENCE if patience is None else patience,
            sha256=self.sha256,
        )


def allow(sha256: str) -> None:
    """Let the FMU with this content run in this process and those that it starts."""
    _ALLOWED.add(sha256)
