"""The excitation of a system in one record: initial state, commands and their times, and sample times.

In: numbers of one record, in SI. Out: an `Excitation`, frozen and checked, for `simulate`. Commands have
times of their own, apart from those of the samples: the integration ends a step exactly at each command,
and a sample at the same time shows the state before it.

When a command acted is known only to within a sample for an imported log. `shifts` tells how the times
depend on a few unknowns, by which `simulate` then differentiates. The arrays are read-only, so that the
many variants of a record in a fit, which differ in parameters, share all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigctl.engine.system import System
from rigctl.errors import RigctlError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Ramps:
    """Inputs that change continuously: linear between knots, constant beyond them.

    Attributes
    ----------
    inputs: (r) the indices of these inputs among the system's, each once.
    knots: (k) times, strictly increasing.
    values: (k, r) of each input at each of them.
    """

    inputs: Integers
    knots: Floats
    values: Floats

    def __post_init__(self) -> None:
        inputs = np.array(self.inputs, dtype=np.int64)
        object.__setattr__(self, "inputs", inputs)
        for name in ("knots", "values"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))
        problem = ""
        if self.knots.ndim != 1 or self.values.shape != (self.knots.size, inputs.size):
            problem = "each knot needs a value of each of these inputs"
        elif not (np.isfinite(self.knots).all() and np.isfinite(self.values).all()):
            problem = "a knot or a value is not finite"
        elif np.any(np.diff(self.knots) <= 0.0):
            problem = "the knots do not rise"
        elif np.unique(inputs).size != inputs.size:
            problem = "an input is there twice"
        if problem:
            raise RigctlError(f"inputs that change steadily: {problem}")


@dataclass(frozen=True)
class Excitation:
    """One record. Everything in SI, times in seconds on one axis.

    The integration starts at ``switch_times[0]``. A sample at the exact time of a switch shows the state
    before it.

    Attributes
    ----------
    times: (samples) sample times; increasing, possibly irregular or with gaps.
    switch_times: (switches) times of commands, also between samples; increasing.
    inputs: (switches, inputs) the commanded values from each of these times on.
    initial: (states) the state at ``switch_times[0]``.
    parameters: (parameters) their values in this record; record-level quantities simply differ here.
    name: the record's name in messages.
    shifts: (switches, k) derivatives of the switch times by k quantities, for which `simulate` then has
        columns; None if all times are given.
    ramps: the inputs that change continuously; the corresponding values in `inputs` are ignored.
    """

    times: Floats
    switch_times: Floats
    inputs: Floats
    initial: Floats
    parameters: Floats
    name: str = ""
    shifts: Floats | None = None
    ramps: Ramps | None = None

    def __post_init__(self) -> None:
        if self.shifts is not None:
            object.__setattr__(self, "shifts", _frozen(self.shifts))
        for name in ("times", "switch_times", "inputs", "initial", "parameters"):
            # a copy unless it is read-only already: a record with other parameters shares its other arrays
            object.__setattr__(self, name, _frozen(getattr(self, name)))
        _check_shapes(self)

    def replace(self, *, initial: ArrayLike | None = None, parameters: ArrayLike | None = None) -> Excitation:
        """This record with another initial state or other parameters."""
        return Excitation(
            self.times,
            self.switch_times,
            self.inputs,
            self.initial if initial is None else np.asarray(initial, dtype=float),
            self.parameters if parameters is None else np.asarray(parameters, dtype=float),
            self.name,
            self.shifts,
            self.ramps,
        )


def check_fits(excitation: Excitation, system: System) -> None:
    """Require that a record has the same numbers of states, inputs and parameters as the system.

    Raises
    ------
    RigctlError
        a number differs.
    """
    for what, actual, expected in (
        ("initial states", excitation.initial.size, len(system.states)),
        ("inputs", excitation.inputs.shape[1], len(system.inputs)),
        ("parameters", excitation.parameters.size, len(system.parameters)),
    ):
        if actual != expected:
            raise RigctlError(
                f"record {excitation.name or '(unnamed)'} has {actual} {what}",
                expected=f"{expected}, as the system has",
            )
    if excitation.ramps is not None and np.any(
        (excitation.ramps.inputs < 0) | (excitation.ramps.inputs >= len(system.inputs))
    ):
        raise RigctlError(f"record {excitation.name or '(unnamed)'} has a steady input that is none of them")


def _frozen(values: ArrayLike) -> Floats:
    """A contiguous read-only copy, unless it is one already."""
    array = np.asarray(values, dtype=np.float64)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, order="C")
        array.flags.writeable = False
    return array


def _check_shapes(excitation: Excitation) -> None:
    times, switches = excitation.times, excitation.switch_times
    problem = ""
    if times.ndim != 1 or switches.ndim != 1 or excitation.initial.ndim != 1:
        problem = "times, switch times and initial state must be one-dimensional"
    elif switches.size == 0:
        problem = "there is no command, not even the first"
    elif excitation.inputs.ndim != 2 or len(excitation.inputs) != switches.size:
        problem = "each switch time needs one row of inputs"
    elif not (np.isfinite(times).all() and np.isfinite(switches).all()):
        problem = "a time is not finite"
    elif np.any(np.diff(times) < 0.0) or np.any(np.diff(switches) < 0.0):
        problem = "time runs backwards"
    elif times.size and times[0] < switches[0]:
        problem = "the first sample lies before the first command"
    elif excitation.shifts is not None and (
        excitation.shifts.ndim != 2
        or len(excitation.shifts) != switches.size
        or not np.isfinite(excitation.shifts).all()
    ):
        problem = "each switch time needs one row of finite derivatives"
    if problem:
        raise RigctlError(f"record {excitation.name or '(unnamed)'}: {problem}")
