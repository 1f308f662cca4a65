"""The action of the step `control` if the bench's board executes the loop.

The board receives the controller's parameters, computes with a fixed period, and reports its output with
every sample. The host continues to monitor it: sampling, interlocks, settling and oscillation work as for a
loop on the host, and every end of a run first makes the outputs safe, which ends the loop on the board.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import Behaviour, Row, StepBench, Until, every_sample
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.steps.control.action import Control, Watch
from rigctl.steps.control.pid import AntiWindup
from rigctl.units import show

#: highest sampling rate outside records, Hz, however fast the loop is
_WATCHED = 100.0
_LONGEST_PERIOD = 60_000  # ms


def whole_period(period: float) -> int:
    """Return the period of a loop on the board, ms.

    Raises
    ------
    RigctlError
        it is not a whole number of milliseconds, or too long.
    """
    milliseconds = period * 1e3
    nearest = min(max(round(milliseconds), 1), _LONGEST_PERIOD)
    if abs(milliseconds - nearest) > 1e-6 * nearest:
        raise RigctlError(
            "no rate of a loop on the board, whose period is whole milliseconds",
            value=f"{1.0 / period:g} Hz",
            expected=f"e.g. {1e3 / nearest:.6g} Hz, {nearest} ms",
        )
    return nearest


@dataclass(frozen=True, slots=True)
class ControlOnBoard(Control):
    """A loop that the board executes; `required`: whether the host must not do so instead."""

    required: bool

    @property
    def needed_rate(self) -> float:
        """The rate at which the board's loop is monitored, Hz."""
        return min(1.0 / self.period, _WATCHED)

    def settings(self, ahead: float = 0.0) -> LoopSettings:
        """Return the parameters for the board; `ahead` is the feed-forward at the start, SI."""
        gains, bounds = self.gains, self.bounds
        return LoopSettings(
            actuator=self.actuator,
            channel=self.channel,
            to=self.to,
            ramp=self.ramp if self.ramp is not None else math.inf,
            gain=gains.proportional,
            integral=gains.integral,
            derivative=gains.derivative,
            filter_time=gains.filter_time,
            tracking_time=gains.tracking_time,
            clamping=gains.anti_windup is AntiWindup.CLAMPING,
            low=bounds.low,
            high=bounds.high,
            rate=bounds.rate,
            bumpless=self.bumpless,
            period=self.period,
            ahead=ahead,
        )

    def refusal(self, bench: StepBench) -> RigctlError | None:
        """Return the error if the loop must run on the bench's board but cannot; otherwise None."""
        reason = bench.cannot_regulate(self.settings())
        if not (self.required and reason):
            return None
        return RigctlError(f"'where: board': {reason}", hint="With 'where: auto' the host runs it there")

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Run the loop on the board, and monitor it; run it on the host if the board cannot and need not.

        Raises
        ------
        StepFailed
            the loop could not be started, the reading has not settled in time, or the loop oscillates.
        """
        reason = bench.cannot_regulate(self.settings())
        if reason:
            bench.event("note", f"the loop runs on the host: {reason}")
            return (yield from Control.carry_out(self, bench))
        # From here on the board computes; the host sees the loop only through its samples.
        state = LoopState(False, None)
        watch = Watch(self, bench)
        try:
            bench.need_rate(self.needed_rate)
            bench.regulated.add(self.actuator)
            yield from self._monitor(bench, watch)
            yield from bench.stop_regulating(self.actuator)
        finally:  # any other ending has made the outputs safe before, and thereby ended the loop
            with suppress(RigctlError):  # a bench that does not answer has its own ending
                state = bench.loop_state()
            bench.regulated.discard(self.actuator)
            bench.need_rate(0.0)
            self._keep_figures(bench, state)
            watch.log_undefined()
        if not self.stay:
            bench.release(self.actuator)
        return Outcome.COMPLETE

    def _monitor(self, bench: StepBench, watch: Watch) -> Generator[Until, Row | None, None]:
        """Start the loop, and monitor its samples until it has settled or its time has elapsed."""
        column = bench.columns[self.channel]
        possible = bench.rig.channels[self.channel].possible
        end = bench.now + self.longest
        row: Row | None = yield from bench.fresh()
        begun, seen = False, -math.inf
        while True:
            # rows of other devices repeat a reading: it counts once, at its own time
            row = bench.read_with(row, self.channel) if row is not None else None
            if row is not None and row[0] > seen and possible(row[column]) and not math.isnan(row[column]):
                value, seen = row[column], row[0]
                setpoint = watch.setpoint(row[0], value)
                ahead = watch.ahead(row, setpoint)
                if ahead is None:
                    pass  # the loop is started with the first value of its feed-forward
                # The state decides, not a memory of having started it: after a loss the board has ended its
                # loop by itself.
                elif not bench.loop_state(ahead).running:  # not started yet, or contact was lost
                    if not begun:
                        before = bench.commanded.get(self.actuator, bench.safe_value(self.actuator))
                        watch.note_cancelled(setpoint - value, ahead, before)
                    yield from bench.regulate(self.settings(ahead))
                    if bench.loop_state().running:
                        # The time counts from the first start; starting again after a loss gives no more of
                        # it.
                        end = end if begun else bench.now + self.longest
                        self._log_start(bench, again=begun)
                        begun = True
                elif watch.settled(row[0], setpoint, value):
                    return
            row = yield Until(end, every_sample)
            if row is None and bench.now >= end:
                if not begun:
                    raise StepFailed("the loop could not be started on the board", outcome=Outcome.TIMED_OUT)
                watch.give_up()
                return

    def _log_start(self, bench: StepBench, *, again: bool) -> None:
        if again:
            bench.event("note", "the loop on the board is started again")
            return
        channel = bench.rig.channels[self.channel]
        target = show(self.to, channel.unit, difference=channel.difference)
        every = f"once in {self.period * 1e3:g} ms"
        bench.event("note", f"the loop runs on the board: {self.channel} to {target}, {every}")

    def _keep_figures(self, bench: StepBench, state: LoopState) -> None:
        figures = state.figures
        if figures is None:
            return
        self.keep(bench, figures.values())
        for number, what in (
            (figures.missed, "held the output: the reading was impossible"),
            (figures.late, "were left out: the board was too busy"),
        ):
            if number:
                bench.event("note", f"{number} updates on the board {what}")
