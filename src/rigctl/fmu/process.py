"""The process that simulates an FMU.

In: an FMU, its connected variables, and simulations in SI. Out: rows of outputs in SI, or when and why it
failed. This is the side of rigctl; the other side is `rigctl.fmu.worker`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_bytes
from rigctl.fmu.archive import digest
from rigctl.fmu.description import Kind, Port
from rigctl.foreign.process import PATIENCE, ProgramProcess

Floats = NDArray[np.float64]


class FmuProcess(ProgramProcess):
    """A process that simulates one FMU, and the folder in which it is unpacked; a context.

    Parameters
    ----------
    path, kind: of the FMU, and how it is simulated.
    inputs, outputs: the variables that are connected.
    starts: those that are set before a simulation.
    tunable: the parameters that drives may have columns for, after those of the inputs.
    patience: longest time of one simulation, s.
    slow: what to do if that is too short.
    sha256: of the FMU that may be run: a private copy is, so that nothing else is.
    """

    def __init__(
        self,
        path: Path,
        kind: Kind,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        starts: Sequence[Port],
        *,
        tunable: Sequence[Port] = (),
        patience: float = PATIENCE,
        slow: str = "",
        sha256: str = "",
    ) -> None:
        super().__init__("rigctl.fmu.worker", "the FMU", patience, slow, Location(path))
        self._path, self._kind, self._sha256 = path, kind, sha256
        self._given, self._outputs, self._starts = [*inputs, *tunable], outputs, starts
        self._of_given, self._of_outputs, self._of_starts = map(_scale, (self._given, outputs, starts))

    def setup(self, folder: Path) -> dict[str, Any]:
        """The FMU, and its connected variables."""
        path = self._path.resolve()
        if self._sha256:
            copy = folder / path.name
            copy.write_bytes(read_bytes(path))
            if digest(copy) != self._sha256:
                raise RigctlError("the FMU has changed meanwhile", where=Location(self._path))
            path = copy
        return {
            "fmu": str(path),
            "folder": str(folder / "unpacked"),
            "kind": self._kind,
            "given": [one.reference for one in self._given],
            "outputs": [one.reference for one in self._outputs],
            "starts": [one.reference for one in self._starts],
            "names": [one.name for one in self._outputs],
        }

    def simulate(
        self, where: str, which: str, points: Floats, drives: Floats, starts: Mapping[str, float]
    ) -> Floats:
        """The outputs at each point in time, SI: (points, outputs).

        Parameters
        ----------
        where, which: the record and the simulation, for messages.
        points: (n) s, increasing.
        drives: (n, inputs) held from each point to the next, SI.
        starts: by variable, what is set before it begins, SI.

        Raises
        ------
        RigctlError
            the FMU fails, returns what is no finite number, crashes, or does not return in time.
        """
        values = np.array([starts.get(one.name, np.nan) for one in self._starts], dtype=np.float64)
        reason, rows = self.attempt(which, points, drives, values)
        if reason:
            raise RigctlError(f"the FMU failed in {where} at {reason}", where=Location(self._path))
        return rows

    def attempt(self, which: str, points: Floats, drives: Floats, starts: Floats) -> tuple[str, Floats]:
        """When and why the FMU fails, "" if it does not, and its outputs until then, NaN from there on.

        Parameters
        ----------
        starts: in the order of the variables that are set; NaN where the FMU's own value is to hold.

        Raises
        ------
        RigctlError
            the FMU crashes, or does not return in time.
        """
        self.request(points, drives, starts)
        return self.result(which)

    def request(self, points: Floats, drives: Floats, starts: Floats) -> None:
        """Ask for a simulation: see `ProgramProcess`."""
        factors, offsets = (each[: drives.shape[1]] for each in self._of_given)
        super().request(points, _written((factors, offsets), drives), _written(self._of_starts, starts))

    def result(self, which: str) -> tuple[str, Floats]:
        """The next result: see `ProgramProcess`."""
        reason, rows = super().result(which)
        factors, offsets = self._of_outputs
        return reason, np.asarray(rows * factors + offsets)


def _scale(ports: Sequence[Port]) -> tuple[Floats, Floats]:
    return np.array([one.factor for one in ports]), np.array([one.offset for one in ports])


def _written(scale: tuple[Floats, Floats], values: Floats) -> Floats:
    """SI values in the FMU's units."""
    factors, offsets = scale
    return np.asarray((values - offsets) / factors)
