"""The states of a run, declared as one table; everything else about them is derived from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from types import MappingProxyType


class RunState(Enum):
    """States of a run; `STATES` has their meanings."""

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


#: meaning of each state
STATES = {
    RunState.IDLE: "nothing has been touched yet",
    RunState.ARMING: "the bench is opened and read, interlocks are checked; nothing moves",
    RunState.RUNNING: "steps are executed",
    RunState.PAUSED: "outputs are safe; sampling and interlocks continue, steps wait",
    RunState.SAFE: "outputs have just been put into the safe state",
    RunState.FINISHING: "cleanup blocks run, outputs are made safe again, data are closed",
    RunState.FINISHED: "all steps were executed",
    RunState.FAILED: "a step failed, an interlock tripped, or the bench or the disk was lost",
    RunState.ABORTED: "somebody ended the run",
}

#: cause of each transition
EVENTS = {
    "arm": "the run is requested",
    "start": "the bench answers and no interlock is tripped",
    "pause": "`rigctl pause`, the key p, or the loss of a device with `lost: pause`",
    "go_on": "`rigctl continue`, the key c, or the lost device is back",
    "finish": "the last step is done, or a dry run has read the bench",
    "make_safe": "an interlock, a failed step, a signal, a lost bench, a full disk, an error",
    "clean_up": "outputs are safe; cleanup blocks may run",
    "succeed": "data are closed",
    "fail": "data are closed",
    "abort": "data are closed",
}


#: the transition table: what each event leads to, by the state it happens in. An event that it does not have
#: is an error in rigctl itself. `safe` can be reached from every state in which outputs may be other than
#: safe, itself included.
TRANSITIONS: Mapping[RunState, Mapping[str, RunState]] = MappingProxyType(
    {
        RunState.IDLE: {"arm": RunState.ARMING, "make_safe": RunState.SAFE},
        RunState.ARMING: {
            "start": RunState.RUNNING,
            "finish": RunState.FINISHING,
            "make_safe": RunState.SAFE,
        },
        RunState.RUNNING: {
            "pause": RunState.PAUSED,
            "finish": RunState.FINISHING,
            "make_safe": RunState.SAFE,
        },
        RunState.PAUSED: {"go_on": RunState.RUNNING, "make_safe": RunState.SAFE},
        RunState.SAFE: {"make_safe": RunState.SAFE, "clean_up": RunState.FINISHING},
        RunState.FINISHING: {
            "make_safe": RunState.SAFE,
            "succeed": RunState.FINISHED,
            "fail": RunState.FAILED,
            "abort": RunState.ABORTED,
        },
        RunState.FINISHED: {},
        RunState.FAILED: {},
        RunState.ABORTED: {},
    }
)


class Lifecycle:
    """The state of one run; calls `listener` with every change.

    Parameters
    ----------
    listener: called with the old state, the event's name and the new state.
    """

    def __init__(self, listener: Callable[[RunState, str, RunState], None]) -> None:
        self._state = RunState.IDLE
        self._listener = listener

    @property
    def state(self) -> RunState:
        """Current state of the run."""
        return self._state

    def send(self, event: str) -> None:
        """Take the transition `event`.

        Raises
        ------
        RuntimeError
            the table has no such transition from here: a mistake in rigctl.
        """
        before = self._state
        after = TRANSITIONS[before].get(event)
        if after is None:
            raise RuntimeError(f"Can't {event} a run that is {before.value}")
        self._state = after
        self._listener(before, event, after)


def transitions() -> tuple[tuple[RunState, str, RunState], ...]:
    """Every transition of the table: source, event, target."""
    return tuple(
        (source, event, target) for source, events in TRANSITIONS.items() for event, target in events.items()
    )
