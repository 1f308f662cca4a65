"""The interface of all benches, real or simulated; the runner uses nothing else.

A bench has channels that are sampled on a regular grid and actuators that are switched at exact times.
All values are in SI units, all times in seconds on the clock that was passed to the backend.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.plan.loop import LoopSettings, LoopState


@dataclass(frozen=True, slots=True)
class Reading:
    """What one of several devices has read, in the columns of the whole bench.

    Parameters
    ----------
    device: its name.
    time: when it read its channels, in s: not necessarily later than the newest reading of another device.
    values: as of a `Sample`; NaN for the channels of other devices.
    commands: those of all devices that were in force then.
    """

    device: str
    time: float
    values: tuple[float, ...]
    commands: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of every channel.

    Parameters
    ----------
    time: when the channels were read, in s.
    values: SI values in the order of ``rig.layout.channels``; NaN for a channel without a value.
    commands: the actuators' commanded values in the order of ``rig.layout.commands``, in force when
        the channels were read.
    reading: on a bench of several devices, the one reading that is new in this sample. The other values are
        the newest of each channel, unless they are older than its ``stale_after``.
    """

    time: float
    values: tuple[float, ...]
    commands: tuple[float, ...]
    reading: Reading | None = None

    @property
    def device(self) -> str:
        """The device that was read; empty for the one device of a bench."""
        return "" if self.reading is None else self.reading.device

    @property
    def read(self) -> Reading | Sample:
        """What was read: no value, and no time, is that of another reading."""
        return self.reading or self


@dataclass(frozen=True, slots=True)
class CommandReceipt:
    """The time at which an actuator actually switched.

    Parameters
    ----------
    time: time of the switch, in s.
    actuator: its name in the rig file.
    value: the new SI value.
    uncertainty: half-width of the interval that contains the true time of the switch, in s; 0 if it is exact.
    """

    time: float
    actuator: str
    value: float
    uncertainty: float = 0.0


class PendingCommand:
    """A command that was sent, and its outcome.

    The bench answers later. Meanwhile the sender continues to handle samples and interlocks, and does not
    assume that the output has switched until `receipt` confirms it.

    Parameters
    ----------
    actuator, value: the commanded actuator, and the SI value.
    pump: lets bench time pass until something has arrived; None for a command that was answered at once.

    Attributes
    ----------
    receipt: the confirmation that it was executed, with the time; None until then.
    trouble: why it was not executed; `OutOfReach` if its outcome will never be known.
    """

    def __init__(self, actuator: str, value: float, pump: Callable[[], object] | None = None) -> None:
        self.actuator = actuator
        self.value = value
        self.receipt: CommandReceipt | None = None
        self.trouble: RigctlError | None = None
        self._pump = pump

    @classmethod
    def answered(cls, receipt: CommandReceipt) -> PendingCommand:
        """Return a command that the bench has executed at once."""
        pending = cls(receipt.actuator, receipt.value)
        pending.receipt = receipt
        return pending

    @property
    def settled(self) -> bool:
        """Whether its outcome is final."""
        return self.receipt is not None or self.trouble is not None

    def wait(self) -> CommandReceipt:
        """Let time pass until the bench has answered, for callers with nothing else to do; samples queue up.

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
    """A notice from the bench, to be stored as an event of the run.

    `kind` is one of the dataset's event kinds: ``gap`` (samples were lost), ``fault``, ``alarm`` (the
    board tripped), ``note`` (reconnected, resynchronised). The field ``switched_off`` of a gap names the
    actuators that went to their safe value during the gap without a command.
    """

    time: float
    kind: str
    message: str
    fields: Mapping[str, object] = field(default_factory=dict)


@runtime_checkable
class Polled(Protocol):
    """A bench that is asked for each sample, and can be asked for the next one only after its answer."""

    @property
    def sample_takes(self) -> float:
        """s that a sample takes, the shortest so far; 0 before there is one."""
        ...


@runtime_checkable
class Combined(Protocol):
    """A bench of several devices, which are read and commanded independently of one another."""

    @property
    def devices(self) -> Mapping[str, Backend]:
        """The bench of each device, by name."""
        ...


class Backend(Protocol):
    """A bench: sampled channels, switched actuators, and a way to make everything safe.

    The order of calls is ``open``, then any of the others, then ``close``. All calls come from the runner's
    thread; `safe` may interrupt any other of them, when it is called by the cleanup after a signal.
    """

    @property
    def identity(self) -> Mapping[str, str]:
        """The identity reported by the bench: kind, name, firmware, serial number, seed…; complete once it is
        open."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock that all times refer to."""
        ...

    @property
    def timed(self) -> bool:
        """True if the bench itself times pulses, so that delays on the host do not matter."""
        ...

    @property
    def without_host(self) -> str:
        """What happens to the outputs if the host loses contact, one sentence for people at the bench."""
        ...

    @property
    def outputs_read(self) -> frozenset[str]:
        """Driven actuators whose state the bench reports, in its samples or when it was made safe."""
        ...

    @property
    def outputs_answered(self) -> frozenset[str]:
        """Driven actuators whose commands the bench acknowledges, so that `safe` raises if it does not."""
        ...

    def open(self) -> None:
        """Connect to the bench, check that it is the right one, and bring its outputs to the safe state.

        Raises
        ------
        BackendLost
            the bench does not answer.
        RigctlError
            it is not the bench of the rig file, or another program uses it.
        """
        ...

    def close(self) -> None:
        """Close the bench, with outputs made safe if it can still be reached. Never raises; idempotent."""
        ...

    def start(self, rate: float) -> None:
        """Sample at `rate` Hz from now on, with the first sample at once; replaces an earlier rate.

        A bench that cannot be reached starts once it is back. The first sample at the new rate may have the
        same time as the last one at the old rate.
        """
        ...

    def next_sample(self, timeout: float) -> Sample | None:
        """Wait on the clock for the next sample; None if there was none within `timeout` s of bench time.

        Also None as soon as a command has been answered, so that a caller waiting for that can continue.
        Samples are returned in order of time, and none is skipped if the caller is late.

        Raises
        ------
        BackendLost
            the bench is gone for good.
        """
        ...

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command that switches an actuator to an SI value, without waiting for the answer.

        The answer is processed by calls of `next_sample`. Until then the output may be as before or as
        commanded; without an answer in time, contact counts as lost, or the command is sent again if it is
        harmless when executed twice.

        With `duration` the bench returns the actuator to its safe value automatically after this time, s; the
        receipt of this return comes from `take_receipts`. A new command to the same actuator replaces a
        pulse that has not ended, and a command that has not been answered. `safe` drops unanswered commands.
        A command is never sent again after a loss of contact: the runner has to decide first.

        An actuator that is operated by hand (``by: operator``) is commanded as well: a real bench only
        records the request to the operator; on a simulated bench the simulated operator turns it.

        Raises
        ------
        RigctlError
            there is no such actuator, or the value is invalid for it; nothing has moved.
        OutOfReach
            contact is temporarily lost.
        BackendLost
            the bench is gone for good, or no longer responds.
        """
        ...

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the switches since the last call that no `PendingCommand` reports: ends of pulses, trips."""
        ...

    def take_notices(self) -> list[Notice]:
        """Return the bench's notices since the last call: gaps, reconnections, trips, injected faults."""
        ...

    def safe(self) -> None:
        """Bring every output to the rig's safe state now; discard pulses and pending commands.

        May be called at any time, repeatedly; blocks for at most one second of wall time.

        Raises
        ------
        BackendLost
            the bench cannot be reached (its own watchdog then makes it safe).
        """
        ...


@runtime_checkable
class Regulator(Protocol):
    """A `Backend` that can also execute a closed loop by itself, one at a time.

    Each sample contains the output that was in force when it was taken. `Backend.safe`, a trip, any command
    to the loop's actuator, and a loss of contact end the loop.
    """

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Return why this bench cannot execute a loop, one sentence; empty if it can. Known once open."""
        ...

    def regulate(self, loop: LoopSettings) -> PendingCommand:
        """Start a loop on the bench, without waiting; the receipt confirms the start.

        Raises
        ------
        OutOfReach
            contact is temporarily lost.
        BackendLost
            the bench is gone for good.
        """
        ...

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """Return the state of the newest loop; `ahead` is its feed-forward from now on, SI, which is sent as
        soon as possible."""
        ...

    def stop_regulating(self, actuator: str) -> PendingCommand:
        """End a loop, leaving its output unchanged; the receipt gives the output's value. Raises as
        `regulate`."""
        ...
