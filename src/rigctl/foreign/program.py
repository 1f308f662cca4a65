"""A program that computes a part of a model, as the engine knows it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol, Self

from rigctl.errors import Location
from rigctl.foreign.process import ProgramProcess


class Program(Protocol):
    """A program with its connected variables, by their names in the model.

    Its `repr` names its content: two programs that have the same one compute the same.
    """

    @property
    def name(self) -> str:
        """Its name in messages, as of a file."""
        ...

    @property
    def noun(self) -> str:
        """What it is, in messages: "the FMU"."""
        ...

    @property
    def why(self) -> str:
        """Why nothing is looked for inside it, in a clause; "" if that needs no reason."""
        ...

    @property
    def location(self) -> Location | None:
        """Its file, if it has one."""
        ...

    @property
    def inputs(self) -> Collection[str]:
        """Its inputs, in order."""
        ...

    @property
    def outputs(self) -> Collection[str]:
        """Its outputs, in order."""
        ...

    @property
    def parameters(self) -> Collection[str]:
        """Its parameters, in order."""
        ...

    @property
    def tunable(self) -> Collection[str]:
        """The parameters that can change during a simulation, in the order of the parameters."""
        ...

    @property
    def sizes(self) -> Mapping[str, float]:
        """Of each parameter a change that matters, SI."""
        ...

    @property
    def settable(self) -> Collection[str]:
        """The outputs whose value at the start can be set, in the order of the outputs."""
        ...

    def with_constants(self, values: Mapping[str, float]) -> Self:
        """The program with values of what no fit changes, SI."""
        ...

    def allow(self) -> None:
        """Let it run in this process and those that it starts."""
        ...

    def require_allowed(self) -> None:
        """Refuse to run a program that only a file names.

        Raises
        ------
        RigctlError
            the user has not asked for it.
        """
        ...

    def process(self, patience: float | None = None) -> ProgramProcess:
        """A process that simulates it: see `ProgramProcess.request` for the order of its numbers.

        Parameters
        ----------
        patience: longest time of one simulation, s; by default its own.
        """
        ...
