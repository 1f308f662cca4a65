"""One run from arming to its last line: every ending passes through the same cleanup, once.

In: a plan, an open backend, a recorder, an operator. Out: a `RunResult`; the backend and the data are closed
then, however the run ended.

`_Session` owns the parts (bench, interlocks, sampling, walker, state machine) and the order in which they
are used; `carry_out` and `close` are that order. An ending makes the outputs safe where it is noticed
(`_secure`), before cleanup blocks run, and once more at the end, as these blocks may have driven outputs.
What a run must never do is stop half-way through its ending: hence the broad `except` clauses, each of
which goes on to the next thing that has to be closed. The order as the user reads it is in
docs/explanation/safety.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rigctl.backends.protocol import Backend, Combined, Polled
from rigctl.dataset.history import read_history
from rigctl.dataset.pass_fail import Judgement, judge
from rigctl.dataset.run_json import read_info
from rigctl.errors import ExitCode, RigctlError
from rigctl.notebook import one_line
from rigctl.plan import Leaf, Plan, all_nodes
from rigctl.plan.outcomes import Aborted, Ending, SamplesLost, Tripped
from rigctl.planning.rates import refuse_slow_answers
from rigctl.runner.bench import Bench
from rigctl.runner.interlocks import Interlocks
from rigctl.runner.main_loop import Driver, Quit
from rigctl.runner.operators.control_thread import Watching, beside
from rigctl.runner.operators.operator import Operator
from rigctl.runner.operators.remote_control import ControlFile
from rigctl.runner.operators.remote_operator import RemoteOperator
from rigctl.runner.operators.requests import RESPONSE, Control
from rigctl.runner.operators.signals import Signals
from rigctl.runner.progress import progress_of
from rigctl.runner.recent_samples import history_for
from rigctl.runner.recorder import Recorder
from rigctl.runner.remaining_plan import Resume
from rigctl.runner.sampling import RunWarning, Sampling
from rigctl.runner.snapshot import View
from rigctl.runner.states import Lifecycle, RunState
from rigctl.runner.step_errors import ending_for
from rigctl.runner.walk import Walker
from rigctl.wording import number_of

#: s of bench time for trying to reach a lost bench at the end
LAST_TRY = 3.0
#: samples that are checked before anything moves
_ARMING_SAMPLES = 3

Observer = Callable[[View], None]


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Parameters
    ----------
    status: ``finished``, ``failed`` or ``aborted``.
    reason: why it did not finish, or which limit was missed; None if all is well.
    exit_code: what the process returns.
    folder: the run's folder; None where nothing was recorded.
    records: number of complete records, those of earlier sessions included.
    duration: s of bench time.
    unconfirmed: outputs that may still be on, because the bench has not confirmed that they are safe, or
        cannot; None if it has.
    by_hand: what the operator then has to do.
    warnings: where a simulated bench left the ranges of validity of its effects, and which outputs nothing
        confirms to be on, as they are in the safe state.
    test: whether the device under test has passed, over all sessions; None if nothing was recorded.
    """

    status: str
    reason: str | None
    exit_code: ExitCode
    folder: Path | None
    records: int
    duration: float
    unconfirmed: str | None = None
    by_hand: str | None = None
    warnings: tuple[RunWarning, ...] = ()
    test: Judgement | None = None

    def __repr__(self) -> str:
        return one_line(self, self.summary())

    def summary(self) -> str:
        """One line for the terminal."""
        reason = f": {self.reason}" if self.reason else ""
        if self.folder is None:
            return f"{self.status}{reason}"
        counted = number_of(self.records, "record")
        return f"{self.folder.name} {self.status}, {counted}{reason}"


def run(
    plan: Plan,
    backend: Backend,
    writer: Recorder,
    *,
    operator: Operator,
    control: Control | None = None,
    controls: Sequence[Control] = (),
    observer: Observer | None = None,
    dry: bool = False,
    resume_from: Resume | None = None,
    response: float = RESPONSE,
) -> RunResult:
    """Carry out a plan on an open bench; closes bench and data, however it ends.

    Parameters
    ----------
    writer: a `rigctl.dataset.RunWriter`, or `Unrecorded` for moving a bench by hand.
    operator: who answers when the procedure asks.
    control, controls: sources of requests besides signals and the run's control file: a keyboard, a test.
    observer: called about ten times a second with the state of the run.
    dry: arm and read, but move nothing.
    resume_from: what earlier sessions have completed.
    response: s of wall time between two checks for requests.
    """
    # Signals are handled until data are closed: Ctrl-C while Parquet is written must not leave a run half
    # closed.
    with Signals() as signals:
        session = _Session(plan, backend, writer, operator, resume_from)
        session.watched_by([*controls, *([control] if control is not None else [])], observer)
        ending = session.carry_out(signals, response, dry=dry)
        return session.close(ending)


class _Session:
    """The parts of one run, and the order in which they are used."""

    def __init__(
        self, plan: Plan, backend: Backend, writer: Recorder, operator: Operator, resume: Resume | None
    ) -> None:
        self._plan = plan
        # A simulation takes one plant for the whole bench: its rows come from one device, so that the rig is
        # seen as one without devices, with all its channels.
        rig = plan.rig if isinstance(backend, Combined) else plan.rig.undivided
        self._backend = backend
        self._writer = writer
        self._resume = resume or Resume(frozenset())
        self._bench = Bench(rig, backend, writer, operator, history_for(plan, rig))
        # A resumed run knows what earlier sessions measured: conditions may refer to it, and the verdict
        # covers all.
        self._bench.missed += self._resume.missed
        for name, (value, unit, difference) in self._resume.values.items():
            self._bench.keep(name, value, unit, difference=difference)
        self._lifecycle = Lifecycle(self._state_changed)
        self._interlocks = Interlocks(rig)
        self._sampling = Sampling(self._bench, self._interlocks, self._secure)
        self._progress = progress_of(plan)
        self._progress.records_done = len(self._resume.completed)
        self._walker = Walker(
            self._bench,
            self._progress,
            self._sampling,
            secure=self._secure,
            finish=lambda: self._lifecycle.send("finish"),
            completed=self._resume.completed,
        )
        self._controls: list[Control] = []
        # Requests from other terminals come through a file in the run's folder; moving by hand has none.
        if writer.folder is not None:
            self._controls.append(beside(ControlFile(writer.folder), backend.clock))
        self._observer: Observer | None = None
        self._watching: Watching | None = None
        self._secured: Ending | None = None
        self._first: Ending | None = None
        self._message = ""

    def watched_by(self, controls: Sequence[Control], observer: Observer | None) -> None:
        """Add sources of requests and the observer."""
        self._controls += controls
        if observer is not None and math.isfinite(self._backend.clock.speed):
            observer = self._watching = Watching(observer)
        self._observer = observer

    def carry_out(self, signals: Signals, response: float, *, dry: bool) -> Ending | None:
        """Arm and walk the plan; returns what ended it early, or None. Outputs are safe when this returns."""
        steps = self._walker.plan(self._plan)
        driver = Driver(
            self._bench,
            self._sampling,
            self._lifecycle,
            signals,
            self._controls,
            secure=self._secure,
            tick=self._tick,
            response=response,
        )
        ending: Ending | None = None
        try:
            # 1. Read the bench and check the interlocks; nothing moves before all channels were seen to be in
            #   order.
            self._lifecycle.send("arm")
            self._arm(driver)
            # 2. Walk the plan. What ends it early arrives here only after the cleanup blocks, which the
            #   walker has run.
            if dry:
                self._lifecycle.send("finish")
            else:
                self._lifecycle.send("start")
                driver.drive(steps, self._walker)
        except Quit:
            # Somebody did not wait for cleanup; the reason of the run is still what ended it first.
            ending = self._first or Aborted(f"ended by {signals.name}", exit_code=signals.exit_code)
        except Exception as error:  # noqa: BLE001 - nothing may keep the outputs from becoming safe
            ending = ending_for(error, self._bench)
        # An ending from before the walk, such as a limit exceeded when arming, may not have been through
        # `_secure`.
        if ending is not None and self._first is None:
            self._secure(ending)
        # 3. Closing the generator runs its `finally` blocks (record closed, question withdrawn). One that
        #   yields again raises RuntimeError here, which is not of interest any more.
        with suppress(Exception):  # closes what a second signal left open; the outputs are already safe
            steps.close()
        # 4. Safe again, whatever cleanup blocks have done. This is the only time for a run that ended well.
        self._bench.make_safe("end of the run")
        self._retry_safe_state(signals)
        return ending

    def _retry_safe_state(self, signals: Signals) -> None:
        """Try to reach a bench that could not be made safe, for a short time or until a further signal."""
        bench, before = self._bench, signals.count
        give_up = bench.now + LAST_TRY
        # `next_sample` also drives the search for a lost bench, see `rigctl.backends.transport.reconnection`;
        # nothing else would. Samples that come meanwhile belong to the run, but trip nothing any more.
        while bench.unconfirmed is not None and bench.now < give_up and signals.count == before:
            try:
                sample = self._backend.next_sample(min(RESPONSE * self._backend.clock.speed, 0.5))
                if sample is not None:
                    self._sampling.keep(sample)
            except Exception as error:  # noqa: BLE001 - nothing may keep the run from being closed
                bench.event("fault", f"the bench is not looked for any longer: {error}")
                return
            bench.make_safe("end of the run")

    def close(self, ending: Ending | None) -> RunResult:
        """Close the bench and the data, and report the result."""
        # The bench is asked for the last time before it is closed; after that nothing can confirm an output.
        duration = self._bench.now
        # The order from here on: what is unconfirmed is settled and logged while the log is open; the backend
        # is closed before the data, so that no bench has to be kept alive while the journal is converted; the
        # state changes to its last value before the log is closed, since that is an event of it.
        status, event, reason, code = self._verdict(ending)
        unconfirmed, by_hand = self._unconfirmed, None
        if unconfirmed is not None:
            by_hand = f"switch it off by hand, at its supply; {self._backend.without_host}"
            message = f"OUTPUTS NOT CONFIRMED SAFE: {unconfirmed} may still be on: {by_hand}"
            reason = f"{reason}. {message}" if reason else message
            code = ExitCode.FAILED
            if status == "finished":
                status, event = "failed", "fail"
            self._bench.event("fault", message)
        warnings = (*self._sampling.warnings, *self._warn_of_trust())
        try:
            self._backend.close()
        except Exception as error:  # noqa: BLE001 - the data have to be closed whatever happens to the bench
            self._bench.event("fault", f"the bench could not be let go: {str(error) or repr(error)}")
        self._message = reason or ""
        self._lifecycle.send(event)
        try:
            self._writer.close(status, reason, unconfirmed)
        except Exception as error:  # noqa: BLE001 - how the run ended is reported whatever happens to its data
            why = str(error) if isinstance(error, RigctlError) else f"the data could not be closed: {error!r}"
            message = reason or ""  # a full disk is reported once
            reason = message if why in message else "; ".join(filter(None, (message, why)))
            status, code = "failed" if status == "finished" else status, code or ExitCode.FAILED
        # Only the tables tell whether all samples arrived on the disk: a run that ended well may still lack
        # some.
        damage = _damaged(self._writer.folder) if reason is None else None
        if damage is not None:
            reason, code = damage, ExitCode.FAILED
        # Observers and other terminals see the final state, and what closing has found, before they are
        # closed.
        self._tick()
        for control in self._controls:
            with suppress(Exception):
                control.close()
        if self._watching is not None:
            self._watching.close()
        records, folder = self._progress.records_done, self._writer.folder
        test = _judged(folder)
        return RunResult(
            status, reason, code, folder, records, duration, unconfirmed, by_hand, warnings, test
        )

    @property
    def _unconfirmed(self) -> str | None:
        """The outputs that may still be on at the end of the run; None if all are confirmed to be safe."""
        found = filter(None, (self._bench.unconfirmed, self._bench.never_confirmed))
        return ", ".join(found) or None

    def _warn_of_trust(self) -> Iterator[RunWarning]:
        """Warn of outputs that should be on in the safe state, where nothing shows whether they are."""
        trusted = self._bench.safe_on_trust
        if trusted is not None:
            message = f"nothing confirms the safe state of these outputs: {trusted}; check them"
            self._bench.event("note", message)
            self._sampling.note(self._bench.now, "note", message)
            yield RunWarning(self._bench.now, -1, message)

    def _arm(self, driver: Driver) -> None:
        """Read the bench and check the interlocks before anything moves.

        Raises
        ------
        RigctlError
            the bench cannot carry out a step.
        Tripped
            a limit is exceeded already.
        """
        bench = self._bench
        # First what needs no sample: a step that this bench cannot carry out.
        _refuse_impossible(self._plan, bench)
        bench.start(bench.rig.monitor_rate)
        try:
            # Through the driver, so that a signal or a request ends arming too.
            rows = driver.watch((_ARMING_SAMPLES - 1) / bench.rate)
            # a bench, or one of its devices, that stays silent trips the interlock for silence
            while bench.read_at.keys() < bench.rig.parts.keys():
                rows = driver.watch(1.0 / bench.rate) or rows[-1:]
            if bench.rig.devices:  # rows before a slow device's first reading lack its channels
                rows = driver.watch((_ARMING_SAMPLES - 1) / bench.rate) or rows[-1:]
        except Tripped as tripped:
            tripped.reason = f"not armed: {tripped.reason}"
            raise
        devices = self._backend.devices if isinstance(self._backend, Combined) else {"": self._backend}
        # Only now it is known how long a device really takes to answer; a record at a rate that it cannot
        # keep is refused before anything moves.
        for name, device in devices.items():
            if isinstance(device, Polled):
                refuse_slow_answers(self._plan, device.sample_takes, name)
        # The commands in force are the last columns of the newest row; from here on receipts keep them up to
        # date.
        first = len(bench.rig.layout.columns) - len(bench.rig.layout.commands)
        bench.commanded = dict(zip(bench.rig.layout.commands, rows[-1][first:], strict=True))
        alarms = self._interlocks.check_arming(rows)
        if alarms:
            raise Tripped("not armed: " + "; ".join(alarm.message for alarm in alarms))

    def _secure(self, ending: Ending) -> None:
        """Make outputs safe, first of all and once for each ending."""
        if ending is self._secured:
            return
        self._secured = ending
        self._bench.make_safe(ending.reason)
        # Lost samples make outputs safe, but do not end the run: its record is measured again. The state
        # stays as it is, and a later ending is the first.
        if not isinstance(ending, SamplesLost):
            # The first ending is the reason of the run; those that follow in its cleanup are notes in the
            # log.
            self._first = self._first or ending
            self._message = self._first.reason
            # Both transitions at once, as the outputs are safe already. In cleanup a second trip passes
            # through SAFE again.
            self._lifecycle.send("make_safe")
            self._lifecycle.send("clean_up")
            self._tick()  # 'rigctl off' waits for it

    def _verdict(self, ending: Ending | None) -> tuple[str, str, str | None, ExitCode]:
        """Status, event of the state machine, reason, exit code."""
        # A missed measure is no ending: the run has finished, and its exit code says that the device has not
        # passed.
        if ending is None:
            if missed := self._bench.missed:
                more = f", and {len(missed) - 1} more" if len(missed) > 1 else ""
                reason = f"a measure lay outside its limits: {missed[0]}{more}"
                return "finished", "succeed", reason, ExitCode.FAILED
            return "finished", "succeed", None, ExitCode.DONE
        if ending.aborted:
            # A signal brings its own exit code; a key or a request has none.
            code = ending.exit_code if ending.exit_code is not ExitCode.FAILED else ExitCode.INTERRUPTED
            return "aborted", "abort", ending.reason, code
        location = f"{ending.where}: " if ending.where is not None and ending.where.line else ""
        return "failed", "fail", f"{location}{ending.reason}", ending.exit_code

    def _state_changed(self, before: RunState, event: str, after: RunState) -> None:
        bench = self._bench
        bench.event("state", f"{before.value} → {after.value}", state=after.value, event=event)
        self._sampling.note(bench.now, "state", after.value)
        self._sampling.running = after in (RunState.RUNNING, RunState.PAUSED)

    def _tick(self) -> None:
        """Call the observer; one that fails is not called again."""
        # What the disk thread has noticed is fetched and logged here, on the thread that logs every other
        # event.
        for text in self._writer.warnings():
            self._bench.event("note", text)
            self._sampling.note(self._bench.now, "note", text)
        if self._observer is None and not self._controls:
            return
        view = self._view()
        for control in self._controls:
            control.publish(view)
        if self._observer is not None:
            try:
                self._observer(view)
            except Exception as error:  # noqa: BLE001 - a display must not end a run
                self._observer = None
                if not self._lifecycle.state.ended:
                    self._bench.event("note", f"the display failed and is off: {error!r}")

    def _view(self) -> View:
        bench, progress, now = self._bench, self._progress, self._bench.now
        newest: Sequence[float] = bench.newest or ()
        question = f"{bench.question} {bench.operator.typed}".rstrip() if bench.question else None
        return View(
            run=self._writer.id,
            state=self._lifecycle.state.value,
            time=now,
            path=bench.path,
            label=progress.label,
            record=self._writer.record,
            records_done=progress.records_done,
            records_total=progress.records_total,
            progress=progress.share(now),
            time_left=progress.remaining(now),
            values=dict(zip(bench.rig.layout.channels, newest[2:], strict=False)),
            commands=dict(bench.commanded),
            alarms=tuple(self._sampling.alarms.values()),
            happenings=tuple(self._sampling.happenings),
            question=question,
            asked=str(bench.question) if bench.question else None,
            remote=isinstance(bench.operator, RemoteOperator),
            message=self._message,
            unconfirmed=bench.unconfirmed if self._secured is None else self._unconfirmed,
        )


def _refuse_impossible(plan: Plan, bench: Bench) -> None:
    """Refuse a step that this bench cannot carry out; raises `RigctlError` with its location."""
    for node in all_nodes(plan):
        if isinstance(node, Leaf) and (refused := node.action.refusal(bench)) is not None:
            raise refused.at(node.where)


def _damaged(folder: Path | None) -> str | None:
    """What the files of a run that finished lack; None if they are complete, or there are none."""
    if folder is None:
        return None
    try:
        reason: str | None = read_info(folder).get("reason")
    except RigctlError as error:
        return str(error)
    return reason


def _judged(folder: Path | None) -> Judgement | None:
    """The result of the device's test in the run's log; None if no log can be read."""
    if folder is None:
        return None
    try:
        result = read_info(folder)["test"]
        if not result["passed"] and not result["missed"]:
            return Judgement(result["result"], ())
        return judge(read_history(folder))
    except (RigctlError, KeyError):  # not closed: the disk is full or gone
        return None
