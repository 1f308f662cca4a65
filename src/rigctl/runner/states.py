"""The states of a run, declared as one table; everything else about them is derived from it."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any

from statemachine import StateMachine
from statemachine.states import States


class RunState(Enum):
    """What a run is doing; `STATES` says what each one means."""

    IDLE = "idle"
    ARMING = "arming"
    RUNNING = "running"
    PAUSED = "paused"
    SAFE = "safe"
    FINISHING = "finishing"
    FINISHED = "finished"
    FAILED = "failed"
    ABORTED = "aborted"

    @property
    def ended(self) -> bool:
        """True when nothing follows."""
        return self in (RunState.FINISHED, RunState.FAILED, RunState.ABORTED)


#: what each state means
STATES = {
    RunState.IDLE: "nothing has been touched yet",
    RunState.ARMING: "the bench is opened and read, interlocks are looked at; nothing moves",
    RunState.RUNNING: "steps are carried out",
    RunState.PAUSED: "outputs are safe; samples and interlocks go on, steps wait",
    RunState.SAFE: "outputs have just been brought to the safe state",
    RunState.FINISHING: "cleanup blocks run, outputs are made safe again, data is closed",
    RunState.FINISHED: "everything was carried out",
    RunState.FAILED: "a step failed, an interlock tripped, or the bench or the disk was lost",
    RunState.ABORTED: "somebody ended the run",
}

#: what brings each transition about
EVENTS = {
    "arm": "the run is asked for",
    "start": "the bench answers and no interlock is tripped",
    "pause": "`rigctl pause`, or the key p",
    "go_on": "`rigctl continue`, or the key c",
    "finish": "the last step is done, or a dry run has read the bench",
    "make_safe": "an interlock, a failed step, a signal, a lost bench, a full disk, an error",
    "clean_up": "outputs are safe; cleanup blocks may run",
    "succeed": "data is closed",
    "fail": "data is closed",
    "abort": "data is closed",
}


class RunStates(StateMachine):
    """The transition table. An event that the table does not have is an error in rigctl itself.

    `safe` can be reached from every state in which outputs may be other than safe, itself included.
    """

    at = States.from_enum(
        RunState,
        initial=RunState.IDLE,
        final=(RunState.FINISHED, RunState.FAILED, RunState.ABORTED),
        use_enum_instance=True,
    )

    arm = at.IDLE.to(at.ARMING)
    start = at.ARMING.to(at.RUNNING)
    pause = at.RUNNING.to(at.PAUSED)
    go_on = at.PAUSED.to(at.RUNNING)
    finish = at.RUNNING.to(at.FINISHING) | at.ARMING.to(at.FINISHING)
    make_safe = (
        at.IDLE.to(at.SAFE)
        | at.ARMING.to(at.SAFE)
        | at.RUNNING.to(at.SAFE)
        | at.PAUSED.to(at.SAFE)
        | at.FINISHING.to(at.SAFE)
        | at.SAFE.to(at.SAFE)
    )
    clean_up = at.SAFE.to(at.FINISHING)
    succeed = at.FINISHING.to(at.FINISHED)
    fail = at.FINISHING.to(at.FAILED)
    abort = at.FINISHING.to(at.ABORTED)


class Lifecycle:
    """The state of one run; tells `listener` of every change.

    Parameters
    ----------
    listener: called with the old state, the event's name and the new state.
    """

    def __init__(self, listener: Callable[[RunState, str, RunState], None]) -> None:
        self._machine: Any = RunStates()
        self._listener = listener

    @property
    def state(self) -> RunState:
        """Where the run is now."""
        state: RunState = self._machine.current_state_value
        return state

    def send(self, event: str) -> None:
        """Take the transition `event`.

        Raises
        ------
        statemachine.exceptions.TransitionNotAllowed
            the table has no such transition from here: a mistake in rigctl.
        """
        before = self.state
        self._machine.send(event)
        self._listener(before, event, self.state)


def transitions() -> tuple[tuple[RunState, str, RunState], ...]:
    """Every transition of the table: source, event, target."""
    return tuple(
        (RunState[state.id], str(transition.event), RunState[transition.target.id])
        for state in RunStates.states
        for transition in state.transitions
    )
