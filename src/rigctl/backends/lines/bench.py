"""The backend for a device with a line-based text protocol, which is queried for every sample.

In: the rig file's ``backend.lines``, which says what is sent and which answers are expected. Out: a
sample for each round of queries, and the time of each command to within the interval between query and
answer. Modbus, VISA, OPC UA and Python drivers come through here too, each behind a `ClientPort` that
speaks in lines.

The line has neither tags nor checksums, so there is one exchange at a time (`_job`), and commands wait in
`_orders` for the one in progress. The next exchange is chosen in `_begin_next`: a command before the
keep-alive message before a sample. Only making safe waits for nothing: it abandons the exchange in
progress, whose answer may still arrive, and is then out of step with the device until the line has been
resynchronised.

Two kinds of failure are kept apart. A loss of contact (`PortLost`) is searched for and may end well. A device
that answers but does not do what it was told (`_distrust`) is not searched for: the run ends, as its outputs
are no longer what the data say.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta

from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.lines.doubt import InDoubt
from rigctl.backends.lines.error_queue import errors_in_queue
from rigctl.backends.lines.handshake import handshake
from rigctl.backends.lines.line_client import LineClient
from rigctl.backends.lines.poll import Poll, PolledSample
from rigctl.backends.lines.safe_state import SafeState
from rigctl.backends.lines.setting import Setter
from rigctl.backends.protocol import CommandReceipt, PendingCommand, Sample
from rigctl.backends.transport.bench import PortBench
from rigctl.backends.transport.conversation import ActiveConversation, Conversation, carry_through
from rigctl.backends.transport.guard_port import GuardActed, GuardedPort
from rigctl.backends.transport.port import AnotherDevice, Connect, NotConfirmed, Port, PortLost, Refused
from rigctl.backends.transport.reconnection import DeviceIdentification
from rigctl.backends.transport.safe_commands import Duty, Outputs
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Exchange, Lines, Rig

_SAFE_ANSWER = 0.2  # s for the answer to each safe command at the end of a run, which must be safe within 1 s
#: on a device whose answers take longer, this times the slowest of the newest, up to the rig file's time-out
_SAFE_MARGIN = 2.0


@dataclass(slots=True)
class _Order:
    """A command that the device has not yet answered.

    Parameters
    ----------
    asked_for: whether the caller waits for its answer; not if a newer command has replaced it.
    """

    pending: PendingCommand
    duration: float | None
    asked_for: bool


class LineBench(PortBench[LineClient]):
    """A `Backend` for a device that is described by the rig file's ``backend.lines``, on any `Port`.

    A sample consists of the device's answers; its time stamp is the middle of the interval of the queries. A
    device does not buffer: a sample that could not be taken in time becomes a gap. The line carries one query
    at a time, so that a command waits for a sample in progress; only commands that make outputs safe do not.

    Parameters
    ----------
    rig, lines: the bench, and the protocol of its device.
    clock: for waiting.
    connect: opens the port; called again when it was lost.
    kind: ``serial`` or ``emulated``, for the identity.
    reconnect: s allowed for a lost device to return.
    by_hand: called when the operator turns something, if the operator is emulated too.
    duty: the known state of the outputs, for the guard.
    without_host: what happens to the outputs if the host can no longer reach the device, one sentence.
    """

    timed = False

    def __init__(
        self,
        rig: Rig,
        lines: Lines,
        clock: Clock,
        connect: Connect,
        *,
        kind: str,
        reconnect: float | None = None,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
        duty: Duty | None = None,
        without_host: str = "nothing else switches it off",
    ) -> None:
        super().__init__(
            rig, clock, connect, kind=kind, reconnect=reconnect, identity=identity, by_hand=by_hand
        )
        self._lines = lines
        self._duty = duty or Duty()
        self.without_host = without_host
        self._setter = Setter(rig, lines)
        self._safe_state = SafeState(rig, lines, self._setter, clock, self._guard_acted)
        self._in_doubt = InDoubt(self._setter.safe_values, self._duty)
        self._poll = Poll(rig, lines, clock, self._outbox)
        self._last_answer = 0.0  # s, before contact was lost
        self._start = 0.0
        self._index = 0
        self._job: ActiveConversation[None] | None = None  # the query in progress
        self._order: _Order | None = None  # the command that it sends, if it sends one
        self._orders: deque[_Order] = deque()  # commands to be sent next
        self._interrupted = False  # a query was in progress when `safe` was called; its answer is not awaited
        self._exchanged = False  # another device may be on the line: it is identified before any command
        self._takes = math.inf  # s, shortest time so far of the queries that are made for each sample
        self._distrust = ""  # why the device can no longer be trusted; empty if it can

    @property
    def outputs_read(self) -> frozenset[str]:
        """Actuators whose state a query has read since the connection was made."""
        return frozenset(self._poll.states_read)

    @property
    def outputs_answered(self) -> frozenset[str]:
        """Actuators whose commands the device answers, according to the rig file."""
        asked = self._lines.confirm is not None
        return frozenset(name for name, part in self._lines.actuators.items() if part.patterns or asked)

    @property
    def sample_takes(self) -> float:
        """s that a sample takes, the shortest so far; 0 before there is one."""
        return self._takes if math.isfinite(self._takes) else 0.0

    @property
    def _failure(self) -> str:
        return self._distrust

    @property
    def _may_be_on(self) -> Mapping[str, float]:
        return self._in_doubt.may_be_on

    @property
    def _unseen_since(self) -> datetime | None:
        """The rig file does not say how the outputs are at power-on."""
        return self.clock.date() - timedelta(seconds=self.clock.now() - self._last_answer)

    # --- identification -----------------------------------------------------------------------------------

    def _identify(self, port: Port, *, again: bool) -> DeviceIdentification[LineClient]:
        client = LineClient(port, self.clock, self._lines)
        return DeviceIdentification(port, client.take, self._begin(client))

    def _begin(self, client: LineClient) -> Conversation[LineClient]:
        """Identify the device, check that it is the same as before, make it safe and set it up."""
        # 1. Who is there? Nothing that sets anything is sent before this is known.
        found = yield from handshake(client, self.clock, self._lines)
        known = self._duty.identity
        if known is not None and known != found:  # one such answer may be a damaged one
            found = yield from handshake(client, self.clock, self._lines)
        if known is not None and known != found:
            self._in_doubt.exchanged()
            raise RigctlError(
                "another device answers than before",
                value=", ".join(found.values()),
                expected=", ".join(known.values()),
                exit_code=ExitCode.FAILED,
            )
        # 2. The right one: from here on its guard may command it.
        self._duty.identity = found
        self.identity = {**self.identity, "port": client.port.name, **found}
        if isinstance(client.port, GuardedPort):
            client.port.identified(found)
        # 3. Errors of before this run, which would be taken for refusals of the first command.
        earlier = yield from errors_in_queue(client, self._lines)
        if earlier:
            text = f"the device had errors from before: {', '.join(map(repr, earlier))}"
            self._outbox.notice("note", text, errors=earlier)
        # 4. Outputs safe, and confirmed. Otherwise the device is not a contact: whatever had been restored
        #   would be on top of an unknown state.
        trouble = yield from self._making_safe(client, self._lines.timeout)
        if trouble is not None:
            raise NotConfirmed(str(trouble))
        # 5. The set-up of the rig file, then every query as for the first time.
        for exchange in self._lines.begin:
            yield from client.asking(exchange)
        self._poll.forget(client)
        return client

    # --- making safe --------------------------------------------------------------------------------------

    def safe(self) -> None:
        """Bring every output to the rig's safe state now; a sample in progress is taken again afterwards."""
        # Noted before the base class drops the exchange in progress.
        self._interrupted = self._job is not None
        if self._interrupted and self._order is None:
            self._index -= 1
        super().safe()

    def _make_safe(self, client: LineClient) -> None:
        if self._interrupted:
            self._interrupted = False
            client.abandon()
        # A state has changed by itself: another device may be on the line. `asking` identifies it before it
        # sends anything, as the line is not in step; it then costs one exchange before the outputs are off.
        if self._exchanged:
            client.abandon()
        elif not client.in_step:  # resynchronising takes time, so the commands are sent without waiting first
            try:
                for step in self._setter.safe_commands():
                    client.send(step.text)
            except GuardActed as acted:
                self._guard_acted(acted)  # still being answered: the line stays out of step
            except PortLost:  # reported by the commands that follow, which wait for answers
                pass
        self._safe_for_closing(client)

    def _safe_for_closing(self, client: LineClient) -> None:
        patience = max(_SAFE_ANSWER, min(_SAFE_MARGIN * client.slowest, self._lines.timeout))
        trouble = carry_through(self._making_safe(client, patience), client.take)
        if trouble is not None:
            raise trouble

    def _making_safe(self, client: LineClient, patience: float) -> Conversation[PortLost | Refused | None]:
        """Make outputs safe, and return why the device has not confirmed this; None if it has."""
        outcome = yield from self._safe_state.making(client, patience)
        self._in_doubt.made_safe(outcome)
        if outcome.trouble is None:
            self._note_safe()
        return outcome.trouble

    # --- commands -----------------------------------------------------------------------------------------

    def _put(self, actuator: str, value: float, duration: float | None, *, asked_for: bool) -> PendingCommand:
        """Send a command, or queue it until the query in progress has been answered."""
        if self._distrust:
            raise BackendLost(self._distrust)
        client = self._check_reach()
        # A new command ends a pulse of the same actuator without switching it back.
        self._ends.pop(actuator, None)
        self._replace(actuator)
        # Before it is sent, and before it is queued: whatever becomes of it, it may be on from now on.
        if value != self._resting().get(actuator):
            self._in_doubt.commanded(actuator, value)
        pending = self._pending(actuator, value)
        self._orders.append(_Order(pending, duration, asked_for))
        # Nothing is in progress: it is sent within this call, not at the next `next_sample`.
        if self._job is None:
            try:
                self._attempt(lambda: self._begin_next(client))
            except PortLost as error:
                self._lose(error)
        if isinstance(pending.trouble, OutOfReach):
            raise pending.trouble
        return pending

    def _replace(self, actuator: str) -> None:
        """Supersede earlier commands to an actuator: those not yet sent are dropped, and the caller no longer
        waits for one that was."""
        for order in [order for order in self._orders if order.pending.actuator == actuator]:
            self._orders.remove(order)
            order.pending.trouble = OutOfReach("another command came before it was sent")
        if self._order is not None and self._order.pending.actuator == actuator:
            self._order.asked_for = False

    def _carry_out(self, client: LineClient, order: _Order) -> Conversation[None]:
        """Set an actuator, and record the device's answer."""
        pending = order.pending
        # An output that is read only now and then is read once more: after the command it could no longer be
        # told whether the device had switched it by itself.
        if pending.value != self._outbox.commanded.get(pending.actuator):
            state = yield from self._poll.verifying(client, pending.actuator, self._outbox.commanded)
            self._take_changes(state)
        try:
            receipt = yield from self._setter.setting(client, pending.actuator, pending.value)
        except Refused as error:
            pending.trouble = RigctlError(str(error), exit_code=ExitCode.FAILED)
            # Nobody waits for this answer (the end of a pulse, or a command that was replaced): the refusal
            # ends the run.
            if not order.asked_for:
                self._end(str(error))
        else:
            self._outbox.commanded[pending.actuator] = pending.value
            read, answered = self._setter.is_read(pending.actuator), pending.actuator in self.outputs_answered
            if answered and not read:  # its answer is all that there is
                self._in_doubt.found(pending.actuator, pending.value)
            if order.duration is not None:
                self._ends[pending.actuator] = receipt.time + order.duration
            pending.receipt = receipt
            if not order.asked_for:
                self._outbox.receipts.append(receipt)
        self._answered = self._answered or order.asked_for

    def _drop_orders(self, why: str) -> None:
        """Abandon the query in progress and the queued commands, without waiting for any answer."""
        if self._job is not None:
            self._job.drop()
        dropped = [*([self._order] if self._order is not None else []), *self._orders]
        for order in dropped:
            order.pending.trouble = order.pending.trouble or OutOfReach(why)
            self._answered = True
        self._job = self._order = None
        self._orders.clear()

    # --- the line over time -------------------------------------------------------------------------------

    def _advance(self, client: LineClient, until: float) -> None:
        """Continue the query in progress, or start what is due."""
        self._attempt(lambda: self._go_on(client, until))

    def _attempt(self, action: Callable[[], object]) -> None:
        """Use the line; neither an intervention of the guard nor a refusal counts as a loss of contact."""
        try:
            action()
        except GuardActed as acted:
            self._guard_acted(acted)
            self._drop_orders(str(acted))
            if self._contact is not None:
                self._contact.abandon()  # what the guard has sent is still being answered
        except Refused as error:
            self._job = self._order = None
            self._end(str(error))

    def _go_on(self, client: LineClient, until: float) -> None:
        if self._job is None:
            self._begin_next(client)
        soonest = min((until, *self._ends.values()))
        if self._job is None:
            client.idle(min(soonest, self._due(), self._keep_alive_due(client)))
            return
        self._job.take(client.take, soonest)
        self._finish_job()

    def _begin_next(self, client: LineClient) -> None:
        """Start what is due next: a command, otherwise the keep-alive message, otherwise a sample."""
        now = self.clock.now()
        keep_alive = self._lines.keep_alive
        if self._orders:
            self._order = self._orders.popleft()
            conversation = self._carry_out(client, self._order)
        elif keep_alive is not None and now >= self._keep_alive_due(client):
            conversation = _ask(client, keep_alive)
        elif now >= self._due() and not self._distrust:
            conversation = self._ask_sample(client)
        else:
            return
        self._job = ActiveConversation(conversation)
        self._finish_job()

    def _finish_job(self) -> None:
        if self._job is not None and self._job.over:
            self._job = self._order = None

    def _due(self) -> float:
        """Return the time at which the next sample is due, s."""
        return self._start + self._index / self._rate if self._rate else math.inf

    def _keep_alive_due(self, client: LineClient) -> float:
        """Return the time at which the next keep-alive message is due, s."""
        return math.inf if self._lines.keep_alive is None else client.last_sent + self._lines.keep_alive.every

    # --- samples ------------------------------------------------------------------------------------------

    def _check_rate(self, rate: float) -> None:
        fastest = self._lines.fastest
        if fastest is not None and rate > fastest * (1.0 + 1e-9):
            raise RigctlError(
                "the device cannot be asked so often",
                value=f"{rate:g} Hz",
                expected=f"at most {fastest:g} Hz",
            )

    def _begin_sampling(self) -> None:
        self._start, self._index = self.clock.now(), 0

    def _ask_sample(self, client: LineClient) -> Conversation[None]:
        """Send the queries that are due, and store their answers as a sample."""
        # A device does not buffer: what could not be asked for in time is missing, and is reported at once.
        # The grid stays, so that later samples keep their phase.
        missed = math.floor((self.clock.now() - self._due()) * self._rate)
        if missed > 0:
            self._outbox.gap(missed)
        self._index += missed + 1
        # Changes are taken before the sample is queued: its commands are those that were in force when it was
        # read.
        reading = yield from self._poll.asking(client, self._outbox.commanded, spacing=1.0 / self._rate)
        self._takes = min(self._takes, reading.takes or math.inf)
        self._take_changes(reading)
        commands = tuple(self._outbox.commanded[name] for name in self._rig.layout.commands)
        self._outbox.samples.append(Sample(reading.time, reading.values, commands))

    def _take_changes(self, reading: PolledSample) -> None:
        """Record the states that were read, and outputs that the device has switched without a command."""
        for actuator, value in reading.states.items():
            self._in_doubt.found(actuator, value)
        for actuator, value in reading.changed.items():
            self._outbox.commanded[actuator] = value
            self._outbox.receipts.append(CommandReceipt(reading.time, actuator, value, reading.uncertainty))
            shown = self._rig.actuators[actuator].show(value)
            self._exchanged = True
            self._end(f"the device has set {actuator} to {shown} by itself")

    # --- loss of contact, and actions of the device or its guard ------------------------------------------

    def _end(self, why: str) -> None:
        """Record why the device can no longer be trusted; no further sample is started."""
        self._distrust = self._distrust or why
        self._outbox.notice("alarm", why)

    def _guard_acted(self, acted: GuardActed) -> None:
        """Record that the guard has made outputs safe because this process was silent."""
        outbox, commanded = self._outbox, self._outbox.commanded
        # The outputs that were on have been switched off at some time during the silence, which is the
        # uncertainty. With none on, nothing has changed, and the run may go on.
        changed = {name: value for name, value in self._resting().items() if commanded.get(name) != value}
        commanded |= changed
        self._ends.clear()
        now = self.clock.now()
        outbox.receipts += [
            CommandReceipt(now, name, value, acted.silence) for name, value in changed.items()
        ]
        if changed:
            self._end(str(acted))
        else:
            outbox.notice("note", str(acted))

    def _unanswered(self) -> list[PendingCommand]:
        return [] if self._order is None else [self._order.pending]

    def _handle_loss(self, client: LineClient, error: PortLost) -> tuple[str, Port | None]:
        if isinstance(error, AnotherDevice):
            self._in_doubt.exchanged()
            if isinstance(client.port, GuardedPort):
                client.port.exchanged()
        # When the device was last seen, for the report of an ending without contact.
        self._last_answer = client.last_answer
        self._duty.outputs = Outputs.DRIVEN  # a restart may switch them on, whatever they were
        client.port.close()
        return "", None

    def _skip_missing(self, lost_at: float) -> int:
        missed = 0
        if self._rate:
            missed = max(math.floor((self.clock.now() - self._start) * self._rate) + 1 - self._index, 0)
        self._index += missed
        return missed


def _ask(client: LineClient, exchange: Exchange) -> Conversation[None]:
    """Make an exchange whose answer is not used."""
    yield from client.asking(exchange)
