"""Design the next experiment for a model on its runs.

In: runs and a model, or a diagnosis of them. Out: a `DesignResult`: records that the bench can make, in the
order in which to take them, with their predicted power and the procedure. The explanations that a diagnosis
leaves are linearised at their fits (`information_so_far`), a search finds records that the rig can make
(`search`), and their power is predicted over draws from the posteriors (`assurance`). The linear problem
finds, draws and refits judge: where they contradict it, the search is repeated with what they show.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.fitting import OnProgress, no_progress
from rigctl.dataset.run import Run
from rigctl.design.assurance import DRAWS, Draws, PredictedResult, as_refitted, predicted_result
from rigctl.design.criterion import Criterion, Detection, Discrimination, Precision
from rigctl.design.information import Evidence
from rigctl.design.information_so_far import Known, known_so_far
from rigctl.design.precision import half_width, unit_of
from rigctl.design.procedure_text import Writer, called_so_far
from rigctl.design.recipe import Stage, lines_of
from rigctl.design.refitted_gain import TAKEN_UP
from rigctl.design.refusals import NothingLeft, NothingToSet, TooLittleTime
from rigctl.design.result import (
    HALF,
    DesignResult,
    PrecisionGain,
    PredictedPower,
    Prediction,
    ProposedRecord,
)
from rigctl.design.rig_file import rig_reference
from rigctl.design.rig_time import Ordered, RigTime, forecast
from rigctl.design.rival_models import question_between
from rigctl.design.rivals import Basis, Question, nothing_left, question_of, require_names
from rigctl.design.scheme import schemes_of, stage_of
from rigctl.design.search import Proposal, Search, Workshop, first_candidates, together
from rigctl.design.sensors import best_sensor, sensor_sets, unknown_sensors
from rigctl.design.table_rows import design_rows
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.model import Model
from rigctl.notebook import worded
from rigctl.rig.rig import Rig
from rigctl.tasks import Workers
from rigctl.units import parse_unit, significant

#: default number of records in a set
MOST_RECORDS = 4
#: for records at random, largest number of candidates tried for each
_TRIES = 50
_OF_TABLES = "For a table, rows are designed to distinguish effects; 'rigctl diagnose' says what else to do"


@one_thread()
def design_experiment(
    runs: Sequence[Run],
    model: Model,
    *,
    others: Sequence[Model] = (),
    budget: float | None = None,
    records: int | None = None,
    separate: tuple[str, str] | None = None,
    precise: Collection[str] = (),
    sensors: bool = False,
    seed: int = 0,
    hold_out: str | None = None,
    only: str | None = None,
    excluded: Collection[str] = (),
    diagnosis: Diagnosis | None = None,
    workers: Workers | None = None,
    on_progress: OnProgress | None = None,
) -> DesignResult:
    """What to measure next to distinguish the explanations that a diagnosis leaves.

    Parameters
    ----------
    others: further models: which of all of them is right is then the question, and no effect is looked for.
    budget: of bench time, s; without one only `records` limits the design.
    records: largest number of records; `MOST_RECORDS` by default.
    separate: the names of two effects to be distinguished, instead of all that the diagnosis leaves.
    precise: effects of the model whose sizes are to be estimated better, instead.
    sensors: also consider the channels that the bench could have.
    seed: of candidates and draws: the same seed gives the same design.
    hold_out, only, excluded: as in `rigctl.analysis.diagnosis.diagnose`.
    diagnosis: of the same model on the same runs, if already made.
    workers: processes that simulate candidates and refit rivals; the design does not depend on them. By
        default this process, on all its cores.

    Raises
    ------
    RigctlError
        nothing is left to be distinguished, or a name is unknown; the budget is too small for any record; the
        bench's conditions cannot be set.
    """
    report = on_progress or no_progress
    if others and (separate is not None or precise):
        raise RigctlError("effects are distinguished in one model", expected="a single model, or no effects")
    if separate is not None:
        require_names(model, separate)
    # 1. What is open. The diagnosis gives the rivals and the aim: discrimination, detection, or precision. Of
    # several models the question is which one is right.
    if others:
        basis, question = question_between(
            runs, [model, *others], hold_out=hold_out, only=only, on_progress=report
        )
    else:
        diagnosed = diagnosis or diagnose(
            runs, model, hold_out=hold_out, only=only, excluded=excluded, on_progress=report
        )
        basis, question = Basis.of(diagnosed), question_of(diagnosed, separate, precise)
    measured = question.rivals[0].fit.problem.measurements
    if measured.table:
        if question.aim != "discrimination":
            raise nothing_left(diagnosed, _OF_TABLES)
        return design_rows(basis, question, records or MOST_RECORDS)
    rig = measured.rig
    assert rig is not None  # noqa: S101 - data with a course in time are of a bench
    report(f"Designing for {', '.join(one.name for one in question.rivals)}")
    # 2. What the data so far say of every rival, and what the bench can do.
    design = _Design.on(question, rig, rig_reference(runs, rig), seed, workers)
    try:
        chosen = design.chosen(records or MOST_RECORDS, budget, report)
    except NothingToSet as error:
        raise design.sensor_instead(error) from None
    # 3. The predicted power of the chosen records, by draws and refits, and the answer for the user.
    result = design.result(basis, chosen)
    if not sensors and (result.separable or result.aim != "discrimination"):
        return result
    report("Evaluating the sensors that the bench could have")
    return design.with_sensors(result, chosen)


@one_thread()
def random_experiment(
    runs: Sequence[Run], diagnosis: Diagnosis, *, records: int = MOST_RECORDS, seed: int = 0
) -> DesignResult:
    """Records at random points of all that the bench can do, and their predicted power: a design's baseline.

    They keep the same distance from every limit as designed ones.

    Raises
    ------
    RigctlError
        nothing is left to be distinguished, or the bench's conditions cannot be set.
    """
    question = question_of(diagnosis)
    rig = question.rivals[0].fit.problem.measurements.rig
    assert rig is not None  # noqa: S101 - data with a course in time are of a bench
    design = _Design.on(question, rig, rig_reference(runs, rig), seed)
    return design.result(Basis.of(diagnosis), design.at_random(records))


def with_next_experiment(
    diagnosis: Diagnosis, runs: Sequence[Run], *, seed: int = 0, on_progress: OnProgress | None = None
) -> tuple[Diagnosis, DesignResult | None]:
    """A diagnosis with its `next_experiment`, and the design; unchanged, with None, if nothing is left.

    Raises
    ------
    RigctlError
        the bench's conditions cannot be set.
    """
    model = diagnosis.before.fit.problem.model
    try:
        design = design_experiment(runs, model, diagnosis=diagnosis, seed=seed, on_progress=on_progress)
    except NothingLeft:
        return diagnosis, None
    return replace(diagnosis, next_experiment=design.next_experiment()), design


@dataclass
class _Design:
    """Everything on which a search and its prediction rest."""

    question: Question
    known: Known
    stage: Stage
    writer: Writer
    criterion: Criterion
    workshop: Workshop
    draws: Draws
    seed: int
    pool: list[Proposal] = field(default_factory=list)
    first: tuple[Evidence, ...] = ()

    @classmethod
    def on(
        cls, question: Question, rig: Rig, reference: str, seed: int, workers: Workers | None = None
    ) -> _Design:
        """The design for a question, on the data to which the rivals were fitted."""
        known = known_so_far(question.rivals)
        fit = question.rivals[0].fit
        stage = stage_of(fit, rig)
        writer = Writer(rig, reference, called_so_far(fit.problem.records, stage))
        criteria: dict[str, type[Discrimination | Detection | Precision]] = {
            "discrimination": Discrimination,
            "detection": Detection,
            "precision": Precision,
        }
        criterion = criteria[question.aim](question, known)
        workshop = Workshop(question.rivals, known, stage, workers)
        draws = Draws(known, workshop, seed, DRAWS)
        return cls(question, known, stage, writer, criterion, workshop, draws, seed)

    @property
    def clock(self) -> RigTime:
        """The rig's clock."""
        return RigTime(self.stage.rig)

    def chosen(self, records: int, budget: float | None, report: OnProgress) -> list[Proposal]:
        """The records, in the order in which they are to be taken.

        Raises
        ------
        RigctlError
            nothing sets the bench's conditions, or the budget is too small for any record.
        """
        # Candidates are simulated once, with every rival; the search afterwards adds up their information,
        # which costs hardly anything. So the set may be searched several times: by worth per minute and by
        # worth alone, without records that a limit or the rig refuses, and again if refits show that the
        # linear distances were an illusion.
        workshop = self.workshop
        schemes = schemes_of(self.stage, self.question.rivals[0].fit.problem.records)
        report("Simulating candidates with every rival")
        self.pool = first_candidates(workshop, schemes, self.seed)
        self.first = tuple(one.evidence for one in self.pool)
        self._require_time(budget)
        report("Improving the best records")
        limit = math.inf if budget is None else budget
        search = Search(workshop, self.criterion, self.clock, self.pool, records, limit)
        proposals = self._acceptable(replace(search, per_minute=self._cheap_enough(search)))
        # What a rival absorbs in these records by moving far, it absorbs in records like them: the criterion
        # counts the share that is left, and other kinds of records come to the front.
        if self._refit(proposals):
            report("Searching again, with what a rival absorbs in the records left out")
            search = replace(search, criterion=self.criterion)
            proposals = self._acceptable(replace(search, per_minute=self._cheap_enough(search)))
            self._refit(proposals)
        return self._in_order(proposals)

    def _in_order(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """The records in the order that takes the least bench time."""
        order = self.clock.quickest([one.recipe for one in proposals]).order if proposals else ()
        return self.workshop.one_after_the_other([proposals[k] for k in order])

    def at_random(self, records: int) -> list[Proposal]:
        """Records at random points of all schemes; fewer if hardly any keep clear of the limits."""
        schemes = schemes_of(self.stage, self.question.rivals[0].fit.problem.records)
        rng = np.random.default_rng(self.seed)
        proposals: list[Proposal] = []
        for _ in range(_TRIES * records):
            scheme = schemes[int(rng.integers(len(schemes)))]
            (proposal,) = self.workshop.propose([(scheme, rng.uniform(size=len(scheme.free)).tolist())])
            if proposal is not None and not self._refused([proposal]):
                proposals.append(proposal)
            if len(proposals) == records:
                break
        self._refit(proposals)
        return self._in_order(proposals)

    def _refit(self, proposals: Sequence[Proposal]) -> bool:
        """Reduce the distances to those left by an actual refit; return whether they are far less than
        expected."""
        if not isinstance(self.criterion, Discrimination):
            return False
        self.criterion = as_refitted(self.criterion, self.draws, proposals, self.workshop.workers)
        return min(self.criterion.reach.values(), default=1.0) < TAKEN_UP

    def _cheap_enough(self, search: Search) -> bool:
        """Whether the records with the most worth per minute suffice; else the most informative are taken."""
        if isinstance(self.criterion, Precision):
            return True
        cheap, telling = (
            self._predicted_probability(replace(search, per_minute=one, exchange=False).best_set())
            for one in (True, False)
        )
        # among sets that reach less, the most informative one is chosen, however long it takes
        return cheap >= HALF or cheap >= telling

    def _acceptable(self, search: Search) -> list[Proposal]:
        """The best set of records that keep clear of every limit for every draw, and that the rig accepts."""
        # Limits at the draws are tested here, for the chosen few: for every candidate they would cost a
        # hundred simulations with each rival. A refused record is taken out, and the set is searched anew.
        while True:
            proposals = search.best_set()
            refused = self._refused(proposals)
            if not refused:
                return proposals
            search = search.without(refused)

    def _refused(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """Records that come near a limit for some draw, or that the rig does not accept."""
        return [
            one
            for one in proposals
            if not self.draws.keeps_clear(self.stage.rig, one) or forecast(self.writer, [one.recipe]) is None
        ]

    def _require_time(self, budget: float | None) -> None:
        if budget is None or not self.pool:
            return
        least = min(self.clock.rising([one.recipe]).seconds for one in self.pool)
        if least > budget:
            raise TooLittleTime(
                "the budget is too small for any record",
                value=f"{significant(budget / 60.0, 3)} min",
                expected=f"at least {math.ceil(least / 6.0) / 10.0:g} min, which the quickest record takes",
            )

    def _predicted_probability(self, chosen: Sequence[Proposal]) -> float:
        return self.criterion.predicted_probability(together(chosen)) if chosen else 0.0

    # --- description of the records

    def result(self, basis: Basis, chosen: Sequence[Proposal]) -> DesignResult:
        """The answer."""
        steps = [self._after(chosen[:count]) for count in range(len(chosen) + 1)]
        timed = Ordered(tuple(range(len(chosen))), self.clock.in_order([one.recipe for one in chosen]))
        records = tuple(
            self._record(chosen, k, steps[k], steps[k + 1], timed.each[k]) for k in range(len(chosen))
        )
        return DesignResult(
            runs=basis.runs,
            model=basis.model,
            aim=self.question.aim,
            rivals=tuple(rival.described() for rival in self.question.rivals),
            outlooks=steps[-1].outlooks,
            records=records,
            separation=steps[-1].separation,
            before=steps[0].probability,
            after=steps[-1].probability,
            duration=timed.seconds,
            sharpened=self._precision_gains(chosen),
            of_random=self._of_random(),
            simulated=self.workshop.tried,
            writer=self.writer,
            diagnosis=basis.diagnosis,
            excluded=basis.excluded,
        )

    def sensor_instead(self, refused: NothingToSet) -> NothingToSet:
        """Say which sensor would distinguish the rivals if no condition can be set, if one would."""
        if isinstance(self.criterion, Discrimination):
            best = best_sensor(sensor_sets(self.criterion, self.equipment, self._so_far))
            if best is not None:
                refused.hint = worded(best, "design.statement.repeats_with")
                refused.sensors = best.channels if best.probability >= HALF else ()
        return refused

    @property
    def _so_far(self) -> list[MeasuredRecord]:
        fit = self.question.rivals[0].fit
        return [fit.problem.records[k] for k in fit.fitted]

    def with_sensors(self, result: DesignResult, chosen: Sequence[Proposal]) -> DesignResult:
        """The answer with the power of other sensors; unchanged if the rig names none that could help."""
        if not isinstance(self.criterion, Discrimination):
            return replace(result, sensors_left_out=True)
        records = [*self._so_far, *(one.record for one in chosen)]
        sets = sensor_sets(self.criterion, self.equipment, records)
        best = None if result.separable else best_sensor(sets)
        unknown = unknown_sensors(self.criterion, self.equipment)
        return replace(result, sensors=sets, sensor=best, unknown_sensors=unknown)

    @property
    def equipment(self) -> Rig:
        """The current rig file, which may name sensors that it did not when the data were taken."""
        now = self.question.rivals[0].fit.problem.model.rig
        return now if now is not None and now.could_have else self.stage.rig

    def _after(self, chosen: Sequence[Proposal]) -> PredictedResult:
        """The predicted power of records together."""
        criterion = self.criterion
        if isinstance(criterion, Discrimination):
            return predicted_result(criterion, self.draws, chosen)
        if isinstance(criterion, Detection):
            return self._detected(criterion, chosen)
        worth = criterion.separation(together(chosen)) if chosen else 0.0
        probability = self.question.rivals[0].weight
        return PredictedResult((), worth, probability)

    def _detected(self, criterion: Detection, chosen: Sequence[Proposal]) -> PredictedResult:
        nothing = self.known.evidence.scaled(0.0)
        evidence = together(chosen) if chosen else nothing
        before, after = criterion.of_each(nothing), criterion.of_each(evidence)
        sizes = criterion.noncentralities(evidence)
        rivals = self.question.rivals
        outlooks = tuple(
            PredictedPower(
                rivals[k].name, rivals[criterion.none].name, 0.0, 0.0, sizes[k], 0.0, before[k], after[k]
            )
            for k in after
        )
        return PredictedResult(
            outlooks, criterion.separation(evidence), criterion.predicted_probability(evidence)
        )

    def _record(
        self,
        chosen: Sequence[Proposal],
        k: int,
        before: PredictedResult,
        after: PredictedResult,
        seconds: float,
    ) -> ProposedRecord:
        proposal, rig = chosen[k], self.stage.rig
        return ProposedRecord(
            settings=proposal.recipe.settings(rig),
            steps=lines_of(proposal.recipe, rig),
            separation=after.separation - before.separation,
            of_repeat=self._of_repeat(chosen[:k]),
            before=before.probability,
            after=after.probability,
            duration=seconds,
            recorded=proposal.recipe.length,
            rate=proposal.recipe.rate,
            predictions=self._predictions(proposal),
            recipe=proposal.recipe,
        )

    def _of_repeat(self, others: Sequence[Proposal]) -> float:
        """What the best repeat of an earlier record would add to these."""
        repeats = [one for one in self.known.repeats if one is not None]
        base = self.criterion.separation(together(others)) if others else 0.0
        if isinstance(self.criterion, Detection) and not others:
            base = self.criterion.separation(self.known.evidence.scaled(0.0))
        candidates = [one + together(others) if others else one for one in repeats]
        return max((self.criterion.separation(one) - base for one in candidates), default=0.0)

    def _of_random(self) -> float:
        """The median worth of the candidates with which a search started, one record each."""
        return float(np.median([self.criterion.separation(one) for one in self.first])) if self.first else 0.0

    def _predictions(self, proposal: Proposal) -> tuple[Prediction, ...]:
        scene = self.workshop.scene(proposal)
        measurements = self.question.rivals[0].fit.problem.measurements
        predictions = []
        for index, (name, unit) in enumerate(zip(measurements.outputs, measurements.units, strict=True)):
            shown = parse_unit(unit)
            by_rival = {
                rival.name: (one.outputs[:, index] - shown.offset) / shown.factor
                for rival, one in zip(self.question.rivals, scene.predicted, strict=True)
            }
            sigma = scene.sigma[:, index] / shown.factor
            predictions.append(Prediction(name, unit, scene.record.times, by_rival, sigma))
        return tuple(predictions)

    def _precision_gains(self, chosen: Sequence[Proposal]) -> tuple[PrecisionGain, ...]:
        """The precision of the parameters of the accepted effect, before and after."""
        if not isinstance(self.criterion, Precision) or not chosen:
            return ()
        rival = self.question.rivals[0]
        factor = math.sqrt(rival.overdispersion)
        before, after = (np.sqrt(np.diag(self.criterion.covariance(one))) for one in (None, together(chosen)))
        names = [unknown.name for unknown in rival.fit.problem.shared]
        stds = [
            (names[k], *(factor * float(ends[at]) * rival.sizes[k] for ends in (before, after)))
            for at, k in enumerate(self.criterion.places)
        ]
        model = rival.fit.problem.model
        return tuple(
            PrecisionGain(name, unit_of(model, name), *(half_width(model, name, std) for std in two))
            for name, *two in stds
        )
