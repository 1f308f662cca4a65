"""A bench whose device is spoken to in lines, as the runner sees it: asked for each sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TypeVar

from rigctl.backends.commands import check_command
from rigctl.backends.errors import BackendLost, OutOfReach
from rigctl.backends.lines.duty import Duty, Outputs
from rigctl.backends.lines.greeting import Device, Greeting, greet
from rigctl.backends.lines.guard_port import GuardActed
from rigctl.backends.lines.poll import Poll
from rigctl.backends.lines.setting import Setter
from rigctl.backends.lines.talk import Refused, Talk
from rigctl.backends.protocol import CommandReceipt, Notice, Sample
from rigctl.backends.serial.port import Connect, PortLost
from rigctl.backends.serial.reaching import reach
from rigctl.backends.serial.reconnection import Reconnection
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Lines, Rig

T = TypeVar("T")

_SAFE_ANSWER = 0.2  # s for the answer to each command that makes safe: one second is all there is


class LineBench:
    """A `Backend` for a device that is described by the rig file's ``backend.lines``, on any `Port`.

    A sample is what the device answers when it is asked, stamped with the middle of the time that the
    questions took. A device has no memory of what it was not asked: a sample that could not be taken in its
    time is a gap.

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
        self._reconnection = Reconnection(
            clock, connect, lambda port: Greeting(port, clock, lines), reconnect
        )
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
        with reach(self._connect, Refused) as port:
            self._begin(greet(port, self.clock, self._lines))
        self._opened = True

    def close(self) -> None:
        """Make outputs safe where the device can still be reached, and let the port go."""
        talk, self._talk = self._talk, None
        self._opened = False
        self._reconnection.drop()
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
        while True:
            if self._over:
                if self._over_told:
                    raise BackendLost(self._over)
                self._over_told = True  # what was said of it is fetched first
                return None
            due = self._start + self._index / self._rate if self._rate else math.inf
            self._let_pass(min(due, deadline))
            talk = self._talk
            if talk is None:
                self._try_again(deadline)
            elif due <= deadline and not self._over:
                sample = self._ask_sample(talk)
                if sample is not None:
                    return sample
            if self.clock.now() >= deadline:
                return None

    def take_receipts(self) -> list[CommandReceipt]:
        """Ends of pulses, and switches that the device made by itself."""
        taken, self._receipts = self._receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Gaps, lines that were none, losses and returns."""
        taken, self._notices = self._notices + self._poll.take_notices(), []
        return taken

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> CommandReceipt:
        """Set an actuator; the receipt says between which times the device had the command."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._commanded[actuator] = value
            return CommandReceipt(self.clock.now(), actuator, value)
        self._ends.pop(actuator, None)
        in_reach = self._talk is not None
        if value != self._resting().get(actuator):
            self._duty.outputs = Outputs.DRIVEN
        try:
            receipt = self._carried_out(lambda talk: self._setter.set(talk, actuator, value))
        except OutOfReach:
            if in_reach and value != self._resting().get(actuator):  # it may have been carried out
                self._cut_off.add(actuator)
            raise
        self._commanded[actuator] = value
        if duration is not None:
            self._ends[actuator] = receipt.time + duration
        return receipt

    def safe(self) -> None:
        """Bring every output to the rig's safe state, now."""
        self._check_open()
        self._ends.clear()
        talk = self._talk
        if talk is None:
            raise BackendLost(f"the bench cannot be reached: {self._reconnection.why}")
        trouble = self._make_safe(talk)
        if trouble is not None:
            if isinstance(trouble, PortLost):
                self._lose(trouble)
            raise BackendLost(f"the outputs may not be safe: {trouble}")

    # --- inside -------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _begin(self, device: Device) -> None:
        """Take a device that has answered: the one that was there before, set up, safe."""
        talk, found = device.talk, device.identity
        known = {name: text for name, text in self.identity.items() if name in found}
        if known and known != found:
            raise RigctlError(
                "another device answers than before",
                value=", ".join(found.values()),
                exit_code=ExitCode.FAILED,
            )
        self.identity = {**self.identity, "port": talk.port.name, **found}
        trouble = self._make_safe(talk)
        if trouble is not None:
            raise trouble
        for exchange in self._lines.begin:
            talk.ask(exchange)
        self._commanded = dict.fromkeys(self._rig.actuators, 0.0) | self._commanded | self._resting()
        self._poll.forget(talk)
        self._talk = talk

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _make_safe(self, talk: Talk) -> PortLost | Refused | None:
        """Send all that makes safe, whatever becomes of each; the first trouble, if there was any.

        Once a device is silent its answers are not waited for any more: all of it takes a second at most.
        """
        first: PortLost | Refused | None = None
        silent = False
        for step in self._setter.safe_commands():
            try:
                if silent:
                    talk.send(step.text)
                else:
                    step.require(talk.ask(step.exchange, step.text, tries=1, timeout=_SAFE_ANSWER))
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

    def _let_pass(self, until: float) -> None:
        """Let time pass: pulses end, the device is kept awake, a lost one is looked for."""
        while True:
            self._end_pulses()
            talk, now = self._talk, self.clock.now()
            if now >= until:
                return
            if talk is None:
                self._try_again(until)
                if self._talk is None and self.clock.now() >= until:
                    return
                continue
            soonest = min((until, *self._ends.values()))
            keep_alive = self._lines.keep_alive
            try:
                if keep_alive is not None:
                    if now >= talk.last_sent + keep_alive.every:
                        talk.ask(keep_alive)
                    soonest = min(soonest, talk.last_sent + keep_alive.every)
                talk.idle(soonest)
            except GuardActed as acted:
                self._guard_acted(acted)
            except Refused as error:
                self._end(str(error))
                return
            except PortLost as error:
                self._lose(error)

    def _end_pulses(self) -> None:
        for actuator in [name for name, end in self._ends.items() if end <= self.clock.now()]:
            del self._ends[actuator]
            with suppress(OutOfReach):  # a device that comes back is made safe before anything else
                self._receipts.append(self.command(actuator, float(self._rig.safe_state[actuator])))

    def _ask_sample(self, talk: Talk) -> Sample | None:
        """Ask all that is due; None when the line was lost over it."""
        due = self._start + self._index / self._rate
        missed = math.floor((self.clock.now() - due) * self._rate)
        if missed > 0:
            self._gap(missed)
        self._index += missed + 1
        try:
            reading = self._poll.ask(talk, self._commanded)
        except GuardActed as acted:
            self._guard_acted(acted)
            return None
        except Refused as error:
            self._end(str(error))
            return None
        except PortLost as error:
            self._lose(error)
            return None
        for actuator, value in reading.changed.items():
            self._commanded[actuator] = value
            self._receipts.append(CommandReceipt(reading.time, actuator, value, reading.uncertainty))
            shown = self._rig.actuators[actuator].show(value)
            self._end(f"the device has set {actuator} to {shown} by itself")
        commands = tuple(self._commanded[name] for name in self._rig.layout.commands)
        return Sample(reading.time, reading.values, commands)

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

    def _carried_out(self, action: Callable[[Talk], T]) -> T:
        """Do something with the device, once; what a loss of the line has cut off is not made up for here."""
        talk = self._talk
        if self._over:
            raise BackendLost(self._over)
        if talk is None:
            raise OutOfReach(f"the device cannot be reached for the moment: {self._reconnection.why}")
        try:
            return action(talk)
        except GuardActed as acted:
            self._guard_acted(acted)
            raise OutOfReach(str(acted)) from None
        except PortLost as error:
            self._lose(error)
            raise OutOfReach(f"the line to the device is lost: {error}") from None
        except Refused as error:
            raise RigctlError(str(error), exit_code=ExitCode.FAILED) from None

    def _lose(self, error: PortLost) -> None:
        talk, self._talk = self._talk, None
        resting = self._resting()
        self._cut_off |= {name for name, value in resting.items() if self._commanded.get(name) != value}
        if talk is not None:
            talk.port.close()
        self._reconnection.begin(str(error))
        self._notice("fault", f"the line to the device is lost: {error}")

    def _try_again(self, until: float) -> None:
        """What can be done by bench time `until` to find the device again."""
        device = self._reconnection.attempt(until)
        if device is None:
            return
        try:
            self._begin(device)
        except (PortLost, Refused) as error:
            device.talk.port.close()
            self._reconnection.why = str(error)
            return
        except BaseException:
            device.talk.port.close()
            raise
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
