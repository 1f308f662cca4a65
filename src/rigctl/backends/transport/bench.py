"""A bench on a port, with any protocol: opening, closing, loss of contact and reconnection.

In: calls of the runner (`rigctl.backends.protocol.Backend`), and a function that opens the port. Out:
samples, receipts and notices, which wait in an `Outbox` until they are fetched. A subclass for each kind
of device adds the protocol: how it is identified, sampled, commanded and made safe.

Everything happens on the caller's thread, inside `next_sample`: reading, the end of pulses timed by the
host, the search for a lost device. During a run no call but `safe` waits for an answer of the device, so that
a silent one delays no interlock and no signal (see
docs/decisions/0046-only-safe-state-commands-wait-for-answers.md).

A connection has two states, seen in `_contact`: a device, or None while the search goes on. A loss is noticed
wherever a `PortLost` arrives; `_lose` is the one way from the first to the second, `_try_again` the one way
back. What has come back is identified and has its outputs safe before it is a contact again.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from typing import Generic, TypeVar

from rigctl.backends.commands import check_command
from rigctl.backends.errors import BackendLost, OutOfReach, OutputsNotSafe
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.transport.outbox import Outbox
from rigctl.backends.transport.port import Connect, NotConfirmed, OnPort, Port, PortLost, Refused
from rigctl.backends.transport.reconnection import DeviceIdentification, Reconnection
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

Contact = TypeVar("Contact", bound=OnPort)


class PortBench(ABC, Generic[Contact]):
    """The common part of every `Backend` on a `Port`; subclasses add the protocol.

    Parameters
    ----------
    rig: the channels and actuators.
    clock: the clock for waits.
    connect: opens the port; called again after a loss.
    kind: ``serial``, ``emulated``, …, for the identity.
    reconnect: s allowed for a lost device to return; by default as its rig file says.
    identity: further entries of the identity that are known before the device answers.
    by_hand: called when the operator turns something, if the operator is emulated too.

    Attributes
    ----------
    identity: see `Backend`.
    """

    #: name of the device in messages
    device = "device"

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        connect: Connect,
        *,
        kind: str,
        reconnect: float | None = None,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": kind, "name": rig.name, **(identity or {})}
        self._rig = rig
        self._connect = connect
        self._reconnection = Reconnection(
            clock,
            connect,
            lambda port: self._identify(port, again=True),
            rig.looked_for if reconnect is None else reconnect,
        )
        self._by_hand = by_hand
        self._outbox = Outbox(clock)
        self._contact: Contact | None = None
        self._opened = False
        self._rate = 0.0
        self._ends: dict[str, float] = {}  # ends of pulses timed by the host, s
        self._answered = False  # whether a command was answered since `next_sample` was called
        self._cut_off: set[str] = set()  # actuators driven, or possibly driven, when contact was lost
        self._failure_announced = False

    # --- to be implemented for each kind of device --------------------------------------------------------

    @abstractmethod
    def _identify(self, port: Port, *, again: bool) -> DeviceIdentification[Contact]:
        """Start to identify the device on a port just opened, or `again` on a port reopened after a loss.

        At its end the device has been verified, its outputs are safe, and it is sampling as before.
        """

    @abstractmethod
    def _safe_for_closing(self, contact: Contact) -> None:
        """Make outputs safe before closing; may raise `PortLost` and `Refused`."""

    @abstractmethod
    def _check_rate(self, rate: float) -> None:
        """Refuse a sampling rate that the device does not support."""

    @abstractmethod
    def _begin_sampling(self) -> None:
        """Start sampling at the current rate."""

    @abstractmethod
    def _advance(self, contact: Contact, until: float) -> None:
        """Let time pass until `until`, or until something has arrived or is due; may raise `PortLost`."""

    @abstractmethod
    def _put(self, actuator: str, value: float, duration: float | None, *, asked_for: bool) -> PendingCommand:
        """Send a checked command; `asked_for` if the caller waits for its answer.

        Raises
        ------
        OutOfReach
            contact is temporarily lost.
        """

    @abstractmethod
    def _make_safe(self, contact: Contact) -> None:
        """Make outputs safe, and wait for the answers; may raise `PortLost` and `Refused`."""

    @abstractmethod
    def _unanswered(self) -> list[PendingCommand]:
        """Return the unanswered commands, which may have been executed."""

    @abstractmethod
    def _drop_orders(self, why: str) -> None:
        """Abandon the exchange in progress and the pending commands, for the reason `why`."""

    @abstractmethod
    def _handle_loss(self, contact: Contact, error: PortLost) -> tuple[str, Port | None]:
        """Handle a loss of contact; return details for the message, and the port if it is still usable.

        A port that is no longer usable is closed.
        """

    @abstractmethod
    def _skip_missing(self, lost_at: float) -> int:
        """Return the number of samples lost since contact was lost at `lost_at`."""

    @property
    def _may_be_on(self) -> Mapping[str, float]:
        """The outputs that the device has not confirmed to be safe since they were commanded, SI."""
        return {}

    @property
    def _unseen_since(self) -> datetime | None:
        """The calendar time of the last contact, if a restart may switch outputs on; None if it leaves them
        safe."""
        return None

    @property
    @abstractmethod
    def _failure(self) -> str:
        """Why the device has stopped working or can no longer be trusted; empty otherwise."""

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect to the device, check its identity, and make its outputs safe."""
        port: Port | None = None
        try:
            port = self._connect()
            self._contact = self._identify(port, again=False).carry_through()
        # Also for Ctrl-C: a port, or its guard, must not be left behind half opened.
        except BaseException as error:
            if port is not None:
                port.close()
            if isinstance(error, NotConfirmed):
                raise OutputsNotSafe(f"the outputs may not be safe: {error}", self._may_be_on) from None
            if isinstance(error, PortLost):
                raise BackendLost(f"the bench cannot be reached: {error}") from None
            raise
        self._opened = True

    def close(self) -> None:
        """Make outputs safe if the device can still be reached, and close the port."""
        # Whatever follows fails or not, the bench is closed.
        contact, self._contact = self._contact, None
        self._opened = False
        self._reconnection.drop()
        self._drop_orders("the bench was let go")
        if contact is None:
            return
        with suppress(PortLost, Refused):  # left to the device's guard or watchdog
            self._safe_for_closing(contact)
        contact.port.close()

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Start sampling at `rate` Hz."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '10 Hz'")
        self._check_rate(rate)
        self._check_open()
        # Set although contact may be lost: a device that comes back samples at the newest rate.
        self._rate = rate
        self._begin_sampling()

    def next_sample(self, timeout: float) -> Sample | None:
        """Return the next sample, on the bench's clock."""
        self._check_open()
        deadline = self.clock.now() + timeout
        self._answered = False
        # Samples in hand come first: they are handed over even if the device has failed since they were
        # taken.
        while not self._outbox.samples:
            if self._failure:
                if self._failure_announced:
                    raise BackendLost(self._failure)
                self._failure_announced = True  # raise at the next call: notices must be fetched first
                return None
            # A command was answered: the caller may wait for just that, and no sample need come.
            if self._answered or self.clock.now() >= deadline:
                return None
            self._pump(deadline)
        return self._outbox.samples.popleft()

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the ends of pulses, and switches made by the device itself."""
        return self._outbox.take_receipts()

    def take_notices(self) -> list[Notice]:
        """Return gaps, damage, trips, losses and reconnections."""
        return self._outbox.take_notices()

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command; its receipt gives the time at which the device executed it."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        # Nothing to send: a person turns it. The value is noted, so that samples state it from here on.
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._outbox.commanded[actuator] = value
            return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))
        return self._put(actuator, value, duration, asked_for=True)

    def safe(self) -> None:
        """Bring every output to the rig's safe state now."""
        self._check_open()
        # Before anything is sent: no pulse may end, no queued command be sent, after the outputs are safe.
        self._ends.clear()
        self._drop_orders(f"outputs were made safe before the {self.device} had answered")
        # Out of reach: nothing is sent to a device that has not been identified again. The reconnection makes
        # it safe before anything else; until then it is left to its guard or watchdog.
        contact = self._contact
        if contact is None:
            why = f"the bench cannot be reached: {self._reconnection.why}"
            raise OutputsNotSafe(why, self._may_be_on, self._unseen_since)
        try:
            self._make_safe(contact)
        except Refused as error:
            raise OutputsNotSafe(f"the outputs may not be safe: {error}", self._may_be_on) from None
        except PortLost as error:
            self._lose(error)
            why = f"the outputs may not be safe: {error}"
            raise OutputsNotSafe(why, self._may_be_on, self._unseen_since) from None

    # --- internal -----------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _check_reach(self) -> Contact:
        """Return the connection; raises `OutOfReach` while it is lost."""
        if self._contact is None:
            raise OutOfReach(f"the {self.device} cannot be reached for the moment: {self._reconnection.why}")
        return self._contact

    def _pending(self, actuator: str, value: float) -> PendingCommand:
        """Return the `PendingCommand` for a command that is about to be sent."""
        return PendingCommand(actuator, value, lambda: self._pump(math.inf))

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _driven(self) -> set[str]:
        """Return the actuators whose commanded value is not the safe one."""
        commanded = self._outbox.commanded
        return {name for name, value in self._resting().items() if commanded.get(name) != value}

    def _note_safe(self) -> None:
        """Record the safe values as commanded; 0 for other actuators that were never commanded."""
        commanded = self._outbox.commanded
        self._outbox.commanded = dict.fromkeys(self._rig.actuators, 0.0) | commanded | self._resting()

    def _pump(self, until: float) -> None:
        """Let time pass until `until`, or until something arrives or is due."""
        # Before reading, as a pulse that the host times should not last until the next sample.
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
            with suppress(BackendLost):  # a device that is reconnected is made safe anyway
                self._put(actuator, float(self._rig.safe_state[actuator]), None, asked_for=False)

    def _doubt(self, pending: PendingCommand) -> None:
        """Record that a command may have been executed before contact was lost."""
        if pending.value != self._resting().get(pending.actuator):
            self._cut_off.add(pending.actuator)

    def _lose(self, error: PortLost) -> None:
        """Handle a loss of contact, and start reconnecting."""
        contact, self._contact = self._contact, None
        # The order matters: what may have been carried out is noted while it is still known; then pending
        # commands are given up, so that none is sent again by itself; only then the subclass may take what
        # has still arrived.
        for pending in self._unanswered():
            self._doubt(pending)
        self._drop_orders(f"contact with the {self.device} is lost: {error}")
        details, kept = ("", None) if contact is None else self._handle_loss(contact, error)
        # After `_handle_loss`, which may have read a last switch.
        self._cut_off |= self._driven()
        self._reconnection.begin(f"{error}{details}", kept)
        self._outbox.notice("fault", f"contact with the {self.device} is lost: {error}{details}")

    def _try_again(self, until: float) -> None:
        """Try to reconnect until bench time `until`."""
        contact = self._reconnection.attempt(until)
        if contact is None:
            return
        self._contact = contact
        # A device is here again, identified, safe and sampling. What remains is to tell the runner what it
        # has missed.
        now, lost_at = self.clock.now(), self._reconnection.since
        self._outbox.notice("note", f"the {self.device} is back after {now - lost_at:.1f} s, outputs safe")
        resting, switched_off = self._resting(), sorted(self._cut_off)
        self._cut_off.clear()
        half = 0.5 * (now - lost_at)  # they were switched off at an unknown time during the loss
        self._outbox.receipts += [
            CommandReceipt(now - half, name, resting[name], half) for name in switched_off
        ]
        missed = self._skip_missing(lost_at)
        if missed > 0 or switched_off:
            self._outbox.gap(missed, cause=self._reconnection.why, switched_off=switched_off)
