"""The loop: measure, compare, add what is certain, design the next records, ask, and measure again.

In: a task and its rounds so far on disk (`LearningFolder`), a bench, and whoever is asked. Out: `Learned`:
the rounds, why the loop ended, and the model's last version. It adds only what a diagnosis is certain of,
and stops adding where the bench contradicts a prediction: the loop must not explain away what it does not
understand. Nothing is kept in memory that is not on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.analysis.comparison import compare
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.fitting import OnProgress
from rigctl.analysis.improve import Improvement, improve
from rigctl.dataset import Run, find_run, open_run
from rigctl.design.design import design_experiment
from rigctl.design.precision import relative_width
from rigctl.design.refusals import NothingLeft, NothingToSet, TooLittleTime
from rigctl.design.result import HALF, DesignResult
from rigctl.discovery.gate import gate_of
from rigctl.errors import ExitCode, RigctlError
from rigctl.learning.bench import LearningBench, seconds_of
from rigctl.learning.ending import LearningEnd
from rigctl.learning.learning_folder import LearningFolder
from rigctl.learning.predicted_and_achieved import prediction_of, round_outcome
from rigctl.learning.result import Learned, Reason, Round, RoundOutcome
from rigctl.model import current_version, load_model, versions
from rigctl.plan import Plan

#: called before a round with what would be measured, and why; returns whether to carry it out
Ask = Callable[[Round, DesignResult], bool]
#: a round is not worth the bench time if no interval shrinks to less than this share
_NOTICEABLY = 0.95


@dataclass
class Learner:
    """A learning loop, resumable from disk.

    Every step is on disk before the next one starts: a run that was carried out is not repeated, and a
    proposal that was made is put to the user again.

    Parameters
    ----------
    kept: the task, and the rounds so far.
    bench: where rounds are measured.
    runs: the folder of the runs.
    ask: called before each designed round.
    working: a context manager entered around each phase of analysis, called with its description; runs and
        questions have the terminal to themselves.
    on_round: called with each round that has been judged.
    designer: designs the next records.
    worth: least predicted probability for a round to be proposed.
    """

    kept: LearningFolder
    bench: LearningBench
    runs: Path
    ask: Ask
    working: Callable[[], AbstractContextManager[OnProgress]] = lambda: nullcontext(lambda _: None)
    on_round: Callable[[Round], None] = lambda _: None
    designer: Callable[..., DesignResult] | None = None
    worth: float = HALF

    def learn(self) -> Learned:
        """Continue until there is no further round.

        Raises
        ------
        RigctlError
            the procedure, the model or the bench is wrong; or a file cannot be written.
        """
        task = self.kept.task
        if not self.kept.rounds:
            self.kept.begin(Round(1, task.procedure, answer="yes"))
        while True:
            # Each turn continues from what is on disk, whether it was written a second ago or before a power
            # cut: a proposal without an answer is made again, a round with a run is not measured again, a
            # round with a verdict keeps it.
            current = self.kept.rounds[-1]
            if current.answer != "yes":  # a proposal made before learning was interrupted
                self.kept.rounds.pop()
                current = self.kept.rounds[-1]
            if not current.run and not (current.number == 1 and task.runs):
                ended = self._measure(current)
                if ended is not None:
                    return self.kept.close(ended)
                current = self.kept.rounds[-1]
            # Measured: all runs so far are diagnosed together, and what is certain is added.
            judged, improved = self._judge(current)
            ended = self._next(judged, improved)
            if ended is not None:
                return self.kept.close(ended)

    # --- one round ------------------------------------------------------------------------------------------

    def _measure(self, current: Round) -> Learned | None:
        """Carry out a round's procedure; return how learning ended if the run did not finish."""
        task = self.kept.task
        arguments = task.arguments if current.number == 1 else {}
        plan = self.bench.plan(Path(current.procedure), arguments)
        if current.number == 1 and not current.lost:
            require_time(plan, task.budget)
        elif current.lost and self._time_left is not None and seconds_of(plan) > self._time_left:
            return self._ended(LearningEnd.BUDGET, current)  # it failed, and there is no time for it again
        result = self.bench.measure(plan, current.number, self.kept.folder.name)
        if result.folder is None or result.status != "finished":
            self.kept.update(replace(current, lost=current.lost + result.duration))
            stopped = self._ended(LearningEnd.STOPPED, result)
            return replace(stopped, exit_code=result.exit_code or ExitCode.FAILED)
        self.kept.update(replace(current, run=result.folder.name, duration=result.duration))
        return None

    def _judge(self, current: Round) -> tuple[Round, Improvement]:
        """Compare and diagnose on all runs so far, add what is certain, and compare with the prediction."""
        task = self.kept.task
        path = Path(task.model)
        with self.working() as on_progress:
            on_progress(f"Round {current.number}: comparing")
            # From the model's current version, which has what earlier rounds added. If the bench contradicts
            # the prediction of this round, nothing is added: it is not the bench that was asked.
            compared = compare(
                self._open_runs(),
                [load_model(path)],
                hold_out=task.hold_out or None,
                on_progress=on_progress,
            )
            improved = improve(
                compared,
                path,
                sure=True,
                unless=lambda diagnosis: not current.judged and self._contradicted(current, diagnosis),
                on_progress=on_progress,
            )
        if current.judged:  # judged before the interruption: that result stays
            return current, improved
        first, now = improved.first, improved.last.before.fit
        judged = replace(
            current,
            verdict=first.verdict.value,
            effects=first.effects,
            classes=first.classes or ((first.instead_of_sensors,) if first.instead_of_sensors else ()),
            probabilities={one.effect: one.probability for one in first.ranking if one.probability > 1e-3},
            added=self._added(path),
            error={name: error.nrmse for name, error in now.errors.items()},
            chi2=now.chi2_reduced,
            statement=first.statement,
            achieved=self._outcome(current, first),
        )
        self.kept.update(judged)
        self.on_round(judged)
        return judged, improved

    def _outcome(self, current: Round, diagnosis: Diagnosis) -> RoundOutcome | None:
        """The outcome of a round compared with its prediction; None if there was none."""
        if current.predicted is None:
            return None
        before = self.kept.rounds[-2] if len(self.kept.rounds) > 1 else current
        classes = {name for names in before.classes for name in names}
        return round_outcome(current.predicted, diagnosis, classes)

    def _contradicted(self, current: Round, diagnosis: Diagnosis) -> bool:
        """Whether the bench contradicted all predictions: then it is not the bench of the question, or
        its behaviour is unknown, and nothing is added to the model for it."""
        achieved = self._outcome(current, diagnosis)
        return achieved is not None and not achieved.kept

    def _added(self, path: Path) -> tuple[tuple[str, int], ...]:
        """The effects in the model's versions since the last round, including after an interruption."""
        known = max(
            (number for one in self.kept.rounds for _, number in one.added), default=self.kept.task.version
        )
        return tuple(
            (name, version.number)
            for version in versions(path)
            if version.number > known and version.done.kind == "add"
            for name in version.done.effect.split(", ")
        )

    def _next(self, judged: Round, improved: Improvement) -> Learned | None:
        """Propose the next round and ask for it; return how learning ended if there is none."""
        last = improved.last
        # Reasons to end, in this order: the question is answered or cannot be; rounds or time are used up; no
        # record is worth its bench time.
        ended = self._settled(judged, last) or self._exhausted(judged)
        if ended is not None:
            return ended
        try:
            design = self._design(last, judged.number)
        except TooLittleTime as problem:
            return self._ended(LearningEnd.BUDGET, problem)
        except (NothingToSet, NothingLeft) as problem:
            sensors = problem.sensors if isinstance(problem, NothingToSet) else ()
            return self._ended(_without_records(last), problem, sensors)
        promising = bool(design.records) and design.after >= self.worth
        if promising and (design.aim != "precision" or _sharpens(design)):
            return self._proposed(design)
        tells = design.sensor is not None and design.sensor.probability >= HALF
        channels = design.sensor.channels if design.sensor is not None and tells else ()
        return self._ended(_without_records(last), design, channels)

    def _exhausted(self, judged: Round) -> Learned | None:
        """How learning ended if no further round is allowed."""
        if judged.number >= self.kept.task.rounds:
            return self._ended(LearningEnd.ROUNDS, judged)
        if self._time_left is not None and self._time_left <= 0.0:
            return self._ended(LearningEnd.BUDGET, judged)
        return None

    def _design(self, last: Diagnosis, number: int) -> DesignResult:
        """The next records; with a sensor that the bench could have if no record suffices."""
        with self.working() as on_progress:
            on_progress("Designing the next records")
            return (self.designer or design_experiment)(
                self._open_runs(),
                last.before.fit.problem.model,
                budget=self._time_left,
                precise=self._to_be_sized(last) if _adequate_alone(last) else (),
                seed=number,
                hold_out=self.kept.task.hold_out or None,
                diagnosis=last,
                on_progress=on_progress,
            )

    @property
    def _time_left(self) -> float | None:
        budget = self.kept.task.budget
        return None if budget is None else budget - self.kept.spent

    def _proposed(self, design: DesignResult) -> Learned | None:
        number = self.kept.rounds[-1].number + 1
        proposal = self.kept.begin(Round(number, "", predicted=prediction_of(design)), design.procedure)
        yes = self.ask(proposal, design)
        self.kept.update(replace(proposal, answer="yes" if yes else "no"))
        if yes:
            return None
        return self._ended(LearningEnd.DECLINED, proposal)

    def _settled(self, judged: Round, last: Diagnosis) -> Learned | None:
        """How learning ended if no further record is worthwhile."""
        if _adequate_alone(last) and not last.doubt:
            vague = bool(self._to_be_sized(last))
            return None if vague else self._ended(LearningEnd.ADEQUATE, last)
        if last.doubt:
            return self._ended(LearningEnd.NOT_DECIDED, last)
        if judged.achieved is not None and not judged.achieved.kept:
            return self._ended(LearningEnd.OUTSIDE_LIBRARY, judged)
        if last.instead_of_sensors:
            return None  # records may tell an effect from an error of a sensor
        if gate_of(last).open and not self._may_yet_predict(last):
            return self._ended(LearningEnd.OUTSIDE_LIBRARY, last)
        return None

    def _may_yet_predict(self, last: Diagnosis) -> bool:
        """Whether more records may settle what is missing: one more round is made for a named effect that
        failed cross-validation, as that may be for lack of records in which it is visible."""
        targets = {
            name
            for one in self.kept.rounds
            if one.judged and one.predicted is not None and one.predicted.aim == "precision"
            for rival in one.predicted.rivals
            for name in rival.split(" + ")
        }
        return bool(last.unconfirmed) and not set(last.unconfirmed) <= targets

    def _to_be_sized(self, last: Diagnosis) -> tuple[str, ...]:
        """The effects whose size is not yet known with the requested precision: those that were added or, if
        none was, all that the model has."""
        wanted, model = self.kept.task.precision, last.before.fit.problem.model
        if wanted is None:
            return ()
        added = {name for one in self.kept.rounds for name, _ in one.added}
        return tuple(
            name
            for name in model.effects
            if (name in added or not added) and relative_width(last.before.fit, [name]) > wanted
        )

    # --- common to all rounds -------------------------------------------------------------------------------

    def _open_runs(self) -> list[Run]:
        return [open_run(find_run(name, self.runs)) for name in self.kept.runs]

    def _ended(self, why: LearningEnd, because: Reason, sensor: tuple[str, ...] = ()) -> Learned:
        rounds = tuple(self.kept.rounds)
        version = current_version(Path(self.kept.task.model)).number
        return Learned(rounds, why, self.kept.task.model, version, self.kept.spent, because, sensor)


def _adequate_alone(last: Diagnosis) -> bool:
    """Whether the model agrees, and no effect may explain what errors of sensors explain."""
    return last.verdict is Verdict.ADEQUATE and not last.instead_of_sensors


def _without_records(last: Diagnosis) -> LearningEnd:
    """How learning ends if no record that this bench can make is worth taking."""
    if _adequate_alone(last):
        return LearningEnd.ADEQUATE
    return LearningEnd.OUTSIDE_LIBRARY if gate_of(last).open else LearningEnd.NOT_SEPARABLE


def _sharpens(design: DesignResult) -> bool:
    """Whether records noticeably improve the estimate of a size."""
    return any(one.after < _NOTICEABLY * one.before for one in design.sharpened)


def require_time(plan: Plan, budget: float | None) -> None:
    """Refuse a first round that takes longer than the budget of all rounds.

    Raises
    ------
    RigctlError
        it is too long.
    """
    seconds = seconds_of(plan)
    if budget is not None and seconds > budget:
        raise RigctlError(
            "the budget is too small for the first round",
            value=f"{budget / 60.0:.3g} min",
            expected=f"at least {seconds / 60.0:.3g} min of bench time",
        )
