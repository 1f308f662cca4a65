"""The interface of every bench, real or not; the runner uses nothing else.

A bench has channels that are sampled on a regular grid and actuators that are switched at exact times.
All values are SI, all times are seconds on the clock the backend was given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.plan.loop import LoopSettings, LoopState


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of every channel.

    Parameters
    ----------
    time: when the channels were read, in s.
    values: SI values in the order of ``rig.layout.channels``; NaN where a channel gave none.
    commands: the actuators' commanded values in the order of ``rig.layout.commands``, in force when
        the channels were read.
    """

    time: float
    values: tuple[float, ...]
    commands: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CommandReceipt:
    """The time at which an actuator actually switched.

    Parameters
    ----------
    time: the switch, in s.
    actuator: its name in the rig file.
    value: the new SI value.
    uncertainty: half-width of the interval that holds the true switch time, in s; 0 when it is exact.
    """

    time: float
    actuator: str
    value: float
    uncertainty: float = 0.0


class PendingCommand:
    """A command that was sent, and its outcome.

    The bench answers when it can. The sender continues to handle samples and interlocks, and does not assume
    the output to be switched before `receipt` confirms it.

    Parameters
    ----------
    actuator, value: of the command, SI.
    pump: lets bench time pass until something has arrived; None for one that was answered at once.

    Attributes
    ----------
    receipt: when it was carried out; None while unknown.
    trouble: why it was not carried out, or why that will never be known: `OutOfReach` for the latter.
    """

    def __init__(self, actuator: str, value: float, pump: Callable[[], object] | None = None) -> None:
        self.actuator = actuator
        self.value = value
        self.receipt: CommandReceipt | None = None
        self.trouble: RigctlError | None = None
        self._pump = pump

    @classmethod
    def answered(cls, receipt: CommandReceipt) -> PendingCommand:
        """A command that the bench has carried out at once."""
        pending = cls(receipt.actuator, receipt.value)
        pending.receipt = receipt
        return pending

    @property
    def settled(self) -> bool:
        """Whether its outcome is final."""
        return self.receipt is not None or self.trouble is not None

    def wait(self) -> CommandReceipt:
        """Let time pass until the bench has answered, for callers with nothing else to do; samples wait.

        Raises
        ------
        RigctlError
            the bench refuses it, or it is lost.
        """
        while not self.settled and self._pump is not None:
            self._pump()
        if self.receipt is None:
            raise self.trouble or RuntimeError("a command that nobody answers")
        return self.receipt


@dataclass(frozen=True, slots=True)
class Notice:
    """A notice of the bench for the run's events.

    `kind` is one of the dataset's event kinds: ``gap`` (samples were lost), ``fault``, ``alarm`` (the
    board tripped), ``note`` (reconnected, resynchronised). The field ``switched_off`` of a gap names the
    actuators that went to their safe value in it without a command.
    """

    time: float
    kind: str
    message: str
    fields: Mapping[str, object] = field(default_factory=dict)


class Backend(Protocol):
    """A bench: sampled channels, switched actuators, and a way to make everything safe.

    The order of calls is ``open``, then any of the others, then ``close``. Only the runner's thread calls
    them, except for `safe`, which a signal's cleanup calls in the same thread, whatever was going on.
    """

    @property
    def identity(self) -> Mapping[str, str]:
        """The identity reported by the bench: kind, name, firmware, serial number, seed…; complete once
        open."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock that all times refer to."""
        ...

    @property
    def timed(self) -> bool:
        """True if the bench itself times pulses, so that delays of the host do not matter."""
        ...

    @property
    def without_host(self) -> str:
        """What happens to the outputs when the bench cannot be reached, one sentence for people on site."""
        ...

    @property
    def outputs_read(self) -> frozenset[str]:
        """Driven actuators whose state in the newest sample was read back from the bench."""
        ...

    @property
    def outputs_answered(self) -> frozenset[str]:
        """Driven actuators whose commands the bench acknowledges, so that `safe` raises if one is not."""
        ...

    def open(self) -> None:
        """Reach the bench, check that it is the right one, and bring its outputs to the safe state.

        Raises
        ------
        BackendLost
            the bench does not answer.
        RigctlError
            it is not the bench of the rig file, or another program uses it.
        """
        ...

    def close(self) -> None:
        """Close the bench, with outputs safe if it can still be reached. Never raises, idempotent."""
        ...

    def start(self, rate: float) -> None:
        """Sample at `rate` Hz from now on, the first sample at once; replaces an earlier rate.

        A bench that cannot be reached does so when it is back. The first sample at the new rate may have the
        same time as the last one at the old rate.
        """
        ...

    def next_sample(self, timeout: float) -> Sample | None:
        """Wait on the clock for the next sample; None when none came within `timeout` s of bench time.

        Also None as soon as a command has been answered, so that a caller waiting for that can continue.
        Samples come in order of time, none is skipped because the caller was late.

        Raises
        ------
        BackendLost
            the bench is gone for good.
        """
        ...

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command that switches an actuator to an SI value, without waiting.

        The answer arrives while `next_sample` is called. Until then the output may be as before or as
        commanded; if no answer comes in time, contact counts as lost, or the command is sent again where it
        does no harm twice.

        With `duration` the bench returns it to its safe value automatically after this time, s; the
        receipt of this return comes from `take_receipts`. A new command to the same actuator replaces a
        pulse that has not ended, and one that has not been answered. `safe` drops what has not been answered.
        A command is never sent again after a loss of contact: the runner has to decide first.

        An actuator that is operated by hand (``by: operator``) is commanded as well: a real bench only
        records the request to the operator, on a simulated one the simulated operator turns it.

        Raises
        ------
        RigctlError
            there is no such actuator, or it cannot take the value; nothing has moved.
        OutOfReach
            contact is lost for the moment.
        BackendLost
            the bench is gone for good, or no longer responds.
        """
        ...

    def take_receipts(self) -> list[CommandReceipt]:
        """Switches since the last call that no `PendingCommand` reports: ends of timed pulses, trips."""
        ...

    def take_notices(self) -> list[Notice]:
        """Notices of the bench since the last call: gaps, reconnections, trips, injected faults."""
        ...

    def safe(self) -> None:
        """Bring every output to the rig's safe state now; discard pulses and waiting commands.

        May be called at any time, repeatedly; blocks for at most one second of wall time.

        Raises
        ------
        BackendLost
            the bench cannot be reached (its own watchdog then makes it safe).
        """
        ...


@runtime_checkable
class Regulator(Protocol):
    """A `Backend` that can also carry out a closed loop on its own, one at a time.

    Each sample has the output that was in force when it was taken. `Backend.safe`, a trip, any command to its
    actuator, and a loss of contact end the loop.
    """

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Why this bench cannot carry out a loop, one sentence; empty if it can. Known once it is open."""
        ...

    def regulate(self, loop: LoopSettings) -> PendingCommand:
        """Tell the bench to start a loop, without waiting; the receipt confirms it.

        Raises
        ------
        OutOfReach
            contact is lost for the moment.
        BackendLost
            the bench is gone for good.
        """
        ...

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """The state of the newest loop; `ahead`, sent as soon as possible, is its feed-forward from now
        on."""
        ...

    def stop_regulating(self, actuator: str) -> PendingCommand:
        """End a loop, leaving its output unchanged; the receipt gives its value. Raises as `regulate`
        does."""
        ...
