"""The action of the step `control`: a closed loop on the host, updated sample by sample.

In: the loop's settings, and each sample of the bench. Out: commands, the measures of the loop's timing,
and an end: the time is over, the reading has settled, or the loop has failed. Three parts: `_Loop`
computes the output (`rigctl.steps.control.pid`), `Watch` judges the loop whoever computes it, on the host
or on the board, and `Timing` counts how regularly it was updated. See
docs/decisions/0082-control-loops-run-sample-by-sample.md.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

from rigctl.cadence import Cadence
from rigctl.errors import RigctlError
from rigctl.plan.action import Action, SetPoint
from rigctl.plan.behaviour import Behaviour, Row, StepBench, Until, every_sample
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.steps.control.feed_forward import FeedForward
from rigctl.steps.control.oscillation import OscillationDetector
from rigctl.steps.control.pid import Bounds, Gains, Pid
from rigctl.steps.control.timing import Timing
from rigctl.steps.readings import reading
from rigctl.steps.settling import Settling
from rigctl.units import show

#: longest wait of a loop for the first value of its feed-forward: s, or periods if that is longer
_UNDEFINED, _UNDEFINED_PERIODS = 1.0, 10.0
#: the measures of a loop that are stored, and their units
KEPT = {"jitter_p50": "ms", "jitter_p99": "ms", "jitter_max": "ms", "latency_p99": "ms", "saturated": "%"}

#: a step at the start, as a fraction of the output's range, from which its cancellation is reported
_LARGE = 0.2


@dataclass(frozen=True, slots=True)
class Control(Action):
    """Control `channel` to `to` by `actuator`; SI throughout."""

    actuator: str
    channel: str
    to: float
    ramp: float | None  #: per s
    gains: Gains
    bounds: Bounds
    feed_forward: FeedForward | None
    bumpless: bool
    period: float  #: s
    duration: float | None  #: s; None: until the reading has settled
    within: float | None
    settle: float | None
    timeout: float | None
    oscillation: float  #: amplitude above which a sustained oscillation ends the step
    name: str
    stay: bool

    @property
    def longest(self) -> float:
        """The longest time that the step can take, s."""
        return self.duration if self.duration is not None else self.timeout or 0.0

    @property
    def needed_rate(self) -> float:
        """The update rate of the loop, Hz."""
        return 1.0 / self.period

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration or, if the step ends by settling, its time-out."""
        basis = Basis.TIMED if self.duration is not None else Basis.AT_MOST
        after = bench.pass_time(state, self.longest)
        heat, pressure = bench.rig.roles.heat, bench.rig.roles.set_pressure
        if heat is not None and heat.channel == self.channel:
            after = replace(after, temperature=self.to)
        if pressure is not None and pressure.channel == self.channel:
            after = replace(after, pressure=self.to)
        return Forecast(self.longest, basis, after, {self.channel: (self.to, self.to)})

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Run the loop; outside a record the bench is sampled at the loop's rate meanwhile.

        Raises
        ------
        StepFailed
            the reading has not settled in time, the loop oscillates, or its feed-forward has no value.
        """
        timing = Timing(self.period)
        watch = Watch(self, bench)
        try:
            # Both are undone in `finally`, however the step ends. An output in `regulated` may go off in a
            # short loss of contact without ending the run: the loop commands it at its next update.
            bench.need_rate(1.0 / self.period)
            bench.regulated.add(self.actuator)
            yield from self._loop(bench, watch, timing)
        finally:
            bench.regulated.discard(self.actuator)
            bench.need_rate(0.0)
            self.keep(bench, timing.values())
            watch.log_undefined()
            if timing.missed:
                bench.event("note", f"{timing.missed} readings of {self.channel} could not be used")
        if not self.stay:
            bench.release(self.actuator)
        return Outcome.COMPLETE

    def _loop(self, bench: StepBench, watch: Watch, timing: Timing) -> Generator[Until, Row | None, None]:
        column = bench.columns[self.channel]
        possible = bench.rig.channels[self.channel].possible
        first = bench.commanded.get(self.actuator, bench.safe_value(self.actuator))
        loop = _Loop(self, bench, watch, first)
        begin = bench.now
        end = begin + self.longest
        cadence = Cadence(self.period, bench.rig.actuators[self.actuator].min_interval)
        # A reading taken after the last command: the first error decides how a bumpless start continues.
        row: Row | None = yield from bench.fresh()
        while True:
            # With several devices, rows come from all of them: the loop counts those of its own channel, by
            # their times.
            row = bench.read_with(row, self.channel) if row is not None else None
            if row is not None and cadence.is_due(row[0], 1.0 / bench.rate_of(self.channel)):
                if possible(row[column]) and not math.isnan(row[column]):
                    if loop.update(row, row[column], timing):
                        return
                else:
                    timing.missed += 1
            row = yield Until(end, every_sample)
            if row is None and bench.now >= end:
                watch.give_up()
                return

    def keep(self, bench: StepBench, values: Iterable[tuple[str, float, str]]) -> None:
        """Store measures of the loop with the record or the run, also if it was interrupted."""
        for name, value, unit in values:
            with suppress(RigctlError):  # if the disk is full, the run ends at the next sample anyway
                bench.record_measure(MeasuredValue(f"{self.name}_{name}", value, unit))

    def set_point(self) -> SetPoint:
        """Return the target of the loop's channel, with the ramp."""
        return SetPoint(self.channel, self.to, self.within, self.ramp)

    def lasting(self) -> frozenset[str]:
        """Return the actuator if it keeps its last value, otherwise nothing."""
        return frozenset({self.actuator}) if self.stay else frozenset()


class Watch:
    """The monitoring of a loop on the host or the board: set-point, feed-forward, settling, oscillation."""

    def __init__(self, action: Control, bench: StepBench) -> None:
        self._action, self._bench = action, bench
        self._feed_forward = action.feed_forward.on(bench) if action.feed_forward is not None else None
        self._ahead: float | None = 0.0 if action.feed_forward is None else None  # its newest defined value
        self._undefined = 0  # number of updates at which it was undefined
        self._waiting = math.inf  # time since which the loop has waited for its first value, s
        self._detector = OscillationDetector(action.oscillation)
        self._start: tuple[float, float] | None = None
        self._settling: Settling | None = None
        if action.within is not None and action.settle is not None:
            self._settling = Settling(action.to, action.within, action.settle)

    def setpoint(self, time: float, value: float) -> float:
        """Return the set-point at `time`, on the ramp from the first reading if there is a ramp."""
        ramp, target = self._action.ramp, self._action.to
        if ramp is None:
            return target
        if self._start is None:
            self._start = (time, value)
        began, first = self._start
        way = ramp * (time - began)
        return min(first + way, target) if target >= first else max(first - way, target)

    def ahead(self, row: Row, setpoint: float) -> float | None:
        """Return the feed-forward; while it is undefined, its latest value, or None before the first one.

        Raises
        ------
        StepFailed
            it has had no value for too long since the start of the loop.
        """
        if self._feed_forward is None:
            return self._ahead
        ahead = self._feed_forward(row, setpoint)
        if math.isfinite(ahead):
            self._ahead = ahead
            return ahead
        self._undefined += 1
        if self._ahead is None:
            self._waiting = min(self._waiting, row[0])
            if row[0] - self._waiting >= max(_UNDEFINED, _UNDEFINED_PERIODS * self._action.period):
                raise StepFailed(
                    f"the feed-forward of the loop has no value: '{self._formula}' is undefined with these "
                    "readings and constants"
                )
        return self._ahead

    def log_undefined(self) -> None:
        """Log at how many updates the feed-forward was undefined."""
        if self._undefined and self._ahead is not None:
            self._bench.event(
                "note",
                f"'{self._formula}' was undefined at {self._undefined} updates, which used its newest value",
            )

    @property
    def _formula(self) -> str:
        return self._action.feed_forward.expression.text if self._action.feed_forward is not None else ""

    def note_cancelled(self, error: float, ahead: float, output: float) -> None:
        """Report a bumpless start that cancels a large step.

        The integral then takes up what gain and feed-forward would add to the `output` at once, and the
        output only moves as fast as it integrates.
        """
        action = self._action
        gains, bounds = action.gains, action.bounds
        asked = gains.proportional * error
        step = asked + ahead - output
        large = abs(step) > _LARGE * (bounds.high - bounds.low)
        # an output that is already beyond what they ask for holds an operating point, which is worth keeping
        if not (action.bumpless and gains.integral and large and step * asked > 0.0):
            return
        unit = self._bench.rig.actuators[action.actuator].display_unit
        self._bench.event(
            "note",
            f"start: bumpless cancels a step of {show(step, unit, difference=True)} of '{action.actuator}', "
            "which the gain and the feed-forward ask for at the start; 'start: zero' makes this step",
        )

    def settled(self, time: float, setpoint: float, value: float) -> bool:
        """Return whether the reading has settled.

        Raises
        ------
        StepFailed
            the loop oscillates.
        """
        found = self._detector.add(time, setpoint - value)
        if found is not None:
            channel = self._action.channel
            amplitude = reading(self._bench, channel, found[0], difference=True)
            raise StepFailed(
                f"the loop oscillates: {channel} swings ± {amplitude} around its set-point, once in "
                f"{found[1]:.3g} s"
            )
        return self._settling is not None and self._settling.add(time, value)

    def give_up(self) -> None:
        """End the loop when its time has elapsed.

        Raises
        ------
        StepFailed
            the loop was to run until the reading settles, and it has not.
        """
        if self._settling is not None:
            action = self._action
            reason = self._settling.gave_up(self._bench, action.channel, action.timeout or 0.0)
            raise StepFailed(reason, outcome=Outcome.TIMED_OUT)


class _Loop:
    """The state of a loop on the host between updates."""

    def __init__(self, action: Control, bench: StepBench, watch: Watch, output: float) -> None:
        self._action, self._bench, self._watch = action, bench, watch
        self._pid = Pid(action.gains, action.bounds, output, bumpless=action.bumpless)
        self._told = False

    def update(self, row: Row, value: float, timing: Timing) -> bool:
        """Update the output; return True once the reading has settled.

        Raises
        ------
        StepFailed
            the loop oscillates, or its feed-forward has no value.
        """
        time = row[0]
        setpoint = self._watch.setpoint(time, value)
        ahead = self._watch.ahead(row, setpoint)
        if ahead is not None and not self._told:
            self._told = True
            self._watch.note_cancelled(setpoint - value, ahead, self._pid.output)
        if ahead is None:  # until there is a value, the output remains as it was before the loop
            timing.missed += 1
            return False
        output = self._pid.update(time, value, setpoint, ahead)
        name = self._action.actuator
        if not self._bench.is_at(name, output):
            self._bench.try_switch(name, output)
        timing.add(time, self._bench.now, saturated=self._pid.saturated)
        return self._watch.settled(time, setpoint, value)
