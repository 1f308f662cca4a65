"""A system advanced step by step, as a bench that is observed and commanded while it runs.

In: a compiled system, its state, and commands as they come. Out: states and outputs at the times to which
it is advanced. `simulate` integrates a record whose commands are all known; a simulated bench learns of
each only when a step of a procedure gives it. Equations, delays and step formulas are the same.

All arrays live as long as the `Stepper`, and a call changes only what is in them, so that reading a state
costs no call into the kernel. The same calls give the same numbers, bit for bit.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence
from itertools import count

import numpy as np
from numpy.typing import ArrayLike

from rigctl.engine.compile import CompiledSystem, words_of
from rigctl.engine.excitation import Floats
from rigctl.engine.failure import explain
from rigctl.engine.guards import Result, Workspace, width
from rigctl.engine.kernels import outcomes
from rigctl.engine.kernels import sizes as sizing
from rigctl.engine.simulate import delayed_inputs, tolerances
from rigctl.engine.tolerance import DEFAULT, Tolerance
from rigctl.errors import ExitCode, RigctlError, unknown_name

_WAITING_COMMANDS = 64

# indices in the array that the kernel carries from call to call; see kernels.step
_TIME = 0


class Stepper:
    """Advances ``dy/dt = f(y, u, q)`` from one time to the next, with the same equations as records.

    The step size is carried from call to call: in steady conditions a call takes one step. Delays of inputs
    are taken into account. The same calls give the same numbers, bit for bit.

    Parameters
    ----------
    compiled: the system.
    y0: the state at `time`.
    q: the parameters.
    inputs: the values commanded, and acting, at `time`.
    time: in seconds.
    """

    def __init__(
        self,
        compiled: CompiledSystem,
        y0: ArrayLike,
        q: ArrayLike,
        inputs: ArrayLike,
        *,
        time: float = 0.0,
        tolerance: Tolerance = DEFAULT,
    ) -> None:
        system = compiled.system
        self.compiled = compiled
        self._parameters = _vector("parameters", q, len(system.parameters))
        self._commanded = _vector("inputs", inputs, len(system.inputs))
        self._scheduled: list[tuple[float, int, int, float]] = []
        self._order = count()
        # the workspace of a record without columns, kept between calls: state, inputs, waiting commands and
        # step size live in it
        self._sizes = np.zeros(sizing.SIZES, dtype=np.int64)
        self._sizes[sizing.N] = len(system.states)
        self._sizes[sizing.INPUTS] = len(system.inputs)
        self._sizes[sizing.OUTPUTS_COUNT] = len(system.outputs)
        self._sizes[sizing.DELAYS_COUNT] = len(system.delays)
        self._sizes[sizing.CAPACITY] = _WAITING_COMMANDS if system.delays else 0
        self._tolerance = tolerances(compiled, tolerance)
        self._delayed = delayed_inputs(compiled)
        self._sizes[sizing.GUARD] = width()
        self._workspace = Workspace(self._sizes)
        self._floats, self._integers = self._workspace.floats, self._workspace.integers
        self._counters = np.zeros(outcomes.COUNTERS, dtype=np.int64)
        self._seen = Result("outputs", (len(system.outputs),))
        self._outputs = self._seen.values
        self._carried = np.array([float(time), 0.0, 1.0])
        # views into that workspace, so that reading a state costs no call
        start, acting, commanded = sizing.stepping_places(self._sizes)
        self._state = self._floats[start : start + len(system.states)]
        self._state[:] = _vector("initial states", y0, len(system.states))
        self._acting = self._floats[acting : acting + self._commanded.size]
        self._acting[:] = self._commanded
        self._floats[commanded : commanded + self._commanded.size] = self._commanded
        self._target, self._returned = np.array([float(time)]), np.zeros(2)
        # once: the arrays stay where they are, and a call only changes what is in them
        self._words = words_of(
            compiled.addresses,
            self._sizes,
            self._tolerance,
            self._parameters,
            self._target,
            self._commanded,
            self._carried,
            self._delayed,
            self._floats,
            self._integers,
            self._outputs,
            self._counters,
            self._returned,
        )
        self._advance(float(time))

    @property
    def time(self) -> float:
        """The time that has been reached, in seconds."""
        return float(self._carried[_TIME])

    @property
    def state(self) -> Floats:
        """A copy of the state."""
        return self._state.copy()

    @property
    def acting_inputs(self) -> Floats:
        """A copy of the inputs that act now; a delayed one differs from its last command."""
        return self._acting.copy()

    @property
    def steps(self) -> int:
        """Steps taken since the start."""
        return int(self._counters[outcomes.STEPS])

    def outputs(self) -> Floats:
        """A copy of the outputs g(y, u, q), with the inputs that acted up to now."""
        return self._outputs.copy()

    def switch_input(self, name: str, value: float, *, at: float | None = None) -> None:
        """Command one input: now, or at a future time, at which `advance` then ends a step.

        Raises
        ------
        RigctlError
            there is no such input, the value is not finite, or the time has passed.
        """
        names = self.compiled.system.input_names
        if name not in names:
            raise unknown_name("input", name, names)
        if not np.isfinite(value):
            raise RigctlError(f"the input {name} is not a finite number", value=str(value))
        moment = self.time if at is None else float(at)
        if not moment >= self.time:
            raise RigctlError(
                f"the input {name} cannot be switched in the past",
                value=f"{moment:g} s",
                expected=f"{self.time:g} s or later",
            )
        # the counter keeps simultaneous commands in the order in which they were given
        insort(self._scheduled, (moment, next(self._order), names.index(name), float(value)))

    def advance(self, to_time: float, inputs: Sequence[float] | Floats | None = None) -> None:
        """Integrate to `to_time`, ending a step at every scheduled or delayed switch on the way.

        With `inputs`, all inputs are commanded first, now; without, they keep their last commanded values.

        Raises
        ------
        RigctlError
            the time has passed, an input is not finite, or the equations cannot be integrated that far.
        """
        if inputs is not None:
            self._commanded[:] = inputs
            if not np.isfinite(self._commanded).all():
                raise RigctlError("an input is not a finite number", value=str(list(self._commanded)))
        if not to_time >= self._carried[_TIME]:
            raise RigctlError(
                "a bench cannot go back in time", value=f"{to_time:g} s", expected=f"{self.time:g} s or later"
            )
        # from one scheduled command to the next; those at one moment act together, before the next step
        while self._scheduled and self._scheduled[0][0] <= to_time:
            moment, _, index, value = self._scheduled.pop(0)
            if moment > self._carried[_TIME]:
                self._advance(moment)
            self._commanded[index] = value
        self._advance(to_time)

    def _advance(self, target: float) -> None:
        self._target[0] = target
        self.compiled.step_to(self._words)
        outcome, reached = int(self._returned[0]), float(self._returned[1])
        self._workspace.check()
        self._seen.check()
        if outcome != outcomes.DONE:
            failure = explain(self.compiled.system, outcome, reached, self._counters)
            raise RigctlError(f"the simulation broke down: {failure}", exit_code=ExitCode.FAILED)


def _vector(what: str, values: ArrayLike, size: int) -> Floats:
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise RigctlError(f"{vector.size} {what}", expected=f"{size}, as the system has")
    if not np.isfinite(vector).all():
        raise RigctlError(f"one of the {what} is not a finite number", value=str(vector.tolist()))
    return vector
