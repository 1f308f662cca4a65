"""The main loop of a run: the only place in which bench time passes.

In: the generator of the plan (`rigctl.runner.walk`), which yields `Until` conditions, and the sources of
requests. Out: the generator is sent the row that met its condition, or has an `Ending` thrown into it at the
point where it waits, so that the `finally` blocks between there and the plan's root run as in any Python
program.

One thread does all of this. A step cannot be interrupted anywhere but at a `yield`, and no two steps command
the bench at once; every wait, whatever for, goes through `Driver.wait`, so that none of them can bypass the
interlocks, the signals or the requests. Whatever would block (files, displays, the devices of a combined
bench) is in threads of its own, see `rigctl.runner.operators.control_thread`.
See docs/decisions/0006-steps-are-generators-yielding-wait-conditions.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from time import perf_counter, sleep

from rigctl.plan.behaviour import OnPause, Row, Until
from rigctl.plan.outcomes import Aborted, Ending, Lost, Outcome, StepFailed
from rigctl.runner.bench import Bench
from rigctl.runner.operators.attendance import Attendance
from rigctl.runner.operators.requests import RESPONSE, Control, Order, Request
from rigctl.runner.operators.signals import Signals
from rigctl.runner.sampling import Sampling
from rigctl.runner.states import Lifecycle, RunState
from rigctl.runner.step_errors import ending_for
from rigctl.runner.walk import CLEANUP_STEP_LIMIT, Restart, Walker

_SIGNAL = 0.02  # longest wait of a signal without a sample, s of wall time
#: s of suspension of the computer that end a run; what is shorter is how exactly it is known
_SUSPENDED = 0.5
#: s above which two times on a sampling grid are different
_SLACK = 1e-9
_UNTIL_BACK = "the run waits until a lost device is back"


class Quit(Exception):
    """A second signal: no further cleanup block."""


class Driver:
    """Owns time and requests during a run.

    Parameters
    ----------
    secure: brings outputs to the safe state because of an ending, once for each ending.
    tick: called ten times a second of wall time, for observers of the run.
    response: s of wall time between two checks for requests.
    """

    def __init__(
        self,
        bench: Bench,
        sampling: Sampling,
        lifecycle: Lifecycle,
        signals: Signals,
        controls: Sequence[Control],
        *,
        secure: Callable[[Ending], None],
        tick: Callable[[], None],
        response: float = RESPONSE,
    ) -> None:
        self._bench = bench
        self._sampling = sampling
        self._clock = bench.backend.clock
        self._lifecycle = lifecycle
        self._signals = signals
        self._controls = controls
        self._secure = secure
        self._tick = tick
        self._response = response
        self._slice = _SIGNAL * self._clock.speed  # s of bench time
        self._next_look = 0.0  # wall time
        self._signals_seen = 0
        self._suspended = self._clock.suspended()
        self._pause: tuple[Control, Order] | None = None
        self._walker: Walker | None = None

    def drive(self, steps: Generator[Until, Row | None, None], walker: Walker) -> None:
        """Run the generator to its end.

        Raises
        ------
        Ending
            what ended it early, after its own cleanup blocks.
        Quit
            somebody chose not to wait for those.
        """
        self._walker = walker
        try:
            until = next(steps)
            while True:
                try:
                    row = self.wait(until)
                # Not thrown into the generator: a step would take it for an error, and the cleanup blocks
                # that the second signal is to skip would run. `_Session.carry_out` closes the generator.
                except Quit:
                    raise
                # Both were raised by `wait` between two steps of the generator. An ending has made the
                # outputs safe before it was raised; the generator may handle it (cleanup, a record that is
                # repeated) and yield its next condition.
                except (Ending, Restart) as interruption:
                    until = steps.throw(interruption)
                # An error of a backend, or in rigctl itself: outputs have not been made safe yet.
                except Exception as error:  # noqa: BLE001 - whatever it is, cleanup blocks have to run
                    ending = ending_for(error, self._bench)
                    self._secure(ending)
                    until = steps.throw(ending)
                else:
                    until = steps.send(row)
        except StopIteration:
            return

    def wait(self, until: Until) -> Row | None:
        """Let time pass until a step's condition is met; returns the row that met it, or None."""
        # A cleanup step has a limit of its own (`Walker.limit`); whichever comes first ends the wait, and
        # below it matters which it was.
        sampling, when, done, now = self._sampling, until.when, until.done, self._clock.now
        limit = self._walker.limit if self._walker is not None else math.inf
        deadline = min(until.time, limit)
        silence = sampling.longest_silence
        # Each round: requests first, since none may wait for a sample that does not come; then one sample,
        # which is journalled and checked against the interlocks inside `next_row`; only then the step's own
        # condition. A step thus never acts on a sample that has tripped a limit.
        while True:
            self._look(until)
            time = now()
            # No wait is longer than until silence becomes a fault, nor than `_slice`, within which a signal
            # is answered.
            patience = sampling.newest + silence - time
            if patience <= 0.0:  # that alarm has been raised, and time has to continue
                patience = silence
            if sampling.awaiting:  # no step continues meanwhile, whatever it waits for
                self._stand_by(until)
                continue
            row = sampling.next_row(min(max(deadline - time, 0.0), self._slice, patience))
            if done is not None and done() and not sampling.awaiting:  # a loss drops what was sent
                return None
            # The deadline is not looked at while samples are in hand: after a stall of this computer those
            # that are buffered are taken one by one, so that a sample taken in time meets `when` although it
            # is read late.
            if row is not None:
                if when is not None and when(row):
                    return row
                continue
            if not sampling.awaiting:  # the samples that have come while outputs were made safe come first
                sampling.check_silence()  # after every wait: many short ones must not hide a silence
            # `check_silence` may have begun to wait for a lost device: then no deadline counts.
            if sampling.awaiting or now() < deadline - _SLACK:
                continue
            # The cleanup step's own limit, not what the step was waiting for.
            if limit < until.time:
                text = f"a cleanup step took longer than {CLEANUP_STEP_LIMIT:g} s"
                raise StepFailed(text, outcome=Outcome.TIMED_OUT)
            return None

    def _stand_by(self, until: Until) -> None:
        """Let time pass until what was lost is back; paused, unless only its record will be repeated."""
        sampling, lifecycle = self._sampling, self._lifecycle
        # In a pause by hand the run is paused already, and stays so: `_stand_still` restores the outputs
        # then.
        paused = sampling.pausing and lifecycle.state is RunState.RUNNING
        if paused:
            lifecycle.send("pause")
        try:
            while sampling.awaiting:
                self._look(until)
                sampling.next_row(min(self._slice, sampling.longest_silence))
        # Also where an ending is raised: it must not find the run still waiting, or paused by the device.
        finally:
            sampling.stop_waiting()
            if paused and lifecycle.state is RunState.PAUSED:
                lifecycle.send("go_on")
        # Only after contact was lost with `lost: pause` are outputs restored here. A record that is waited
        # for without a pause is repeated by `Walker._repeated`, which sets it up again.
        if paused and self._pause is not None:  # asked for meanwhile: nothing is switched on before its end
            self._stand_still(self._pause, until)
        elif paused:
            self._take_up(until, lost=True)

    def watch(self, duration: float) -> list[Row]:
        """Take samples as usual for `duration` s while no step is in progress."""
        rows: list[Row] = []
        self.wait(Until(self._clock.now() + duration, when=rows.append))
        return rows

    def _look(self, until: Until) -> None:
        """Handle suspensions and signals at once; keys, other terminals and observers every tenth of a
        second."""
        # A suspension comes before signals and requests: what follows would command a bench whose state
        # nobody has watched for hours.
        suspended = self._clock.suspended() - self._suspended
        if suspended > _SUSPENDED:
            self._woken(suspended)
        if self._signals.count > self._signals_seen:
            self._signalled()
        wall = perf_counter()
        if wall >= self._next_look:
            self._next_look = wall + self._response
            for control in self._controls:
                for order in control.poll():
                    self._obey(control, order)
            self._tick()
        # Last, since an order that was just obeyed may have ended or resumed the run. While it is paused this
        # method is called from `_stand_still` itself, and must not enter it again.
        if self._pause is None or self._lifecycle.state is not RunState.RUNNING:
            return
        # a record or a timed move is completed first: half of one is worthless
        if not self._bench.recording and until.on_pause is not OnPause.DEFER:
            self._stand_still(self._pause, until)

    def _woken(self, suspended: float) -> None:
        """End the run of a computer that was suspended, for so many s: nobody watched the bench meanwhile."""
        self._suspended += suspended
        text = f"the computer was suspended for {suspended:.3g} s"
        if self._lifecycle.state is RunState.FINISHING:
            # Cleanup is not ended by this: the outputs become safe, and the blocks that follow may still
            # matter.
            self._bench.make_safe(text)
            self._bench.event("note", f"{text}; cleanup goes on")
            return
        ending = Lost(f"{text}, and nobody watched the bench")
        self._secure(ending)
        raise ending

    def _signalled(self) -> None:
        """The first signal ends the run, the second one its cleanup."""
        # Two signals that arrive between two looks count as a second one: somebody is in a hurry.
        first, self._signals_seen = self._signals_seen == 0, self._signals.count
        if not first or self._signals.count > 1:
            # Safe once more: a cleanup block may have switched an output on since the first signal.
            self._bench.make_safe("a second signal")
            raise Quit
        ending = Aborted(f"ended by {self._signals.name}", exit_code=self._signals.exit_code)
        if self._lifecycle.state is RunState.FINISHING:
            self._bench.event("note", f"{self._signals.name}: cleanup goes on; a second one skips it")
            return
        self._secure(ending)
        raise ending

    def _obey(self, control: Control, order: Order) -> None:
        """Carry out a request, or report why not."""
        self._bench.event("operator", f"{order.request.value} asked for by {order.source}")
        state = self._lifecycle.state
        # No request can shorten cleanup; only a second signal does.
        if state is RunState.FINISHING:
            control.acknowledge(order, "the run is ending already")
        elif order.request is Request.ABORT:
            control.acknowledge(order, "ending: outputs are safe first, then cleanup")
            ending = Aborted(f"ended by {order.source}")
            self._secure(ending)
            raise ending
        elif order.request is Request.PAUSE:
            self._ask_for_pause(control, order)
        # The request is to continue.
        elif self._pause is None:
            text = "the run is not paused"
            control.acknowledge(order, _UNTIL_BACK if self._sampling.pausing else text)
        else:
            self._pause = None
            control.acknowledge(order, _UNTIL_BACK if self._sampling.pausing else "the run goes on")

    def _ask_for_pause(self, control: Control, order: Order) -> None:
        if self._pause is not None:
            control.acknowledge(order, "the run is paused already")
            return
        # Only noted here: `_look` begins the pause as soon as no record is open and the step allows it, and
        # `_stand_still` acknowledges it then. Where that may take long, the reason is given at once.
        self._pause = (control, order)
        if self._sampling.pausing:
            control.acknowledge(order, f"{_UNTIL_BACK}, and stays paused then")
        elif self._bench.recording:
            text = "pausing at the end of the record"
            control.acknowledge(order, text)
            self._sampling.note(self._clock.now(), "note", text)  # for observers

    def _stand_still(self, pause: tuple[Control, Order], until: Until) -> None:
        """Make outputs safe and wait until the run is resumed; sampling and interlocks continue."""
        self._lifecycle.send("pause")
        self._bench.make_safe("paused")
        control, order = pause
        attendance = Attendance(self._bench)
        safe = "outputs are safe" if self._bench.reachable else "but the outputs could not be made safe"
        control.acknowledge(order, f"paused, {safe}")
        still = math.isinf(self._clock.speed)  # virtual time must not run on while a person thinks
        baseline = self._walker.baseline if self._walker is not None else {}
        # Two conditions end the pause: somebody has asked to continue, and each output that will be switched
        # on has rested for its `min_interval` since the pause switched it off. The wait for the latter is
        # still part of the pause, so that another request, or an abort, is obeyed in the same way.
        while True:
            rested_in = self._bench.restorable_at(baseline) - self._clock.now()
            if self._pause is None and rested_in <= 0.0:
                break
            if self._pause is not None:
                self._end_unattended(attendance)
            if self._pause is not None and still:
                sleep(min(self._response, RESPONSE))
                self._look(until)
            else:
                # Samples are taken, journalled and checked as always: an interlock trips during a pause too.
                self.watch(self._slice if self._pause is not None else min(self._slice, rested_in))
        self._lifecycle.send("go_on")
        self._take_up(until)

    def _take_up(self, until: Until, *, lost: bool = False) -> None:
        """Go on with the step in progress after a pause, or a loss, with the commands that it began with."""
        baseline = self._walker.baseline if self._walker is not None else {}
        # `self.wait`, not the generator: the step in progress stands still at its `yield` until outputs are
        # back.
        with suppress(Restart):  # after another pause meanwhile, which has restored the same
            for waiting in self._bench.restored(baseline):
                self.wait(waiting)
        # DEFER gets here only after a loss, which does not wait for the end of a step: it begins again as
        # well.
        if until.on_pause is not OnPause.KEEP:
            raise Restart(lost=lost)

    def _end_unattended(self, attendance: Attendance) -> None:
        """End a pause that nobody attends to, if the outputs could not be made safe at its start."""
        try:
            attendance.check("the pause could not make the outputs safe")
        except StepFailed as ending:
            self._secure(ending)
            raise
