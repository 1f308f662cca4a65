"""Why a record could not be integrated: a result with a reason instead of a NaN."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from rigctl.engine.excitation import Excitation, Floats
from rigctl.engine.kernels import outcomes
from rigctl.engine.system import System


class Cause(StrEnum):
    """The cause of a failed integration."""

    VALUE = "value"  #: a parameter, an input or an initial state is not a finite number
    EQUATIONS = "equations"  #: a derivative is not a finite number at the point reached
    STEP = "step"  #: the step size fell below rounding: the solution does not exist beyond
    LENGTH = "length"  #: too many steps for one record
    DELAY = "delay"  #: a delay is not a finite number
    COMMANDS = "commands"  #: more commands are waiting for their delay than there is room for
    OUTPUTS = "outputs"  #: an output, or its sensitivity, is not a finite number


@dataclass(frozen=True)
class Failure:
    """Why and when an integration ended early.

    Attributes
    ----------
    cause: the kind of failure.
    reason: the reason in words, with the quantity at fault.
    time: in seconds, on the record's time axis.
    quantity: the state, parameter, input or output at fault, "" if there is none.
    """

    cause: Cause
    reason: str
    time: float
    quantity: str = ""

    def __str__(self) -> str:
        return f"{self.reason} at t = {self.time:.6g} s"


def check_values(system: System, excitation: Excitation) -> Failure | None:
    """The failure of a record with parameters, inputs or an initial state that are not finite, else None."""
    for kind, names, values in (
        ("parameter", system.parameter_names, excitation.parameters),
        ("initial state", system.state_names, excitation.initial),
        ("input", system.input_names, excitation.inputs),
    ):
        finite = np.isfinite(values)
        if not finite.all():
            wrong = np.argwhere(~finite)[0]
            name = names[wrong[-1]]
            reason = f"the {kind} {name} is {values[tuple(wrong)]}"
            return Failure(Cause.VALUE, reason, float(excitation.switch_times[0]), name)
    return None


def explain(system: System, outcome: int, time: float, counters: Sequence[int] | np.ndarray) -> Failure:
    """The failure corresponding to a kernel's outcome."""
    state = system.state_names[int(counters[outcomes.GUILTY_STATE])] if system.states else ""
    match outcome:
        case outcomes.NOT_FINITE_RHS:
            return Failure(Cause.EQUATIONS, f"the derivative of {state} is not a finite number", time, state)
        case outcomes.STEP_TOO_SMALL:
            reason = f"the step size fell below rounding: {state} changes without bound"
            return Failure(Cause.STEP, reason, time, state)
        case outcomes.TOO_MANY_STEPS:
            reason = f"too many steps: {state} or another state changes all the time"
            return Failure(Cause.LENGTH, reason, time, state)
        case outcomes.NOT_FINITE_DELAY:
            inputs = ", ".join(delay.input for delay in system.delays)
            return Failure(Cause.DELAY, f"a delay of {inputs} is not a finite number", time, inputs)
        case _:
            return Failure(Cause.COMMANDS, "too many commands wait for their delay", time)


def check_outputs(system: System, times: Floats, outputs: Floats, sensitivities: Floats) -> Failure | None:
    """The failure of a record with outputs or sensitivities that are not all finite, else None."""
    for what, values in (("output", outputs), ("sensitivity of the output", sensitivities)):
        finite = np.isfinite(values)
        if not finite.all():
            sample, output = np.argwhere(~finite)[0][:2]
            name = system.output_names[output]
            return Failure(
                Cause.OUTPUTS, f"the {what} {name} is not a finite number", float(times[sample]), name
            )
    return None
