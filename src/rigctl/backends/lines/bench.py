"""A bench whose device is spoken to in lines, as the runner sees it: asked for each sample."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from rigctl.backends.commands import check_command
from rigctl.backends.conversation import Conversation, Underway, carry_through
from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.lines.duty import Duty, Outputs
from rigctl.backends.lines.greeting import greeting
from rigctl.backends.lines.guard_port import GuardActed
from rigctl.backends.lines.poll import Poll
from rigctl.backends.lines.setting import Setter
from rigctl.backends.lines.talk import Refused, Talk
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.serial.port import Connect, Port, PortLost
from rigctl.backends.serial.reaching import reach
from rigctl.backends.serial.reconnection import Meeting, Reconnection
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Exchange, Lines, Rig

_SAFE_ANSWER = 0.2  # s for the answer to each command that makes safe: one second is all there is


@dataclass(slots=True)
class _Order:
    """A command that the device has not answered yet.

    Parameters
    ----------
    asked_for: whether the caller waits for its answer; one that was replaced by a newer command is not.
    """

    pending: PendingCommand
    duration: float | None
    asked_for: bool


class LineBench:
    """A `Backend` for a device that is described by the rig file's ``backend.lines``, on any `Port`.

    A sample is what the device answers when it is asked, stamped with the middle of the time that the
    questions took. A device has no memory of what it was not asked: a sample that could not be taken in its
    time is a gap. The line carries one question at a time: a command that comes while a sample is being asked
    for waits for it, and only what makes safe does not.

    Parameters
    ----------
    rig, lines: what there is, and how it is spoken to.
    clock: what waits are counted on.
    connect: opens the port; called again when it was lost.
    kind: ``serial`` or ``emulated``, for the identity.
    reconnect: s for a lost device to come back.
    by_hand: told when the operator turns something, where the operator is emulated too.
    duty: where what is known of the outputs is kept for the guard.
    without_host: what becomes of the outputs when nobody can reach the device.
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
        reconnect: float = 30.0,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
        duty: Duty | None = None,
        without_host: str = "nothing else switches it off",
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": kind, "name": rig.name, **(identity or {})}
        self._rig = rig
        self._lines = lines
        self._connect = connect
        self._reconnection = Reconnection(clock, connect, self._meet, reconnect)
        self._by_hand = by_hand
        self._duty = duty or Duty()
        self.without_host = without_host
        self._setter = Setter(rig, lines)
        self._poll = Poll(rig, lines, clock)
        self._talk: Talk | None = None
        self._opened = False
        self._rate = 0.0
        self._start = 0.0
        self._index = 0
        self._ends: dict[str, float] = {}
        self._job: Underway[None] | None = None  # what the device is being asked
        self._order: _Order | None = None  # the command in it, if it is one
        self._orders: deque[_Order] = deque()  # that come next
        self._samples: deque[Sample] = deque()
        self._answered = False  # a command, since `next_sample` was called
        self._commanded: dict[str, float] = {}
        self._receipts: list[CommandReceipt] = []
        self._notices: list[Notice] = []
        self._cut_off: set[str] = set()  # what was driven, or may have been, when the line was lost
        self._over = ""  # why the device cannot be trusted any more
        self._over_told = False

    @property
    def outputs_read(self) -> frozenset[str]:
        """Actuators that a query has read since the device was reached."""
        return frozenset(self._poll.states_read)

    @property
    def outputs_answered(self) -> frozenset[str]:
        """Actuators whose commands have a `reply`."""
        return frozenset(name for name, part in self._lines.actuators.items() if part.patterns)

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Reach the device, check what it is, and make its outputs safe."""
        with reach(self._connect) as port:
            self._talk = self._meet(port).carry_through()
        self._opened = True

    def close(self) -> None:
        """Make outputs safe where the device can still be reached, and let the port go."""
        talk, self._talk = self._talk, None
        self._opened = False
        self._reconnection.drop()
        self._drop_orders("the bench was let go")
        if talk is None:
            return
        self._make_safe(talk)
        talk.port.close()

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Ask for a sample `rate` times a second from now on."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '1 Hz'")
        fastest = self._lines.fastest
        if fastest is not None and rate > fastest * (1.0 + 1e-9):
            raise RigctlError(
                "the device cannot be asked so often",
                value=f"{rate:g} Hz",
                expected=f"at most {fastest:g} Hz",
            )
        self._check_open()
        self._rate, self._start, self._index = rate, self.clock.now(), 0

    def next_sample(self, timeout: float) -> Sample | None:
        """Ask for the next sample when it is due."""
        self._check_open()
        deadline = self.clock.now() + timeout
        self._answered = False
        while not self._samples:
            if self._over:
                if self._over_told:
                    raise BackendLost(self._over)
                self._over_told = True  # what was said of it is fetched first
                return None
            if self._answered or self.clock.now() >= deadline:
                return None
            self._pump(deadline)
        return self._samples.popleft()

    def take_receipts(self) -> list[CommandReceipt]:
        """Ends of pulses, and switches that the device made by itself."""
        taken, self._receipts = self._receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Gaps, lines that were none, losses and returns."""
        taken, self._notices = self._notices + self._poll.take_notices(), []
        return taken

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command; its receipt will say between which times the device had it."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._commanded[actuator] = value
            return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))
        return self._put(actuator, value, duration, asked_for=True)

    def safe(self) -> None:
        """Bring every output to the rig's safe state, now."""
        self._check_open()
        self._ends.clear()
        interrupted = self._job is not None
        if interrupted and self._order is None:
            self._index -= 1  # the sample will be asked for anew
        self._drop_orders("outputs were made safe before the device had answered")
        talk = self._talk
        if talk is None:
            raise BackendLost(f"the bench cannot be reached: {self._reconnection.why}")
        trouble = self._make_safe(talk, at_once=interrupted)
        if trouble is not None:
            if isinstance(trouble, PortLost):
                self._lose(trouble)
            raise BackendLost(f"the outputs may not be safe: {trouble}")

    # --- inside -------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _meet(self, port: Port) -> Meeting[Talk]:
        """Begin to ask who is there, on a port that has just been opened."""
        talk = Talk(port, self.clock, self._lines)
        return Meeting(port, talk.take, self._greet(talk))

    def _greet(self, talk: Talk) -> Conversation[Talk]:
        try:
            yield from self._begin(talk)
        except Refused as error:
            raise PortLost(str(error)) from None
        return talk

    def _begin(self, talk: Talk) -> Conversation[None]:
        """Take a device that answers: the one that was there before, set up, safe."""
        found = yield from greeting(talk, self.clock, self._lines)
        known = {name: text for name, text in self.identity.items() if name in found}
        if known and known != found:
            raise RigctlError(
                "another device answers than before",
                value=", ".join(found.values()),
                exit_code=ExitCode.FAILED,
            )
        self.identity = {**self.identity, "port": talk.port.name, **found}
        trouble = yield from self._making_safe(talk)
        if trouble is not None:
            raise trouble
        for exchange in self._lines.begin:
            yield from talk.asking(exchange)
        self._commanded = dict.fromkeys(self._rig.actuators, 0.0) | self._commanded | self._resting()
        self._poll.forget(talk)

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _make_safe(self, talk: Talk, *, at_once: bool = False) -> PortLost | Refused | None:
        """Make it safe, and wait for the answers; the first trouble, if there was any.

        Parameters
        ----------
        at_once: the device has not answered its last question; that is not waited for.
        """
        if at_once:
            talk.abandon()
            with suppress(PortLost):  # said by what follows, which waits for answers
                for step in self._setter.safe_commands():
                    talk.send(step.text)
        return carry_through(self._making_safe(talk), talk.take)

    def _making_safe(self, talk: Talk) -> Conversation[PortLost | Refused | None]:
        """Send all that makes safe, whatever becomes of each.

        Once a device is silent its answers are not waited for any more: all of it takes a second at most.
        """
        first: PortLost | Refused | None = None
        silent = False
        for step in self._setter.safe_commands():
            try:
                if silent:
                    talk.send(step.text)
                    continue
                answer = yield from talk.asking(step.exchange, step.text, tries=1, timeout=_SAFE_ANSWER)
                step.require(answer)
            except GuardActed as acted:
                self._guard_acted(acted)
                talk.send(step.text)
            except PortLost as error:
                first, silent = first or error, True
            except Refused as error:
                first = first or error
        if first is None:
            self._commanded |= self._resting()
            self._duty.outputs = Outputs.SAFE
        return first

    def _put(self, actuator: str, value: float, duration: float | None, *, asked_for: bool) -> PendingCommand:
        """Send a command, or let it wait for the answer to what the device is being asked."""
        if self._over:
            raise BackendLost(self._over)
        if self._talk is None:
            raise OutOfReach(f"the device cannot be reached for the moment: {self._reconnection.why}")
        self._ends.pop(actuator, None)
        self._replace(actuator)
        if value != self._resting().get(actuator):
            self._duty.outputs = Outputs.DRIVEN
        pending = PendingCommand(actuator, value, lambda: self._pump(math.inf))
        self._orders.append(_Order(pending, duration, asked_for))
        if self._job is None:
            self._attempt(self._begin_next)
        if isinstance(pending.trouble, OutOfReach):
            raise pending.trouble
        return pending

    def _replace(self, actuator: str) -> None:
        """A newer command comes: one that was not sent yet is dropped, one that was is not waited for."""
        for order in [order for order in self._orders if order.pending.actuator == actuator]:
            self._orders.remove(order)
            order.pending.trouble = OutOfReach("another command came before it was sent")
        if self._order is not None and self._order.pending.actuator == actuator:
            self._order.asked_for = False

    def _pump(self, until: float) -> None:
        """Let time pass up to `until`, or until something has arrived or is due."""
        self._end_pulses()
        if self._talk is None:
            self._try_again(until)
        else:
            self._attempt(lambda talk: self._advance(talk, until))

    def _attempt(self, action: Callable[[Talk], object]) -> None:
        """Do something on the line, whatever becomes of it."""
        if self._talk is None:
            return
        try:
            action(self._talk)
        except GuardActed as acted:
            self._guard_acted(acted)
            self._drop_orders(str(acted))
        except Refused as error:
            self._job = self._order = None
            self._end(str(error))
        except PortLost as error:
            self._lose(error)

    def _advance(self, talk: Talk, until: float) -> None:
        """Go on with what the device is being asked, or with what is due."""
        if self._job is None:
            self._begin_next(talk)
        soonest = min((until, *self._ends.values()))
        if self._job is None:
            talk.idle(min(soonest, self._due(), self._keep_alive_due(talk)))
            return
        self._job.take(talk.take, soonest)
        self._finish_job()

    def _begin_next(self, talk: Talk) -> None:
        """Begin with what comes first: commands, then what keeps the device awake, then the sample."""
        now = self.clock.now()
        keep_alive = self._lines.keep_alive
        if self._orders:
            self._order = self._orders.popleft()
            conversation = self._carry_out(talk, self._order)
        elif keep_alive is not None and now >= self._keep_alive_due(talk):
            conversation = _ask(talk, keep_alive)
        elif now >= self._due() and not self._over:
            conversation = self._ask_sample(talk)
        else:
            return
        self._job = Underway(conversation)
        self._finish_job()

    def _finish_job(self) -> None:
        if self._job is not None and self._job.over:
            self._job = self._order = None

    def _due(self) -> float:
        """When the next sample is due, s."""
        return self._start + self._index / self._rate if self._rate else math.inf

    def _keep_alive_due(self, talk: Talk) -> float:
        """When the device has to be spoken to, s."""
        return math.inf if self._lines.keep_alive is None else talk.last_sent + self._lines.keep_alive.every

    def _carry_out(self, talk: Talk, order: _Order) -> Conversation[None]:
        """Set an actuator, and note what the device says of it."""
        pending = order.pending
        try:
            receipt = yield from self._setter.setting(talk, pending.actuator, pending.value)
        except Refused as error:
            pending.trouble = RigctlError(str(error), exit_code=ExitCode.FAILED)
            if not order.asked_for:
                self._end(str(error))
        else:
            self._commanded[pending.actuator] = pending.value
            if order.duration is not None:
                self._ends[pending.actuator] = receipt.time + order.duration
            pending.receipt = receipt
            if not order.asked_for:
                self._receipts.append(receipt)
        self._answered = self._answered or order.asked_for

    def _end_pulses(self) -> None:
        for actuator in [name for name, end in self._ends.items() if end <= self.clock.now()]:
            del self._ends[actuator]
            with suppress(BackendLost):  # a device that comes back is made safe before anything else
                self._put(actuator, float(self._rig.safe_state[actuator]), None, asked_for=False)

    def _drop_orders(self, why: str) -> None:
        """Leave what the device is being asked, and what was to come next; no answer is waited for."""
        if self._job is not None:
            self._job.drop()
        dropped = [*([self._order] if self._order is not None else []), *self._orders]
        for order in dropped:
            order.pending.trouble = order.pending.trouble or OutOfReach(why)
            self._answered = True
        self._job = self._order = None
        self._orders.clear()

    def _ask_sample(self, talk: Talk) -> Conversation[None]:
        """Ask all that is due."""
        missed = math.floor((self.clock.now() - self._due()) * self._rate)
        if missed > 0:
            self._gap(missed)
        self._index += missed + 1
        reading = yield from self._poll.asking(talk, self._commanded)
        for actuator, value in reading.changed.items():
            self._commanded[actuator] = value
            self._receipts.append(CommandReceipt(reading.time, actuator, value, reading.uncertainty))
            shown = self._rig.actuators[actuator].show(value)
            self._end(f"the device has set {actuator} to {shown} by itself")
        commands = tuple(self._commanded[name] for name in self._rig.layout.commands)
        self._samples.append(Sample(reading.time, reading.values, commands))

    def _end(self, why: str) -> None:
        """The device cannot be trusted any more: the next samples are the last ones."""
        self._over = self._over or why
        self._notice("alarm", why)

    def _guard_acted(self, acted: GuardActed) -> None:
        """The guard has made outputs safe while nothing was heard of this process."""
        changed = {
            name: value for name, value in self._resting().items() if self._commanded.get(name) != value
        }
        self._commanded |= changed
        self._ends.clear()
        now = self.clock.now()
        self._receipts += [CommandReceipt(now, name, value, acted.silence) for name, value in changed.items()]
        if changed:
            self._end(str(acted))
        else:
            self._notice("note", str(acted))

    def _lose(self, error: PortLost) -> None:
        talk, self._talk = self._talk, None
        resting = self._resting()
        self._cut_off |= {name for name, value in resting.items() if self._commanded.get(name) != value}
        if self._order is not None:  # it may have been carried out
            sent = self._order.pending
            self._cut_off |= {sent.actuator} if sent.value != resting.get(sent.actuator) else set()
        self._drop_orders(f"the line to the device is lost: {error}")
        if talk is not None:
            talk.port.close()
        self._reconnection.begin(str(error))
        self._notice("fault", f"the line to the device is lost: {error}")

    def _try_again(self, until: float) -> None:
        """What can be done by bench time `until` to find the device again."""
        talk = self._reconnection.attempt(until)
        if talk is None:
            return
        self._talk = talk
        now = self.clock.now()
        self._notice("note", f"the device is back after {now - self._reconnection.since:.1f} s, outputs safe")
        resting, switched_off = self._resting(), sorted(self._cut_off)
        self._cut_off.clear()
        half = 0.5 * (now - self._reconnection.since)  # when they went off is not known any better
        self._receipts += [CommandReceipt(now - half, name, resting[name], half) for name in switched_off]
        missed = math.floor((now - self._start) * self._rate) + 1 - self._index if self._rate else 0
        if missed > 0 or switched_off:
            self._gap(max(missed, 0), cause=self._reconnection.why, switched_off=switched_off)
            self._index += max(missed, 0)

    def _gap(self, missed: int, *, cause: str = "", switched_off: Sequence[str] = ()) -> None:
        """Samples that will not come, and what went to its safe value meanwhile without being told to."""
        message = f"{missed} samples missing before {self.clock.now():.3f} s"
        if cause:
            message += f": {cause}"
        fields: dict[str, object] = {"samples": missed}
        if switched_off:
            message += f"; meanwhile {', '.join(switched_off)} went to the safe state"
            fields["switched_off"] = list(switched_off)
        self._notice("gap", message, **fields)

    def _notice(self, kind: str, message: str, **fields: object) -> None:
        self._notices.append(Notice(self.clock.now(), kind, message, fields))


def _ask(talk: Talk, exchange: Exchange) -> Conversation[None]:
    """Ask something for the asking alone."""
    yield from talk.asking(exchange)
