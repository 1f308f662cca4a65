"""A bench at the end of a port, whatever is spoken on it: opening, closing, losing and finding it again."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Generic, TypeVar

from rigctl.backends.commands import check_command
from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.transport.outbox import Outbox
from rigctl.backends.transport.port import Connect, OnPort, Port, PortLost, Refused
from rigctl.backends.transport.reconnection import Meeting, Reconnection
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

Contact = TypeVar("Contact", bound=OnPort)


class PortBench(ABC, Generic[Contact]):
    """What every `Backend` on a `Port` does alike; a kind of device adds what is spoken on it.

    Parameters
    ----------
    rig: what channels and actuators there are.
    clock: what waits are counted on.
    connect: opens the port; called again when it was lost.
    kind: ``serial``, ``emulated``, …, for the identity.
    reconnect: s for a lost device to come back.
    identity: what else is known of the bench before it answers.
    by_hand: called when the operator turns something, where the operator is emulated too.

    Attributes
    ----------
    identity: as `Backend` has it.
    """

    #: what is at the other end, in messages
    device = "device"

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        connect: Connect,
        *,
        kind: str,
        reconnect: float = 30.0,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": kind, "name": rig.name, **(identity or {})}
        self._rig = rig
        self._connect = connect
        self._reconnection = Reconnection(
            clock, connect, lambda port: self._meet(port, again=True), reconnect
        )
        self._by_hand = by_hand
        self._outbox = Outbox(clock)
        self._contact: Contact | None = None
        self._opened = False
        self._rate = 0.0
        self._ends: dict[str, float] = {}  # pulses that are timed here, s
        self._answered = False  # a command, since `next_sample` was called
        self._cut_off: set[str] = set()  # what was driven, or may have been, when contact was lost
        self._over_said = False

    # --- what a kind of device adds -----------------------------------------------------------------------

    @abstractmethod
    def _meet(self, port: Port, *, again: bool) -> Meeting[Contact]:
        """Begin to ask who is there, on a port that has just been opened, or `again` after a loss.

        Whoever is met is the right device, with outputs safe, and sampling as before.
        """

    @abstractmethod
    def _let_go(self, contact: Contact) -> None:
        """Make outputs safe for the last time; may raise `PortLost` and `Refused`."""

    @abstractmethod
    def _check_rate(self, rate: float) -> None:
        """Refuse a rate that the device cannot sample at."""

    @abstractmethod
    def _begin_sampling(self) -> None:
        """Sample at the present rate from now on."""

    @abstractmethod
    def _advance(self, contact: Contact, until: float) -> None:
        """Let time pass up to `until`, or until something has arrived or is due; may raise `PortLost`."""

    @abstractmethod
    def _put(self, actuator: str, value: float, duration: float | None, *, asked_for: bool) -> PendingCommand:
        """Send a command that has been checked; `asked_for` where the caller waits for its answer.

        Raises
        ------
        OutOfReach
            contact is lost for the moment.
        """

    @abstractmethod
    def _make_safe(self, contact: Contact) -> None:
        """Make outputs safe, and wait for the answers; may raise `PortLost` and `Refused`."""

    @abstractmethod
    def _unanswered(self) -> list[PendingCommand]:
        """Commands that may have been carried out, and of which nobody has said so."""

    @abstractmethod
    def _drop_orders(self, why: str) -> None:
        """Leave what is being asked and what was to come next; no answer is waited for."""

    @abstractmethod
    def _part(self, contact: Contact, error: PortLost) -> tuple[str, Port | None]:
        """Contact is lost: what else is known of it, and the port where the device is looked for first.

        A port that is of no use for that is closed.
        """

    @abstractmethod
    def _leave_out(self, lost_at: float) -> int:
        """How many samples a loss of contact has cost by now; they will not be made up for."""

    @property
    @abstractmethod
    def _over(self) -> str:
        """Why the device does nothing any more, or cannot be trusted; empty while it can."""

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Reach the device, check what it is, and make its outputs safe."""
        port: Port | None = None
        try:
            port = self._connect()
            self._contact = self._meet(port, again=False).carry_through()
        except BaseException as error:
            if port is not None:
                port.close()
            if isinstance(error, PortLost):
                raise BackendLost(f"the bench cannot be reached: {error}") from None
            raise
        self._opened = True

    def close(self) -> None:
        """Make outputs safe where the device can still be reached, and let the port go."""
        contact, self._contact = self._contact, None
        self._opened = False
        self._reconnection.drop()
        self._drop_orders("the bench was let go")
        if contact is None:
            return
        with suppress(PortLost, Refused):  # whatever guards the device sees to it
            self._let_go(contact)
        contact.port.close()

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Sample at `rate` Hz from now on."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '10 Hz'")
        self._check_rate(rate)
        self._check_open()
        self._rate = rate
        self._begin_sampling()

    def next_sample(self, timeout: float) -> Sample | None:
        """The next sample, on the bench's clock."""
        self._check_open()
        deadline = self.clock.now() + timeout
        self._answered = False
        while not self._outbox.samples:
            if self._over:
                if self._over_said:
                    raise BackendLost(self._over)
                self._over_said = True  # the notices and receipts that belong to it are fetched first
                return None
            if self._answered or self.clock.now() >= deadline:
                return None
            self._pump(deadline)
        return self._outbox.samples.popleft()

    def take_receipts(self) -> list[CommandReceipt]:
        """Ends of pulses, and switches that the device made by itself."""
        return self._outbox.take_receipts()

    def take_notices(self) -> list[Notice]:
        """Gaps, damage, trips, losses and returns."""
        return self._outbox.take_notices()

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command; its receipt will say when the device carried it out."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._outbox.commanded[actuator] = value
            return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))
        return self._put(actuator, value, duration, asked_for=True)

    def safe(self) -> None:
        """Bring every output to the rig's safe state, now."""
        self._check_open()
        self._ends.clear()
        self._drop_orders(f"outputs were made safe before the {self.device} had answered")
        contact = self._contact
        if contact is None:
            raise BackendLost(f"the bench cannot be reached: {self._reconnection.why}")
        try:
            self._make_safe(contact)
        except Refused as error:
            raise BackendLost(f"the outputs may not be safe: {error}") from None
        except PortLost as error:
            self._lose(error)
            raise BackendLost(f"the outputs may not be safe: {error}") from None

    # --- inside -------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _check_reach(self) -> Contact:
        """The contact; raises `OutOfReach` while it is lost."""
        if self._contact is None:
            raise OutOfReach(f"the {self.device} cannot be reached for the moment: {self._reconnection.why}")
        return self._contact

    def _pending(self, actuator: str, value: float) -> PendingCommand:
        """A command that this bench is about to send."""
        return PendingCommand(actuator, value, lambda: self._pump(math.inf))

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _driven(self) -> set[str]:
        """Actuators that are commanded to something else than their safe value."""
        commanded = self._outbox.commanded
        return {name for name, value in self._resting().items() if commanded.get(name) != value}

    def _note_safe(self) -> None:
        """The device has been made safe: that is what is commanded now, of a new one everything."""
        commanded = self._outbox.commanded
        self._outbox.commanded = dict.fromkeys(self._rig.actuators, 0.0) | commanded | self._resting()

    def _pump(self, until: float) -> None:
        """Let time pass up to `until`, or until something has arrived or is due."""
        self._end_pulses()
        contact = self._contact
        if contact is None:
            self._try_again(until)
            return
        try:
            self._advance(contact, until)
        except PortLost as error:
            self._lose(error)

    def _end_pulses(self) -> None:
        for actuator in [name for name, end in self._ends.items() if end <= self.clock.now()]:
            del self._ends[actuator]
            with suppress(BackendLost):  # a device that comes back is made safe before anything else
                self._put(actuator, float(self._rig.safe_state[actuator]), None, asked_for=False)

    def _doubt(self, pending: PendingCommand) -> None:
        """A command may have been carried out when contact was lost."""
        if pending.value != self._resting().get(pending.actuator):
            self._cut_off.add(pending.actuator)

    def _lose(self, error: PortLost) -> None:
        """Contact is lost; from now on the device is looked for."""
        contact, self._contact = self._contact, None
        for pending in self._unanswered():
            self._doubt(pending)
        self._drop_orders(f"contact with the {self.device} is lost: {error}")
        details, kept = ("", None) if contact is None else self._part(contact, error)
        self._cut_off |= self._driven()
        self._reconnection.begin(f"{error}{details}", kept)
        self._outbox.notice("fault", f"contact with the {self.device} is lost: {error}{details}")

    def _try_again(self, until: float) -> None:
        """What can be done by bench time `until` to find the device again."""
        contact = self._reconnection.attempt(until)
        if contact is None:
            return
        self._contact = contact
        now, lost_at = self.clock.now(), self._reconnection.since
        self._outbox.notice("note", f"the {self.device} is back after {now - lost_at:.1f} s, outputs safe")
        resting, switched_off = self._resting(), sorted(self._cut_off)
        self._cut_off.clear()
        half = 0.5 * (now - lost_at)  # when they went off is not known any better
        self._outbox.receipts += [
            CommandReceipt(now - half, name, resting[name], half) for name in switched_off
        ]
        missed = self._leave_out(lost_at)
        if missed > 0 or switched_off:
            self._outbox.gap(missed, cause=self._reconnection.why, switched_off=switched_off)
