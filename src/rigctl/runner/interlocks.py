"""Interlocks: limits, impossible values and silence, checked on every sample; no input or output here.

In: the limits of the rig file, and each row as the bench read it. Out: alarms; what they do to a run is up to
`rigctl.runner.sampling`. The rig file's limits become small watches, grouped by device, since a channel is
checked at its own readings only: a value that is repeated between them would look like a sensor that stands
still, and its rate of change would be wrong.

A row inside every band takes about a microsecond, which makes it possible to check every sample:
`_Group.check` compares the row with one band for each column first, and visits the watches only if a
value is outside, or if one of them has something pending.

Every kind of watch exists because another kind does not see the fault: `Watch` (a value, or its rate,
outside a band for long enough), `Disturbance` (far too noisy), `Standstill` (exactly the same value),
`Return` (a tripped limit that cleanup drives further away from), and the silence of the bench or of a
device.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from rigctl.rig import Channel, Limit, Rig
from rigctl.rig.possible_readings import PossibleReadings
from rigctl.runner.persistence import Persistence
from rigctl.units import show

#: a latched alarm can be raised again only after this many seconds without its cause
REARM = 10.0

#: s over each of which the readings have to come nearer to the limit that has stopped the run, on average,
#: while cleanup drives an output on that was on when the limit tripped
_RETURN = 5.0

#: number of samples from which the noise of a channel is judged, and the ratio to the expected noise that is
#: too large
_NOISE_SAMPLES = 32
_NOISE_MASK = (1 << _NOISE_SAMPLES) - 1
_NOISE_FACTOR = 20.0

#: window in which readings without a value add up, in multiples of the time after which a sensor that gives
#: none at all is broken: a fifth of the readings is too many
_SENSOR_WINDOW = 5.0

#: fewest equal readings that count as a standstill
_SAME_READINGS = 5

_SLACK = 1e-9  # s; times on a sampling grid are sums of rounded numbers


@dataclass(frozen=True, slots=True)
class Alarm:
    """An interlock that tripped, or (`active` false) whose cause has been gone for `REARM` seconds."""

    time: float
    name: str
    channel: str
    action: Literal["warn", "stop"]
    message: str
    value: float
    active: bool = True


@dataclass(slots=True)
class Watch:
    """One band for one signal; trips when the signal has been outside for long enough, see `Persistence`.

    Parameters
    ----------
    column: index of the channel in a row.
    low, high: the band, SI, both ends included; of the rate per second when `window` is given.
    window: s over which a rate of change is taken; None for the value itself.
    missing: whether a missing value (NaN) counts as outside; otherwise it changes nothing.
    describe: the message for a value outside.
    limit: what the message of one that was outside without a break adds on how long that may be.
    """

    name: str
    channel: str
    column: int
    low: float
    high: float
    persistence: Persistence
    action: Literal["warn", "stop"]
    describe: Callable[[float], str]
    window: float | None = None
    missing: bool = False
    limit: str = ""
    inside_since: float | None = None
    raised: Alarm | None = None
    excess: float = 0.0  #: exceedance of the newest value outside, SI
    _past: deque[tuple[float, float]] = field(default_factory=deque)

    def outside(self, value: float) -> bool:
        """True if `value` alone would trip it."""
        if self.low <= value <= self.high:
            return False
        return self.missing or not math.isnan(value)

    def reading(self, read: float, possible: float) -> float:
        """What it takes for a reading: nothing for an impossible one, unless that alone would trip it.

        A loose wire that reads -50 degC is no proof that the oil is not too hot; a pressure beyond everything
        that was thought possible is too high all the same.
        """
        return read if self.outside(read) else possible

    @property
    def calm(self) -> bool:
        """True if nothing is pending: a value inside the band needs no further check."""
        return self.raised is None and self.persistence.calm

    def take(self, read: Sequence[float], possible: Sequence[float]) -> Alarm | None:
        """Take the next row, as read and without its impossible readings; returns an alarm if it raises or
        clears one."""
        time, column = read[0], self.column
        if self.window is not None:
            return self._update(time, self._rate(time, possible[column]))
        return self._update(time, self.reading(read[column], possible[column]))

    def _update(self, time: float, value: float) -> Alarm | None:
        if math.isnan(value) and not self.missing:
            return None
        if self.outside(value):
            return self._outside(time, value)
        self.persistence.inside(time)
        return self._inside(time, value)

    def _outside(self, time: float, value: float) -> Alarm | None:
        # A single reading outside begins `REARM` anew, and so does not clear an alarm that comes and goes.
        self.inside_since = None
        self.excess = max(value - self.high, self.low - value)
        persists = self.persistence.outside(time)
        # Latched: it is raised once, and counts as raised until it has been inside for `REARM` s.
        if self.raised is not None or not persists:
            return None
        message = self.describe(value)
        if self.persistence.unbroken(time):
            message += self.limit
        else:
            outside, readings = self.persistence.share
            message += f", as in {outside} of the last {readings} readings"
        self.raised = Alarm(time, self.name, self.channel, self.action, message, value)
        return self.raised

    def _inside(self, time: float, value: float) -> Alarm | None:
        if self.raised is None:
            return None
        if self.inside_since is None:
            self.inside_since = time
        if time - self.inside_since < REARM:
            return None
        cleared = replace(self.raised, time=time, value=value, active=False)
        self.raised = self.inside_since = None
        return cleared

    def _rate(self, time: float, value: float) -> float:
        """Change per second over the window, or since the previous value if the window is shorter than that;
        NaN until half of it has been seen."""
        window = self.window or 0.0
        past = self._past
        if math.isnan(value):
            return math.nan
        past.append((time, value))
        # the previous value stays: a bench that is read more slowly than the window has a rate as well
        while len(past) > 2 and time - past[0][0] > window + _SLACK:
            past.popleft()
        then, old = past[0]
        span = time - then
        return (value - old) / span if span >= 0.5 * window else math.nan


@dataclass(slots=True)
class Return:
    """Whether a reading returns to the limit that has stopped the run, while an output is driven on.

    A tripped limit does not trip again, so that cleanup can drive away from it. Where the mean excess over
    `_RETURN` s has not become smaller than over the `_RETURN` s before, it does not return.
    """

    watch: Watch
    _since: float = math.nan  # s, when the mean in progress began
    _sum: float = 0.0
    _count: int = 0
    _before: float = math.inf  # the last mean

    def update(self, time: float, value: float, *, driven: bool) -> Alarm | None:
        """Take the next sample, which the watch has processed; `driven`: an output is on again that was on
        when the limit tripped."""
        watch = self.watch
        # Nothing to judge: not tripped, inside the limit again, or all outputs off. The comparison begins
        # anew.
        if watch.raised is None or watch.persistence.since is None or not driven:
            self._before, self._count = math.inf, 0
            return None
        if not self._count:
            self._since, self._sum = time, 0.0
        self._sum, self._count = self._sum + watch.excess, self._count + 1
        if time - self._since < _RETURN - _SLACK:
            return None
        # The first mean is compared with infinity: it takes two, 10 s, before the limit trips again.
        mean, before = self._sum / self._count, self._before
        self._before, self._count = mean, 0
        if mean < before:
            return None
        message = f"{watch.raised.message}; it does not return while an output is on again"
        return replace(watch.raised, time=time, message=message, value=value)


@dataclass(slots=True)
class Disturbance:
    """Warns when a channel is far noisier than stated in the rig file: a loose contact, a failing sensor.

    It examines the second difference of the readings, which is small for smooth motion: if more than half of
    the last `_NOISE_SAMPLES` are above the threshold, motion is not the cause.
    """

    channel: str
    column: int
    threshold: float
    past: float = math.nan
    before: float = math.nan
    history: int = 0  # one bit for each of the last samples
    raised: bool = False

    def update(self, time: float, value: float) -> Alarm | None:
        """Take the next sample."""
        bend = abs(value - 2.0 * self.past + self.before)
        self.before, self.past = self.past, value
        self.history = (self.history << 1 | (bend > self.threshold)) & _NOISE_MASK
        # Cleared only when all of the last `_NOISE_SAMPLES` were quiet.
        if self.raised:
            self.raised = self.history > 0
            return None
        if self.history.bit_count() <= _NOISE_SAMPLES // 2:
            return None
        self.raised = True
        text = f"{self.channel} is far noisier than the rig file says: sensor or line disturbed"
        return Alarm(time, f"{self.channel} noise", self.channel, "warn", text, value)


@dataclass(slots=True)
class Standstill:
    """Trips when the reading stays exactly the same: a stuck sensor, or a logger that repeats its last value.

    Parameters
    ----------
    column: index of the channel in a row.
    duration: s without a change; in at least `_SAME_READINGS` readings, however slowly it is sampled.
    command, safe: index of an actuator's command in a row, and its safe value, SI: time counts only while the
        command differs from it; None: always.
    """

    name: str
    channel: str
    column: int
    duration: float
    action: Literal["warn", "stop"]
    describe: Callable[[float], str]
    command: int | None = None
    safe: float = 0.0
    value: float = math.nan
    since: float = math.nan
    readings: int = 0
    raised: Alarm | None = None

    def update(self, row: Sequence[float]) -> Alarm | None:
        """Take the next row; returns an alarm if it raises or clears one."""
        time, value = row[0], row[self.column]
        on = self.command is None or abs(row[self.command] - self.safe) > 0.0
        if math.isnan(value) and on:  # says nothing: a stuck sensor whose line fails now and then is stuck
            return None
        if value != self.value or not on:
            self.value, self.since, self.readings = value, time, 1
            if self.raised is None:
                return None
            cleared, self.raised = replace(self.raised, time=time, value=value, active=False), None
            return cleared
        self.readings += 1
        stood = time - self.since
        if self.raised is not None or self.readings < _SAME_READINGS or stood < self.duration - _SLACK:
            return None
        self.raised = Alarm(time, self.name, self.channel, self.action, self.describe(value), value)
        return self.raised


class _Group:
    """The watches of one device's channels, which are checked at each of its readings and at no other."""

    def __init__(self, rig: Rig, channels: Collection[str]) -> None:
        columns = {name: index for index, name in enumerate(rig.layout.columns)}
        limits = [watch for watch in _of_limits(rig, columns) if watch.channel in channels]
        ranges = [watch for watch in _of_ranges(rig, columns) if watch.channel in channels]
        self.rates = [watch for watch in limits if watch.window is not None]
        self.values = [*ranges, *(watch for watch in limits if watch.window is None)]
        self.bands = _narrowest(self.values)
        self.noise = [one for one in _disturbances(rig, columns) if one.channel in channels]
        self.still = [one for one in _standstills(rig, columns) if one.channel in channels]
        self.returns = [Return(watch) for watch in limits if watch.action == "stop"]
        self.busy = False

    def check(self, row: tuple[float, ...], possible_readings: PossibleReadings) -> Sequence[Alarm]:
        """Check a row, without the exceptions for cleanup after a trip."""
        # NaN is in no band, so that a missing value is never taken for one inside.
        inside = all(low <= row[column] <= high for column, low, high in self.bands)
        # Impossible readings lie outside their sensor's watch, hence outside the bands: only then the row is
        # copied.
        possible = row if inside else possible_readings.of(row)
        # Noise and standstill are the two that need every value, also those inside all bands.
        noisy = [
            alarm
            for watch in self.noise
            if (alarm := watch.update(row[0], possible[watch.column])) is not None
        ]
        if self.still:
            noisy += [alarm for watch in self.still if (alarm := watch.update(possible)) is not None]
        # The usual end: nothing is outside, and no watch counts time outside or an alarm to clear.
        if inside and not self.busy:
            rates = [alarm for watch in self.rates if (alarm := watch.take(row, row)) is not None]
            return noisy + rates if rates else noisy
        alarms = [
            alarm for watch in (*self.values, *self.rates) if (alarm := watch.take(row, possible)) is not None
        ]
        # Rates are not asked: they are taken at every row anyway.
        self.busy = not all(watch.calm for watch in self.values)
        return noisy + alarms


class Interlocks:
    """Every watch of a rig. Rows are ``(time, record, *channels, *commands)``, SI, as read.

    An impossible reading is no value: it is not inside a limit, see `Watch.reading`.
    """

    def __init__(self, rig: Rig) -> None:
        columns = {name: index for index, name in enumerate(rig.layout.columns)}
        self._rig = rig
        self._possible = PossibleReadings(rig)
        self._stale_after = rig.tolerated_silence
        self._groups = {name: _Group(rig, part.channels.keys()) for name, part in rig.parts.items()}
        self._safe = [
            (columns[name], float(rig.safe_state.get(name, 0.0)))
            for name, actuator in rig.actuators.items()
            if actuator.by == "driven"
        ]
        #: once a limit has stopped the run: the outputs that were on, with the sign of their deviation
        self._driving: dict[int, float] | None = None
        self._silent = False
        self._heard: dict[str, float] = {}  # s, newest reading of each of several devices
        self._rate = math.nan  # Hz, for which the following hold
        self._limits: dict[str, float] = {}  # s, longest silence of each
        self.silent_devices: set[str] = set()  #: of several, those whose silence has raised an alarm

    def check(self, row: tuple[float, ...], device: str = "") -> Sequence[Alarm]:
        """The alarms that the reading of a device raises or clears; almost always none."""
        group = self._groups[device]
        # Any reading ends a silence, and the next one will alarm again.
        self._silent = False
        if device:
            self._heard[device] = row[0]
            self.silent_devices.discard(device)
        alarms = group.check(row, self._possible)
        # After the first limit that stopped the run: cleanup is in progress, and may have to drive away from
        # it.
        if self._driving is not None:
            # an output that was off may be switched on: a cooling pump may take longer than `_RETURN` to act
            driven = not self._driving.items().isdisjoint(self._driven(row).items())
            returns = (one.update(row[0], row[one.watch.column], driven=driven) for one in group.returns)
            return [*alarms, *(alarm for alarm in returns if alarm is not None)]
        # Which outputs were on at that moment, and to which side: these are the ones that may have caused it.
        if any(alarm.active and alarm.action == "stop" for alarm in alarms):
            self._driving = self._driven(row)
        return alarms

    def _driven(self, row: Sequence[float]) -> dict[int, float]:
        """The columns of the outputs that are not in their safe state, with the sign of the deviation."""
        return {
            column: math.copysign(1.0, row[column] - safe)
            for column, safe in self._safe
            if row[column] != safe
        }

    def check_arming(self, rows: Sequence[tuple[float, ...]]) -> list[Alarm]:
        """The alarms that forbid arming: a sensor without a value in most of `rows`, and a limit with action
        stop that is exceeded in most of those with a value."""
        # By majority: one disturbed reading must neither forbid arming nor, being the only good one, allow
        # it.
        possible = [self._possible.of(row) for row in rows]
        alarms = []
        for watch in (watch for group in self._groups.values() for watch in group.values):
            column = watch.column
            read = [
                watch.reading(row[column], ours[column]) for row, ours in zip(rows, possible, strict=True)
            ]
            known = [value for value in read if watch.missing or not math.isnan(value)]
            outside = [value for value in known if watch.outside(value)]
            if watch.action == "stop" and 2 * len(outside) > len(known):
                message = watch.describe(outside[-1])
                alarms.append(Alarm(rows[-1][0], watch.name, watch.channel, "stop", message, outside[-1]))
        return alarms

    def check_silence(self, now: float, newest: float, period: float) -> Alarm | None:
        """An alarm if the newest sample is too old; once for each silence.

        Parameters
        ----------
        now: s.
        newest: s, time of the newest sample, or when sampling was started.
        period: s between samples; a slow rate is not silence.
        """
        # Once for each silence: `check` ends it.
        if self._silent or now - newest < self.silence_limit(period) - _SLACK:
            return None
        self._silent = True
        message = f"no sample for {now - newest:.3g} s, expected one every {period:.3g} s"
        message += _stated_silence(self._rig, "", self.silence_limit(period))
        return Alarm(now, "stale", "", "stop", message, now - newest)

    def check_devices(self, now: float, since: float, rate: float) -> tuple[str, Alarm | None]:
        """One of several devices that has been silent for too long, with an alarm; once for each silence.

        Parameters
        ----------
        now: s.
        since: s, when sampling was started.
        rate: of the bench, Hz; a slow device is read less often.
        """
        if rate != self._rate:
            self._set_rate(now, rate)
        for device, limit in self._limits.items():
            silence = now - self._heard.get(device, since)
            if device in self.silent_devices or silence < limit - _SLACK:
                continue
            self.silent_devices.add(device)
            expected = 1.0 / self._rig.rate_of(device, rate)
            message = f"{device}: no reading for {silence:.3g} s, expected one every {expected:.3g} s"
            message += _stated_silence(self._rig, device, limit)
            return device, Alarm(now, f"{device} stale", "", "stop", message, silence)
        return "", None

    def _set_rate(self, now: float, rate: float) -> None:
        """Take note of the rate, Hz, from which the longest silence of each device follows."""
        before, self._rate = self._limits, rate
        self._limits = {device: self._rig.silence_limit(device, rate) for device in self._rig.devices}
        # The silence is counted from now: what was on time at the old rate would be too late at the new one.
        for device, limit in self._limits.items():
            if limit < before.get(device, 0.0):  # it is read more often from now on
                self._heard[device] = now

    def silence_limit(self, period: float) -> float:
        """Longest allowed time without a sample, s."""
        return max(self._stale_after, 3.0 * period)


def _narrowest(watches: Iterable[Watch]) -> tuple[tuple[int, float, float], ...]:
    """For every column the band inside which none of its watches trips."""
    bands: dict[int, tuple[float, float]] = {}
    for watch in watches:
        low, high = bands.get(watch.column, (-math.inf, math.inf))
        bands[watch.column] = (max(low, watch.low), min(high, watch.high))
    return tuple((column, low, high) for column, (low, high) in bands.items())


def _of_ranges(rig: Rig, columns: Mapping[str, int]) -> list[Watch]:
    """One watch per channel: if the value is physically impossible, or missing, the sensor is broken."""
    watches = []
    for name, channel in rig.channels.items():
        low, high = channel.band
        limit = rig.stale_after_of(name)
        watches.append(
            Watch(
                name=f"{name} sensor",
                channel=name,
                column=columns[name],
                low=low,
                high=high,
                persistence=Persistence(limit, _SENSOR_WINDOW * limit),
                action="stop",
                describe=partial(_impossible, name, channel),
                missing=True,
                limit=_stated(rig, name),
            )
        )
    return watches


def _stated(rig: Rig, channel: str) -> str:
    """What a message adds on the limit that counts for a channel; nothing where it is the rig's."""
    owner = rig.whose_stale_after(channel)
    return f"; stale_after of {owner} is {rig.stale_after_of(channel):g} s" if owner else ""


def _stated_silence(rig: Rig, device: str, limit: float) -> str:
    """What a message adds on the limit of a silence: that of the channel which is stale first."""
    channels = rig.channels if not device else rig.parts[device].channels
    first = min(channels, key=rig.stale_after_of, default=None)
    by_rate = first is None or limit > rig.stale_after_of(first)
    return "" if first is None or by_rate else _stated(rig, first)


def _disturbances(rig: Rig, columns: Mapping[str, int]) -> list[Disturbance]:
    """One for each channel whose noise the rig file states."""
    disturbances = []
    for name, channel in rig.channels.items():
        if channel.noise_level > 0.0:
            expected = math.hypot(channel.noise_level, channel.resolution)
            disturbances.append(Disturbance(name, columns[name], _NOISE_FACTOR * expected))
    return disturbances


def _standstills(rig: Rig, columns: Mapping[str, int]) -> list[Standstill]:
    """One for each limit on a standstill."""
    standstills = []
    for name, limit in rig.limits.items():
        if limit.bound == "unchanged":
            actuator = limit.while_on
            standstills.append(
                Standstill(
                    name=name,
                    channel=limit.channel,
                    column=columns[limit.channel],
                    duration=limit.threshold,
                    action=limit.action,
                    describe=partial(_stands_still, limit, rig.channels[limit.channel]),
                    command=None if actuator is None else columns[actuator],
                    safe=0.0 if actuator is None else float(rig.safe_state.get(actuator, 0.0)),
                )
            )
    return standstills


def _of_limits(rig: Rig, columns: Mapping[str, int]) -> list[Watch]:
    """One watch per limit of the rig file."""
    watches = []
    for name, limit in rig.limits.items():
        if limit.bound == "unchanged":
            continue
        upper = limit.bound.endswith("above")
        watches.append(
            Watch(
                name=name,
                channel=limit.channel,
                column=columns[limit.channel],
                low=-math.inf if upper else limit.threshold,
                high=limit.threshold if upper else math.inf,
                persistence=Persistence(limit.for_, limit.window),
                action=limit.action,
                describe=partial(_exceeded, limit, rig.channels[limit.channel]),
                window=limit.over if limit.of_rate else None,
            )
        )
    return watches


def _impossible(name: str, channel: Channel, value: float) -> str:
    if math.isnan(value):
        return f"{name} gives no value: sensor or line broken"
    reading = show(value, channel.unit, difference=channel.difference)
    return f"{name} reads {reading}, which is impossible: sensor or line broken"


def _stands_still(limit: Limit, channel: Channel, value: float) -> str:
    reading = show(value, channel.unit, difference=channel.difference)
    driven = f" while {limit.while_on} was on" if limit.while_on else ""
    text = f"{limit.channel} has read exactly {reading} for {limit.threshold:g} s{driven}: sensor stuck"
    return f"{limit.message}: {text}" if limit.message else text


def _exceeded(limit: Limit, channel: Channel, value: float) -> str:
    interval = limit.of_rate or channel.difference
    subject, per = (f"rate of {limit.channel}", "/s") if limit.of_rate else (limit.channel, "")
    relation = "above" if limit.bound.endswith("above") else "below"
    reading = show(value, channel.unit, difference=interval)
    bound = show(limit.threshold, channel.unit, difference=interval)
    text = f"{subject} is {reading}{per}, {relation} the limit of {bound}{per}"
    if not limit.of_rate and not channel.possible(value):
        text += "; that is impossible, the sensor or its line may be broken"
    return f"{limit.message}: {text}" if limit.message else text
