"""The result of simulating records."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from rigctl.engine.excitation import Floats
from rigctl.engine.failure import Failure
from rigctl.engine.kernels import outcomes
from rigctl.errors import ExitCode, RigctlError, unknown_name


@dataclass(frozen=True)
class Statistics:
    """The computational work for one record."""

    steps: int
    rejected: int
    restarts: int

    @classmethod
    def of(cls, counters: Sequence[int] | np.ndarray) -> Statistics:
        """The statistics in a kernel's counters."""
        return cls(
            int(counters[outcomes.STEPS]),
            int(counters[outcomes.REJECTED]),
            int(counters[outcomes.RESTARTS]),
        )


class OfEachRecord(Sequence[Floats]):
    """Derivatives of all records, each computed when it is first used: see `of`."""

    @overload
    def __getitem__(self, index: int) -> Floats: ...
    @overload
    def __getitem__(self, index: slice) -> list[Floats]: ...
    def __getitem__(self, index: int | slice) -> Floats | list[Floats]:
        if isinstance(index, slice):
            return [self.of(k) for k in range(*index.indices(len(self)))]
        return self.of(range(len(self))[index])

    @abstractmethod
    def of(self, record: int) -> Floats:
        """(n, outputs, columns) of a record."""


@dataclass(frozen=True)
class Trajectories:
    """Simulated records, one array per record, SI.

    A record that failed ends before the first sample that could not be reached.

    Attributes
    ----------
    names: the records' names.
    times: (samples) of each record.
    states: (samples, states).
    outputs: (samples, outputs).
    sensitivities: (samples, outputs, columns); no columns unless requested.
    failures: why each record ended early; None if it did not.
    state_names, output_names, columns: names of the entries along each axis.
    stats: the computational work for each record.
    """

    names: tuple[str, ...]
    times: tuple[Floats, ...]
    states: tuple[Floats, ...]
    outputs: tuple[Floats, ...]
    sensitivities: Sequence[Floats]
    failures: tuple[Failure | None, ...]
    state_names: tuple[str, ...]
    output_names: tuple[str, ...]
    columns: tuple[str, ...]
    stats: tuple[Statistics, ...]

    @property
    def ok(self) -> bool:
        """True when every record was integrated to its end."""
        return not any(self.failures)

    def require(self) -> Trajectories:
        """These trajectories, if all of them are complete.

        Raises
        ------
        RigctlError
            a record failed; the message names the first one and the reason.
        """
        for number, failure in enumerate(self.failures):
            if failure is not None:
                raise RigctlError(
                    f"record {self._label(number)} could not be simulated: {failure}",
                    exit_code=ExitCode.FAILED,
                )
        return self

    def output(self, name: str) -> tuple[Floats, ...]:
        """One output of every record, (samples) each.

        Raises
        ------
        RigctlError
            there is no such output.
        """
        index = _place("output", name, self.output_names)
        return tuple(outputs[:, index] for outputs in self.outputs)

    def sensitivity(self, output: str, column: str) -> tuple[Floats, ...]:
        """``∂(output)/∂(column)`` of every record, (samples) each.

        Raises
        ------
        RigctlError
            there is no such output, or the column was not requested.
        """
        index, c = _place("output", output, self.output_names), _place("column", column, self.columns)
        return tuple(sensitivities[:, index, c] for sensitivities in self.sensitivities)

    def summary(self) -> str:
        """One paragraph: how much was simulated, the work, and every failure."""
        samples = sum(len(times) for times in self.times)
        steps = sum(one.steps for one in self.stats)
        rejected = sum(one.rejected for one in self.stats)
        lines = [
            f"{len(self.names)} records, {samples} samples of {', '.join(self.output_names)}; "
            f"{steps} steps, {rejected} rejected"
            + (f"; sensitivities to {', '.join(self.columns)}" if self.columns else "")
        ]
        lines += [
            f"record {self._label(number)} failed: {failure}"
            for number, failure in enumerate(self.failures)
            if failure is not None
        ]
        return "\n".join(lines)

    def _label(self, number: int) -> str:
        return self.names[number] or str(number + 1)


def _place(kind: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise unknown_name(kind, name, names)
    return list(names).index(name)
