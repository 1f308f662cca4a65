"""Takes samples: journal, interlocks, notices of the bench, and the handling of silence and of lost devices.

In: samples, notices and receipts of the backend. Out: the row of each sample, for the step that waits
(`next_row`); or an ending, whose outputs are already safe when it is raised. Every sample of a run passes
through here once, whatever the run is doing, and in one order: it is journalled, then checked, and only then
shown to a step. A row that trips a limit is thus stored, and no step acts on it.

A loss has one of four consequences, from the mildest to the hardest: a device that the rig file allows to
be absent is noted (`_go_without`); the run pauses until the device is back (`_pause_for`); the record in
progress is repeated once the bench is back (`_Awaited` without `paused`); or the run ends. See
docs/decisions/0195-what-the-loss-of-a-device-does.md.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Notice, Reading, Sample
from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Row
from rigctl.plan.outcomes import DeviceBack, Ending, Lost, SamplesLost, Tripped
from rigctl.rig.possible_readings import PossibleReadings
from rigctl.runner.bench import Bench
from rigctl.runner.completeness import Completeness
from rigctl.runner.interlocks import Alarm, Interlocks
from rigctl.runner.snapshot import ShownEvent
from rigctl.units import show

#: s of bench time that a repeatable record waits for a lost bench to come back
RECONNECT = 30.0


@dataclass(frozen=True)
class _Awaited:
    """A lost bench that is being waited for.

    Parameters
    ----------
    reason: why it counts as lost.
    give_up: bench time until which it is waited for, s; `within` is for how long.
    paused: the run is paused meanwhile, because the rig file says so of the device; otherwise its record will
        be measured again.
    cut: outside a record, a command for a time was cut off, half of which cannot be repeated.
    devices: those for which the run is paused.
    """

    reason: str
    give_up: float
    within: float
    paused: bool = False
    cut: bool = False
    devices: tuple[str, ...] = ()

    @property
    def given_up(self) -> Lost:
        """The ending if it does not come back."""
        return Lost(f"{self.reason}; it did not come back within {self.within:g} s")


@dataclass(frozen=True)
class RunWarning:
    """A warning of the bench: its bench time, s, and the record; −1 between records."""

    time: float
    record: int
    message: str


class Sampling:
    """All samples of a run pass through here, whatever the run is doing.

    Parameters
    ----------
    secure: brings outputs to the safe state because of an ending, once for each ending.
    """

    def __init__(self, bench: Bench, interlocks: Interlocks, secure: Callable[[Ending], None]) -> None:
        self._bench = bench
        self._backend = bench.backend
        self._next_sample = bench.backend.next_sample
        self._interlocks = interlocks
        self._secure = secure
        self.newest = self._began = bench.now  #: s, time of the newest sample
        self._awaited: _Awaited | None = None  # a lost bench whose record will be measured again
        self._reported = False  # whether it was reported that data cannot be stored
        self._faults: dict[str, str] = {}  # faults reported by each device since its newest reading
        self._several = bool(bench.rig.devices)
        self._possible = PossibleReadings(bench.rig)
        self.completeness: Completeness | None = None  #: of the open record
        self._counters = {
            name: bench.columns[name] for name, one in bench.rig.channels.items() if one.counts_up
        }
        self._counts: dict[str, float] = {}  # newest value of each
        self.repeatable = False  #: the open record will be measured again if samples are lost
        self.running = False  #: steps are in progress, so that the loss of a device need not end the run
        self.alarms: dict[str, Alarm] = {}  #: latched, by name
        self.happenings: deque[ShownEvent] = deque(maxlen=12)
        self.warnings: list[RunWarning] = []  #: that a simulated bench left the range of an effect's law

    @property
    def longest_silence(self) -> float:
        """Longest allowed time without a sample at the present rate, s."""
        return self._interlocks.silence_limit(1.0 / self._bench.rate)

    @property
    def awaiting(self) -> bool:
        """True while no step may continue, because the bench is lost and its record will be repeated."""
        return self._awaited is not None

    @property
    def pausing(self) -> bool:
        """True if the run is paused meanwhile."""
        return self._awaited is not None and self._awaited.paused

    def next_row(self, timeout: float) -> Row | None:
        """The row of the next sample, journalled and checked; None if none came within `timeout` s.

        Raises
        ------
        Tripped, SamplesLost, Lost
            outputs are safe then.
        """
        try:
            sample = self._next_sample(timeout)
            if sample is None and self._bench.now - self.newest >= self.longest_silence:
                # after a suspension of this computer, buffered samples are read first: that is not silence
                sample = self._next_sample(0.0)
        except BackendLost as error:
            self._end(Lost(str(error)))
        # Nothing is handed to a step while a loss is waited for: first whether all are back, then whether to
        # give up.
        awaited = self._awaited
        if sample is None:
            self._collect()
        if awaited is not None and (sample is None or not self._all_back(sample, awaited)):
            if self._bench.now >= awaited.give_up:
                self._end(awaited.given_up)
            if self._several:  # of another device; what is still to be fetched is not missing
                self._check_silence(self._bench.now if sample is None else sample.time)
            return None
        if sample is None:
            return None
        # All are back, and safe. The sample is journalled and checked before it is decided how the run goes
        # on, since a limit may have been exceeded meanwhile.
        if awaited is not None:
            self._bench.reachable = True
            self._awaited = None
            self._take(sample)
            self._go_on(awaited)
            return None
        # Taking it may have shown that a device was lost, see `_gap`: then no step gets it.
        row = self._take(sample)
        return None if self.awaiting else row

    def _go_on(self, awaited: _Awaited) -> None:
        """A bench that was waited for is back: its record, or the step in progress, is done again."""
        # Not paused: the record is measured again, which `Walker._repeated` catches.
        if not awaited.paused:
            self._end(SamplesLost(awaited.reason))
        for device in awaited.devices:
            self._bench.event("note", f"{device} is back, outputs are safe: the run goes on", back=device)
        if self._bench.recording:
            self._end(DeviceBack(awaited.reason))
        # Outside a record the step in progress begins again, unless half of a timed command has been carried
        # out.
        if awaited.cut:
            self._end(Lost(f"{awaited.reason}; it is back, but a command for a time was cut off by it"))

    def check_silence(self) -> None:
        """Trip if no sample has come for too long, or none of one of several devices."""
        self._check_silence(self._bench.now)

    def _check_silence(self, now: float) -> None:
        bench = self._bench
        device = ""
        if not self._several:
            alarm = self._interlocks.check_silence(bench.now, self.newest, 1.0 / bench.rate)
        else:
            device, alarm = self._interlocks.check_devices(now, self._began, bench.rate)
        if alarm is None:
            return
        # What the bench last said of the device is the likely cause, and more use than the time of its
        # silence.
        if device in self._faults:
            fault = self._faults[device].removeprefix(f"{device}: ")
            alarm = replace(alarm, message=f"{alarm.message}: {fault}")
        # What the rig file says of the device comes before the procedure's `retries`, which ask for no pause.
        policy = self._policy(device)
        if policy == "continue":
            self._go_without(device, alarm.message)
        elif policy == "pause":
            self._pause_for(device, alarm.message)
        elif self.repeatable:
            self._bench.event("gap", alarm.message)
            self._bench.make_safe(alarm.message)
            self._awaited = _Awaited(alarm.message, self._bench.now + RECONNECT, RECONNECT)
        else:
            self.stop_waiting()
            self._sound([alarm])

    def stop_waiting(self) -> None:
        """Wait for no lost bench any longer: it is back, or the run ends."""
        self._awaited = None

    def _policy(self, device: str) -> str:
        """What the loss of a device does now."""
        known = self._bench.rig.devices.get(device)
        if known is None or not self.running:
            return "stop"
        if known.lost == "pause" and self._bench.writer.folder is None:
            return "stop"  # outputs are commanded by hand: none may be switched on again by itself
        return known.lost

    def _go_without(self, device: str, reason: str) -> None:
        """Note that the run goes on without a device, on which nothing depends."""
        bench, message = self._bench, f"{reason}; the run goes on without it"
        if device in bench.absent:
            return
        bench.event("gap", message, device=device, lost="continue")
        self.note(bench.now, "gap", message)
        self.warnings.append(RunWarning(bench.now, bench.record_of(bench.now), message))
        bench.absent[device] = bench.now

    def _pause_for(self, device: str, reason: str) -> None:
        """Make outputs safe at once, and wait for a device."""
        bench = self._bench
        within = bench.rig.devices[device].back_within
        bench.event(
            "gap", f"{reason}; the run waits for it, {within:g} s at most", device=device, lost="pause"
        )
        self.note(bench.now, "gap", reason)
        # Before `make_safe`, which forgets the pulses in progress.
        cut, before = bench.timing, self._awaited
        bench.make_safe(reason)
        give_up = bench.now + within
        devices: tuple[str, ...] = (device,)
        # Two losses become one wait, until all of these devices are back. The time for a device that comes
        # and goes is not extended: it would be waited for without end.
        if before is not None:  # of this one if it is lost again before it could be made safe
            cut = cut or before.cut
            again = device in before.devices
            devices = before.devices if again else (*before.devices, device)
            give_up = before.give_up if again else max(before.give_up, give_up)
        self._awaited = _Awaited(reason, give_up, within, paused=True, cut=cut, devices=devices)

    def keep(self, sample: Sample) -> None:
        """Journal a sample of a run that has ended: it is kept, but has no consequences."""
        bench = self._bench
        try:
            bench.writer.append(self._row(sample.read))
        except RigctlError as error:
            bench.trouble = bench.trouble or error

    def note(self, time: float, kind: str, message: str) -> None:
        """Keep an event for observers of the run."""
        self.happenings.append(ShownEvent(time, kind, message))

    def _row(self, sample: Sample | Reading) -> Row:
        return (sample.time, self._bench.record_of(sample.time), *sample.values, *sample.commands)

    def _all_back(self, sample: Sample, awaited: _Awaited) -> bool:
        """Whether all of several devices are there again; otherwise the sample of another one is kept."""
        bench = self._bench
        # This is the last of those missed. After a pause all outputs of all devices are confirmed to be safe
        # once more: another device may have been restarted by the same dip of the supply.
        if self._interlocks.silent_devices - bench.absent.keys() <= {sample.device}:
            if not awaited.paused:
                return True
            self._collect()  # what was switched off meanwhile has been waited for
            bench.make_safe(f"the lost device is back: {awaited.reason}")
            if bench.reachable:
                return True
        # Another device is still missing, or the safe state was not confirmed: the sample is stored, and its
        # limits count, but no step and no record of completeness sees it.
        self.keep(sample)
        if awaited.paused:  # observers see the others meanwhile
            bench.newest = self._possible.of(self._row(sample))
            bench.read_at[sample.device] = sample.read.time
        self._returned(sample.device)
        self._faults.pop(sample.device, None)
        alarms = self._interlocks.check(self._row(sample.read), sample.device)
        # Before `_sound`, which raises.
        if any(alarm.active and alarm.action == "stop" for alarm in alarms):
            self._awaited = None  # this ends the run, not only the record
        if alarms:
            self._sound(alarms)
        self._collect()
        return False

    def _take(self, sample: Sample) -> Row:
        bench, device = self._bench, sample.device
        # Three views of one sample: `read` is what the device said, which is stored and checked against
        # limits; `taken` is that without impossible values; `newest` also has the latest value of every other
        # device's channels.
        read = self._row(sample.read)
        # what is impossible is stored as it was read, and is no value here
        taken = self._possible.of(read, device)
        bench.newest = taken if not device else self._possible.of(self._row(sample))
        bench.read_at[device] = read[0]
        self.newest = sample.time
        self._faults.pop(device, None)
        self._returned(device)
        # Stored first: a row that trips a limit is the one that everybody will want to see.
        self._keep(read)
        # Rows from before the record have the number −1; they arrive after it was opened.
        if self.completeness is not None and taken[1] >= 0.0:
            self.completeness.add(taken, device, possible=taken is read)
        if bench.history.wanted:
            bench.history.add(taken, device)
        alarms = self._interlocks.check(read, device)
        if alarms:
            self._sound(alarms)
        self._collect()
        # At the time of this sample, not at the present: after a stall, those of other devices may still be
        # queued.
        if self._several:
            self._check_silence(sample.time)  # what is still to be fetched is not missing
        # Last, as a restart may end the record, and the sample that shows it has to be stored and checked all
        # the same.
        for name, column in self._counters.items():
            self._count(name, bench.newest[column])
        return bench.newest

    def _returned(self, device: str) -> None:
        """Note that a device is back without which the run went on."""
        since = self._bench.absent.pop(device, None)
        if since is not None:
            message = f"{device} is back after {self._bench.now - since:.3g} s"
            self._bench.event("note", message, back=device)
            self.note(self._bench.now, "note", message)

    def _count(self, name: str, value: float) -> None:
        """Compare a device's clock or counter with its last value: one that starts again is a restart."""
        before = self._counts.get(name, -math.inf)
        if math.isnan(value):
            return
        # Kept before the comparison: the same restart is not reported twice.
        self._counts[name] = value
        if value >= before:
            return
        bench, channel = self._bench, self._bench.rig.channels[name]
        shown = " to ".join(show(one, channel.unit) for one in (before, value))
        message = f"the device has restarted: {name} went from {shown}"
        device = bench.rig.device_of(name)
        switched_off = sorted(one for one in bench.driven if bench.rig.device_of(one) == device)
        bench.event("gap", message, switched_off=switched_off)
        fields = {"switched_off": switched_off, "device": device, "restarted": True}
        self._gap(Notice(bench.now, "gap", message, fields))

    def _keep(self, row: Row) -> None:
        """Journal a row; a disk that is full or gone ends the run, once."""
        bench = self._bench
        try:
            bench.writer.append(row)
        except RigctlError as error:
            bench.trouble = bench.trouble or error
        # `trouble` may also come from an event that could not be logged: those never raise where they are
        # logged, as this might be within `make_safe`. It ends the run here, at the next sample, once; cleanup
        # still gets its rows.
        if bench.trouble is not None and not self._reported:
            self._reported = True
            self._end(Lost(str(bench.trouble)))

    def _collect(self) -> None:
        """Handle switches and notices that the bench reports on its own."""
        # Receipts before notices: `_pause_for` asks whether a timed command is in progress, which a receipt
        # may end.
        self._bench.take_receipts()
        self._bench.take_answers()
        for notice in self._backend.take_notices():
            self._bench.log(notice.time, notice.kind, message=notice.message, **notice.fields)
            self.note(notice.time, notice.kind, notice.message)
            if "warning" in notice.fields:
                record = self._bench.record_of(notice.time)
                self.warnings.append(RunWarning(notice.time, record, notice.message))
            # Not an ending by itself: a fault that lasts shows as silence or as missing values, whose message
            # it explains.
            if notice.kind == "fault":
                self._faults[str(notice.fields.get("device", ""))] = notice.message
            if notice.kind == "gap":
                self._gap(notice)

    def _gap(self, notice: Notice) -> None:
        """End a record that can be repeated after a gap, and any step whose outputs were switched off in it.

        A step that controls an output commands it again itself; the setting of an earlier step or half a move
        cannot be restored. In a record no output may have differed from its command.
        """
        if self._awaited is not None and (self._awaited.paused or self._interlocks.silent_devices):
            return  # the record is measured again once those are back, too
        device = str(notice.fields.get("device", ""))
        if self._policy(device) == "continue":
            return  # nothing depends on it, also while it comes back
        # Only outputs that were off their safe values when contact was lost.
        names = notice.fields.get("switched_off")
        cut_off = set(names) if isinstance(names, list) else set()
        # A step that regulates an output commands it at its next sample anyway; in a record that gap would be
        # data.
        lasting = cut_off if self._bench.recording else cut_off - self._bench.regulated
        restarted = self._bench.recording and "restarted" in notice.fields
        if (lasting or restarted) and self._policy(device) == "pause":  # it is back, with its outputs off
            self._pause_for(device, notice.message)
        elif self.repeatable:
            self._end(SamplesLost(self._awaited.reason if self._awaited is not None else notice.message))
        elif lasting:
            self._end(Lost(notice.message))

    def _sound(self, alarms: Sequence[Alarm]) -> None:
        """Log alarms; one with action stop makes outputs safe and then ends the step in progress."""
        # Outputs first, then the log, then the ending: writing events takes time, and must not delay the safe
        # state.
        stopping = next((a for a in alarms if a.active and a.action == "stop"), None)
        tripped = Tripped(stopping.message) if stopping is not None else None
        if tripped is not None:
            self._secure(tripped)
        for alarm in alarms:
            text = alarm.message if alarm.active else f"{alarm.name}: over"
            state = "raised" if alarm.active else "cleared"
            self._bench.event("alarm", text, name=alarm.name, action=alarm.action, state=state)
            self.note(alarm.time, "alarm", text)
            if alarm.active:
                self.alarms[alarm.name] = alarm
            else:
                self.alarms.pop(alarm.name, None)
        if tripped is not None:
            raise tripped

    def _end(self, ending: Ending) -> NoReturn:
        # An ending from elsewhere ends the wait for a device too.
        self._awaited = None
        if isinstance(ending, SamplesLost):  # the run continues: a device that is still silent alarms again
            self._interlocks.silent_devices.clear()
        self._secure(ending)
        raise ending
