"""The bench as steps see it: the newest readings, commands, and values known by name.

In: what steps ask for (`rigctl.plan.behaviour.StepBench`), and what the backend reports. Out: commands to the
backend, events in the log, and the answer to one question that every ending depends on: which outputs may be
on. Between the two this class keeps the state that a backend does not have: which commands are unanswered,
which pulses are in progress, when an actuator may be switched again.

An output is believed to be safe only where the bench has said so. From the moment a command other than
the safe value is sent it is in doubt (`doubtful`), until its receipt arrives; if the bench goes out of
reach, what is on or in doubt is what the run reports as unconfirmed. All of this is used by the main
loop's thread alone. See docs/decisions/0137-only-read-back-outputs-are-safe.md and 0046, 0146.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import Any

from rigctl.backends.errors import OutOfReach, OutputsNotSafe
from rigctl.backends.protocol import Backend, CommandReceipt, PendingCommand, Regulator
from rigctl.errors import RigctlError
from rigctl.expressions import Expression, ValueType, type_of_unit
from rigctl.plan.behaviour import Answer, OnPause, Pulse, Question, Row, Until, Waiting, every_sample
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.missing import Lack
from rigctl.plan.statistics import Statistic, Stretch
from rigctl.rig import Rig
from rigctl.runner.operators.attendance import Attendance
from rigctl.runner.operators.operator import Operator
from rigctl.runner.recent_samples import History
from rigctl.runner.recorder import Recorder
from rigctl.steps.approach import approach

#: s of bench time between two checks for the operator's answer
_ASK_AGAIN = 0.1


class Bench:
    """One rig with its backend, the run's data and its operator. All values SI, all times s on its clock."""

    def __init__(
        self, rig: Rig, backend: Backend, writer: Recorder, operator: Operator, history: History
    ) -> None:
        self.rig = rig
        self.backend = backend
        self.writer = writer
        self.operator = operator
        self.history = history
        self.columns: Mapping[str, int] = {name: index for index, name in enumerate(rig.layout.columns)}
        self.newest: Row | None = None
        self.read_at: dict[str, float] = {}  #: s, time of each device's newest reading
        self.absent: dict[str, float] = {}  #: lost devices that the run goes on without, and since when, s
        self.rate = rig.monitor_rate
        self.needed_rate = 0.0  #: lowest sampling rate that the step in progress needs, Hz
        self.record_began = -math.inf  #: s, when the newest record was opened
        self.path = ""  #: of the step in progress
        self.commanded: dict[str, float] = {}
        self.pulses: dict[str, Pulse] = {}
        self.values: dict[str, float] = {}  #: measures and operators' answers, by name
        self._sent: dict[str, tuple[PendingCommand, float | None]] = {}  # unanswered
        self.doubtful: dict[str, float] = {}  #: commands without an answer, which may have been carried out
        self.missed: list[str] = []  #: measures that were outside their limits while the procedure continued
        self.question: Question | None = None
        self.reachable = True
        self._unseen_since: datetime | None = None  # last contact, see `OutputsNotSafe`
        self._confirmed: frozenset[str] = frozenset()  # outputs that are safe though the bench is not
        self.trouble: RigctlError | None = None  #: the first event that could not be written
        self._types: dict[str, ValueType] = dict(rig.layout.types())
        self._switches: dict[str, float] = {}  # s, when each actuator was last switched, at the latest
        self._known: dict[str, float] = {}  # s, time of the newest receipt of each actuator
        self.regulated: set[str] = set()  #: actuators that the step in progress commands repeatedly itself
        self._loops: set[str] = set()  # outputs that the bench itself commands in a closed loop
        self._changed = -1.0  # s, when a command was last given
        self._driven: dict[str, float] = {}  # outputs that have been driven, and their last such value
        # the values at which nothing driven by a directional valve can move
        self._resting = {
            name: self.safe_value(name)
            for name, actuator in rig.actuators.items()
            if actuator.kind == "directional_valve" and actuator.by == "driven"
        }

    @property
    def now(self) -> float:
        """Bench time, s."""
        return self.backend.clock.now()

    def record_of(self, time: float) -> int:
        """The record that a sample belongs to; -1 for one that was taken before the open record began."""
        return self.writer.record if time >= self.record_began else -1

    @property
    def recording(self) -> bool:
        """True while a record is open."""
        return self.writer.record >= 0

    def event(self, kind: str, message: str, **fields: Any) -> None:
        """Log an event at the current time and step; see `log`."""
        self.log(self.now, kind, path=self.path, message=message, **fields)

    def log(self, time: float, kind: str, **fields: Any) -> None:
        """Log an event. Never raises: making outputs safe must not fail because of a full disk.

        The failure is kept, and ends the run at the next sample.
        """
        try:
            self.writer.event(time, kind, **fields)
        except RigctlError as error:
            self.trouble = self.trouble or error

    def start(self, rate: float) -> None:
        """Sample at `rate` Hz from now on."""
        self.backend.start(rate)
        self.rate = rate

    @property
    def watching_rate(self) -> float:
        """Sampling rate between records, Hz: higher while something may be moving.

        At 10 Hz a rod travels 15 mm between two samples, further than from its limit to its end stop.
        """
        known = {**self.commanded, **self.doubtful}
        # A command without an answer counts as carried out: a valve that may be open is watched as an open
        # one.
        moving = any(known.get(name, rest) != rest for name, rest in self._resting.items())
        rate = max(self.rig.monitor_rate, self.rig.moving_rate) if moving else self.rig.monitor_rate
        return max(rate, self.needed_rate)

    def need_rate(self, rate: float) -> None:
        """Between records, sample at no less than `rate` Hz from now on; 0: the rig file's rate.

        Raises
        ------
        RigctlError
            the bench cannot be read so often; nothing has changed.
        """
        # The need is kept while the bench is out of reach: `make_safe` applies it once it is back.
        before, self.needed_rate = self.needed_rate, rate
        if not self.reachable:
            return
        try:
            self._keep_watch()
        except RigctlError:
            self.needed_rate = before
            raise

    def _keep_watch(self) -> None:
        """Between records, read as often as the present commands require."""
        rate = self.watching_rate
        if not self.recording and rate != self.rate:
            self.start(rate)

    # --- reading -----------------------------------------------------------------------------------------

    def fresh(self, names: Collection[str] = ()) -> Generator[Until, Row | None, Row]:
        """The newest row, or the next one if a command has been given since: the present state of the
        bench. Nothing is decided without a value: it waits until all channels among `names` have one, and
        until their devices, or all, have been read since the command."""
        present = self._known_in(names)
        devices = {self.rig.device_of(name) for name in names} & self.rig.devices.keys()
        awaited = (devices or self.rig.devices.keys()) if self.rig.devices else ()

        def known(row: Row) -> bool:
            return present(row) and all(
                self.read_at.get(one, -1.0) >= self._changed for one in awaited if one not in self.absent
            )

        # The age of a row counts from the last command on: one that was taken earlier shows the bench as it
        # was.
        row = self.newest if self.newest is not None and self.newest[0] >= self._changed else None
        while row is None or not known(row):
            row = yield Until(when=known, on_pause=OnPause.KEEP)
        return row

    def read_with(self, row: Row, channel: str) -> Row:
        """The newest row with the time of its reading of a channel: rows of other devices repeat it."""
        device = self.rig.device_of(channel)
        return (self.read_at.get(device, row[0]), *row[1:]) if device else row

    def rate_of(self, channel: str) -> float:
        """How often a channel is read, Hz."""
        device = self.rig.device_of(channel)
        return self.rig.rate_of(device, self.rate) if device else self.rate

    def condition(self, expression: Expression) -> Callable[[Row], object]:
        """A condition over channels, commands, measures and answers as a function of a row; it does not hold
        where one of its channels has no value."""
        known = self._known_in(expression.names)
        kept = tuple(sorted(expression.names & self.values.keys()))
        compiled = expression.compile(self._types, (*self.rig.layout.columns, *kept))
        constants = tuple(self.values[name] for name in kept)
        return lambda row: compiled((*row, *constants)) and known(row)

    def _known_in(self, names: Collection[str]) -> Callable[[Row], bool]:
        """Whether all channels among `names` have a value, as a function of a row."""
        columns = tuple(self.columns[name] for name in names if name in self.rig.channels)
        return lambda row: not any(math.isnan(row[column]) for column in columns)

    def keep(self, name: str, value: float, unit: str, *, difference: bool = False) -> None:
        """Make a value available by name to later conditions and measures."""
        self.values[name] = value
        self._types[name] = type_of_unit(unit, difference=difference)

    def record_measure(self, value: MeasuredValue) -> None:
        """Keep a measured or answered value for later steps, with the open record or else with the run."""
        self.keep(value.name, value.value, value.unit, difference=value.difference)
        self.writer.measure(replace(value, path=self.path))

    def statistics(
        self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None
    ) -> Mapping[str, float]:
        """Statistics by key, the stretch's ``duration``, and every value kept so far."""
        return {**self.values, **self.history.statistics(wanted, stretch, window, self.now)}

    def lack(self, wanted: Sequence[Statistic], stretch: Stretch, window: float | None) -> Lack:
        """How many readings without a value the statistics leave out, of the worst channel."""
        return self.history.lack(wanted, stretch, window, self.now)

    # --- commanding --------------------------------------------------------------------------------------

    def safe_value(self, actuator: str) -> float:
        """The value an actuator rests at."""
        return float(self.rig.safe_state.get(actuator, 0.0))

    def command(
        self, actuator: str, value: float, duration: float | None = None
    ) -> Generator[Until, Row | None, CommandReceipt]:
        """Switch an actuator as soon as that is allowed, for `duration` s if given, and log when that was.

        Until it has rested for its `min_interval`, and while the bench cannot be reached, sampling,
        interlocks and endings continue. What a loss of contact means for the run is decided before this
        method continues.
        """
        while True:
            # Anew in each round: if outputs were made safe while contact was lost, the rest of the actuator
            # began anew.
            ready = self.rested_at(actuator, value)
            while self.now < ready:
                yield Until(ready)
            # One command at a time to each actuator: `_sent` has one entry for it.
            yield from self.settled(actuator)
            with suppress(OutOfReach):
                sent = self.send(actuator, value, duration)
                yield from self.settled(actuator)
                if sent.receipt is not None:
                    return sent.receipt
            # Out of reach, or not answered. The next sample is the sign that contact is there again; before
            # it arrives here, `Sampling` has decided what the loss means for the run, and may end this wait.
            yield Until(when=every_sample)

    def send(self, actuator: str, value: float, duration: float | None = None) -> PendingCommand:
        """Send a command now, for steps that cannot wait; its acknowledgement arrives with the samples.

        A bench that cannot time a pulse itself is switched back by `finish_pulse`. A command whose
        acknowledgement is missing or unexpected may have been carried out: see `unconfirmed`.

        Raises
        ------
        OutOfReach
            contact is lost for the moment.
        """
        timed = duration is not None and self.backend.timed
        # Marked as doubtful before it is sent: if the call fails half-way, the command may still have
        # arrived.
        if value != self.safe_value(actuator):
            self.doubtful[actuator] = value  # until it is answered, however the call ends
        try:
            sent = self.backend.command(actuator, value, duration=duration if timed else None)
        except OutOfReach as error:
            self.event("note", f"{actuator} could not be commanded: {error}")
            raise
        self._sent[actuator] = (sent, duration)
        self.take_receipts()  # earlier events of the bench come first
        # A backend in memory has answered already.
        self.take_answers()
        self._keep_watch()
        return sent

    def take_answers(self) -> None:
        """Process the acknowledgements of commands since the last call.

        Raises
        ------
        RigctlError
            the bench has refused one.
        """
        for actuator, (sent, duration) in [entry for entry in self._sent.items() if entry[1][0].settled]:
            del self._sent[actuator]
            if sent.receipt is not None:
                self._carried_out(sent.receipt, duration)
            elif isinstance(sent.trouble, OutOfReach):
                self.event("note", f"{actuator} could not be commanded: {sent.trouble}")
            elif sent.trouble is not None:
                raise sent.trouble

    def _carried_out(self, receipt: CommandReceipt, duration: float | None) -> None:
        """Handle the bench's confirmation of a command."""
        actuator = receipt.actuator
        self.doubtful.pop(actuator, None)
        self.pulses.pop(actuator, None)
        # The bench may have reported the end of a short pulse before the receipt of its beginning.
        if duration is not None and receipt.time >= self._known.get(actuator, -math.inf):  # not over yet
            self.pulses[actuator] = Pulse(receipt.time + duration, receipt.value)
        self._switched(receipt)
        self._keep_watch()

    def settled(self, actuator: str | None = None) -> Waiting:
        """Wait until every command, or that to one actuator, is acknowledged; a pause waits for it too."""

        def answered() -> bool:
            return actuator not in self._sent if actuator is not None else not self._sent

        while not answered():
            yield Until(done=answered, on_pause=OnPause.DEFER)

    def try_switch(self, actuator: str, value: float) -> bool:
        """Send a command now; False when contact is lost for the moment, which `send` logs."""
        try:
            self.send(actuator, value)
        except OutOfReach:
            return False
        return True

    def release(self, actuator: str) -> None:
        """Return an actuator to its safe value now; an unreachable bench is made safe when it is back."""
        if self.reachable and not self.is_at(actuator, self.safe_value(actuator)):
            self.try_switch(actuator, self.safe_value(actuator))

    def is_at(self, actuator: str, value: float) -> bool:
        """Whether an actuator's newest command was `value`, with its acknowledgement received or pending."""
        if actuator in self._sent:
            return self._sent[actuator][0].value == value
        return self.commanded.get(actuator) == value and actuator not in self.doubtful

    def rested_at(self, actuator: str, value: float) -> float:
        """Earliest time at which an actuator with a minimum rest between switches may be switched to `value`,
        s.

        It may return to its safe value at any time.
        """
        rest = self.rig.actuators[actuator].min_interval
        if rest <= 0.0 or value in (self.safe_value(actuator), self.commanded.get(actuator)):
            return -math.inf
        return self._switches.get(actuator, -math.inf) + rest

    def finish_pulse(self, actuator: str) -> Waiting:
        """Wait until a timed command is over; the host ends it if the bench cannot."""
        pulse = self.pulses.get(actuator)
        if pulse is None:
            return
        if not self.backend.timed:
            self.release(actuator)
            self.pulses.pop(actuator, None)
            yield from self.settled(actuator)
            return
        # A bench that times its pulses reports the end by a receipt (`take_receipts`). If that does not come,
        # the host switches back: a lost report must not leave the output on, or the step waiting.
        give_up = pulse.end + self.rig.stale_after
        while actuator in self.pulses:
            if self.now >= give_up:
                self.event("note", f"{actuator}: the bench did not report the end of its pulse")
                self.release(actuator)
                self.pulses.pop(actuator, None)
                yield from self.settled(actuator)
                return
            yield Until(give_up, lambda _: actuator not in self.pulses)

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Why the bench itself cannot carry out a closed loop; empty if it can."""
        if not isinstance(self.backend, Regulator):
            return (
                f"a bench of the kind '{self.backend.identity.get('kind', '')}' has no controller of its own"
            )
        return self.backend.cannot_regulate(loop)

    def regulate(self, loop: LoopSettings) -> Waiting:
        """Let the bench itself start a closed loop, and wait for its confirmation."""
        yield from self.settled(loop.actuator)
        # From here on the output changes without commands: it is in doubt by its highest value, and stays
        # among `_loops` until its end was confirmed, so that even a confirmed safe value proves nothing about
        # it.
        self.doubtful[loop.actuator] = loop.high  # until it is answered, however the call ends
        self._loops.add(loop.actuator)
        yield from self._request(loop.actuator, lambda bench: bench.regulate(loop))

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """The state of the loop that the bench carries out; `ahead` is its feed-forward from now on."""
        return (
            self.backend.loop_state(ahead) if isinstance(self.backend, Regulator) else LoopState(False, None)
        )

    def stop_regulating(self, actuator: str) -> Waiting:
        """End such a loop, leaving its output unchanged, and wait for the bench's confirmation and its
        timing."""
        yield from self.settled(actuator)
        self.doubtful[actuator] = self.commanded.get(actuator, self.safe_value(actuator))  # until answered
        yield from self._request(actuator, lambda bench: bench.stop_regulating(actuator))
        # Only a confirmed end: otherwise the loop may still be driving its output.
        if self.reachable and actuator not in self.doubtful:
            self._loops.discard(actuator)

    def _request(self, actuator: str, ask: Callable[[Regulator], PendingCommand]) -> Waiting:
        """Send a request to the bench's controller and wait for the answer; a loss of contact is logged."""
        if not isinstance(self.backend, Regulator):
            raise RuntimeError("a bench without a controller was asked for a loop")
        try:
            self._sent[actuator] = (ask(self.backend), None)
        except OutOfReach as error:
            self.event("note", f"{actuator} could not be commanded: {error}")
            return
        yield from self.settled(actuator)

    def take_receipts(self) -> None:
        """Log the switches that the bench made on its own."""
        for receipt in self.backend.take_receipts():
            self.pulses.pop(receipt.actuator, None)
            self._switched(receipt)
            self._keep_watch()

    def make_safe(self, reason: str) -> None:
        """Bring every driven output to the safe state; never raises: `reachable` shows whether it worked.

        Commands that did not arrive are not logged as given.
        """
        # First, whatever comes: nothing may switch an output back to a pulse's value, or wait for its end.
        self.pulses.clear()
        try:
            self.backend.safe()
        except Exception as error:  # noqa: BLE001 - whatever it is, an ending continues
            # What is known now is only what this attempt has found out; an earlier one may be out of date.
            self._confirmed = frozenset()
            if isinstance(error, OutputsNotSafe):  # also outputs whose last command was the safe value
                self.doubtful |= error.outputs
                self._unseen_since = error.unseen_since
                self._confirmed = error.confirmed
                if error.confirmed:
                    self._note_safe(error.confirmed, reason)
            # Said once for each loss: `make_safe` is called again and again while the bench is looked for.
            if self.reachable:
                self.event("fault", f"outputs could not be made safe from here: {error}")
            self.reachable = False
            return
        if not self.reachable:
            self.event("note", "the bench can be reached again, outputs are safe")
        self.reachable, self._unseen_since = True, None
        self.doubtful.clear()
        self._loops.clear()
        # The backend drops what is open before it sends the safe commands, so that none can arrive after
        # them.
        self._sent.clear()  # pending commands are dropped, or have been carried out
        self._note_safe(self.rig.safe_state, reason)
        # The safe state is reached already; a rate that cannot be changed is no reason to report otherwise.
        try:
            self._keep_watch()
        except RigctlError as error:
            self.event("fault", f"the bench could not be asked for fewer samples: {error}")

    def _note_safe(self, names: Collection[str], reason: str) -> None:
        """Log which driven outputs the bench has just made safe."""
        for name in names:
            self.doubtful.pop(name, None)
            self._loops.discard(name)
            self._sent.pop(name, None)
        # Switches that the bench has reported itself have their exact times; only those that it has not are
        # logged here with the present time.
        self.take_receipts()
        for actuator, value in self.rig.safe_state.items():
            changed = self.commanded.get(actuator) != float(value)
            if changed and actuator in names and self.rig.actuators[actuator].by == "driven":
                time = self.now
                self._switched(CommandReceipt(time, actuator, float(value)), message=reason)

    @property
    def driven(self) -> set[str]:
        """The driven actuators that are, or may be, commanded off their safe values."""
        return {
            name
            for name, value in {**self.commanded, **self.doubtful}.items()
            if self.rig.actuators[name].by == "driven" and value != self.safe_value(name)
        }

    @property
    def switched_on(self) -> str:
        """The outputs of `driven` with their values, e.g. ``heater on, pump 60 %``."""
        values = {**self.commanded, **self.doubtful}
        return self._shown({name: values[name] for name in sorted(self.driven)}) or ""

    @property
    def unconfirmed(self) -> str | None:
        """The outputs that may not be safe now, e.g. ``heater_1 60 %``; None if all are confirmed to be safe.

        An output whose safe state was confirmed at the last contact is still safe, as nothing has been
        commanded since, unless the bench itself commands it in a closed loop, or its device may have switched
        it on by restarting. Such outputs are named if no other of their device is in doubt.
        """
        # The last attempt to make outputs safe, if there was any, has succeeded.
        if self.reachable:
            return None
        # Two lists: what is or may be on, and what only a restart out of sight may have switched on. The
        # latter is named only for devices of which nothing is in the former, as somebody has to go to those
        # anyway.
        doubts = self._doubts
        devices = {self.rig.device_of(name) for name in doubts}
        others = ", ".join(
            self._with_device(name)
            for name in self.rig.safe_state
            if self.rig.actuators[name].by == "driven"
            and name not in self._confirmed
            and self.rig.device_of(name) not in devices
        )
        if self._unseen_since is None or not others:
            return self._shown(doubts)
        seen = f"{self._unseen_since.astimezone():%H:%M:%S}"
        others += f" (safe when last seen at {seen}; a restart may have switched them on)"
        return ", ".join(filter(None, (self._shown(doubts), others)))

    @property
    def _doubts(self) -> dict[str, float]:
        """The outputs of a bench out of reach that may be driven, with their values."""
        if self.reachable:
            return {}
        return {
            name: value
            for name, value in {**self.commanded, **self.doubtful}.items()
            if self.rig.actuators[name].by == "driven"
            and (value != self.safe_value(name) or name in self._loops)
        }

    @property
    def never_confirmed(self) -> str | None:
        """The outputs driven by this run whose safe state nothing can confirm, as in `unconfirmed`: the bench
        neither reports them nor answers their commands."""
        # `outputs_read`: its state is in the samples. `outputs_answered`: its commands are acknowledged.
        known = self.backend.outputs_read | self.backend.outputs_answered
        doubted = self._doubts.keys()  # named by `unconfirmed`
        return self._shown(
            {name: value for name, value in self._driven.items() if name not in known | doubted}
        )

    @property
    def safe_on_trust(self) -> str | None:
        """The outputs that are on in the safe state, which nothing confirms, and which this run has driven to
        no other value.
        """
        known = self.backend.outputs_read | self.backend.outputs_answered
        return self._shown(
            {
                name: value
                for name, value in self.rig.safe_state.items()
                if self.rig.actuators[name].by == "driven" and value and name not in {*known, *self._driven}
            }
        )

    def _shown(self, outputs: Mapping[str, float]) -> str | None:
        shown = (
            f"{self._with_device(name)} {self.rig.actuators[name].show(value)}"
            for name, value in outputs.items()
        )
        return ", ".join(shown) or None

    def _with_device(self, name: str) -> str:
        """The name of an output, after that of its device where there are several."""
        device = self.rig.device_of(name)
        return f"{device}: {name}" if device else name

    def restorable_at(self, commands: Mapping[str, float]) -> float:
        """When every actuator has rested long enough for `restored`, s."""
        return max(
            (self.rested_at(actuator, value) for actuator, value in commands.items()), default=-math.inf
        )

    def restored(self, commands: Mapping[str, float]) -> Waiting:
        """Give driven actuators these values once they have rested, and wait until they have them."""
        while self.now < (ready := self.restorable_at(commands)):
            yield Until(ready)
        actuators = self.rig.actuators
        driven = {name: value for name, value in commands.items() if actuators[name].by == "driven"}
        # Outputs with a `max_rate` must not jump: they approach their values once the others have theirs.
        gradual = {name: value for name, value in driven.items() if actuators[name].max_rate is not None}
        at_once = {name: value for name, value in driven.items() if name not in gradual}
        with suppress(OutOfReach):
            for name, value in at_once.items():
                if not self.is_at(name, value):
                    self.send(name, value)
        yield from self.settled()
        # one that could not be reached for the moment is commanded until it has answered
        for name, value in at_once.items():
            if not self.is_at(name, value):
                yield from self.command(name, value)
        yield from approach(self, gradual)

    @property
    def timing(self) -> bool:
        """Whether an output has been commanded for a time that is not over."""
        return bool(self.pulses) or any(duration is not None for _, duration in self._sent.values())

    def _switched(self, receipt: CommandReceipt, message: str = "") -> None:
        """Log a switch; one older than the known state does not change it."""
        name, latest = receipt.actuator, receipt.time + receipt.uncertainty
        # Receipts may arrive out of order: the end of a pulse before its beginning, or an answer after a
        # switch that the bench has made on its own.
        if latest >= self._known.get(name, -math.inf):
            # A repeated command of the same value wears nothing, and starts no new rest.
            if self.commanded.get(name) != receipt.value:
                self._switches[name] = latest
            self.commanded[name] = receipt.value
            if self.rig.actuators[name].by == "driven" and receipt.value != self.safe_value(name):
                self._driven[name] = receipt.value
            self._known[name] = receipt.time
            self.history.begin_phase(receipt.time)
        self._changed = max(self._changed, receipt.time)
        self.log(
            receipt.time,
            "command",
            actuator=receipt.actuator,
            value=receipt.value,
            uncertainty=receipt.uncertainty,
            path=self.path,
            message=message,
        )

    # --- questions to the operator -----------------------------------------------------------------------

    def ask(self, question: Question) -> Generator[Until, Row | None, Answer]:
        """Ask the operator and wait for the answer; sampling and interlocks continue meanwhile.

        Raises
        ------
        StepFailed
            the operator is gone, and outputs have been on for as long as the rig file allows then.
        """
        # Shown once; then the operator is asked again and again, since neither may block.
        self.request(question)
        attendance = Attendance(self)
        try:
            while True:
                answer = self.operator.ask(question)
                if answer is not None:
                    self.event("operator", f"{question.text}: {answer.text}", by=self.operator.name)
                    return answer
                attendance.check(f"'{question.text}' was not answered")
                yield Until(self.now + _ASK_AGAIN)
        finally:
            self.withdraw()

    def request(self, question: Question) -> None:
        """Show the operator a request, without waiting."""
        self.question = question
        self.event("operator", question.text, by="rigctl")
        if question.notice:
            self.operator.ask(question)

    def withdraw(self) -> None:
        """Withdraw a request that is no longer needed."""
        if self.question is not None:
            self.operator.withdraw(self.question)
        self.question = None
