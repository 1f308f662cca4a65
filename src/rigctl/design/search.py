"""Search for the records to take: many candidates first, then one free number after the other, record by
record.

A set grows greedily, with the information in its records counted for the next one. Some 300 candidates are
spread evenly over all that the rig can do (Sobol sequence); the best one is improved in two sweeps over its
free numbers (coordinate exchange), each tried at seven values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.design.criterion import Criterion
from rigctl.design.feasible import inside_validity, keeps_clear
from rigctl.design.information import Evidence
from rigctl.design.information_so_far import Known
from rigctl.design.recipe import Recipe, Stage
from rigctl.design.refitted_gain import sent
from rigctl.design.rig_time import RigTime
from rigctl.design.rivals import Rival
from rigctl.design.scheme import Scheme
from rigctl.design.virtual_records import PlannedRecord, Scene, predict
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.measured.record import MeasuredRecord
from rigctl.tasks import Workers, map_tasks

Floats = NDArray[np.float64]

#: number of candidates with which a search starts, of all schemes together
CANDIDATES = 300
#: number of sweeps of an exchange, and of values at which each free number is tried
SWEEPS, VALUES = 2, 7
#: the exchange ends with a sweep that improves a record by less than this share
_GAIN = 0.05
#: one in so many candidates needs no heating
_AT_START = 4
#: a set is complete at this probability
ENOUGH = 0.95
#: a record that adds a smaller share of a set's worth than this is not worth the bench time
_ADDS = 0.005
#: least worth of a record
_LEAST = 1e-4
#: largest number of values of a prediction in memory: more candidates are processed in parts
_AT_ONCE = 64


#: a predicted record, and the information in it
Shown = tuple[MeasuredRecord, Evidence]


@dataclass(frozen=True)
class Proposal:
    """A record that may be taken.

    Attributes
    ----------
    record: its values are the predictions of the most probable rival.
    """

    scheme: Scheme
    point: tuple[float, ...]
    recipe: Recipe
    record: MeasuredRecord = field(repr=False)
    evidence: Evidence = field(repr=False)


@dataclass
class Workshop:
    """Makes proposals: each can be carried out, keeps clear of every limit, and can be simulated with every
    rival.

    Attributes
    ----------
    workers: processes that simulate candidates and refit rivals; this process if None.
    tried: number of recipes simulated.
    """

    rivals: Sequence[Rival]
    known: Known
    stage: Stage
    workers: Workers | None = None
    tried: int = 0
    _proposals: dict[object, Proposal | None] = field(default_factory=dict)
    _shown: dict[int, tuple[Proposal, Scene]] = field(default_factory=dict)

    def propose(self, points: Sequence[tuple[Scheme, Sequence[float]]]) -> list[Proposal | None]:
        """A proposal for each point of a scheme; None if the point is not acceptable."""
        # Numbers are rounded as they are written, so that different points may give one recipe: each is
        # simulated once.
        recipes = [scheme.recipe(point) for scheme, point in points]
        fresh = {_key(one): k for k, one in enumerate(recipes) if _key(one) not in self._proposals}
        indices = list(fresh.values())
        self.tried += len(indices)
        parts = [indices[begin : begin + _AT_ONCE] for begin in range(0, len(indices), _AT_ONCE)]
        judged = self._judged([[recipes[k] for k in part] for part in parts])
        for part, every in zip(parts, judged, strict=True):
            for k, shown in zip(part, every, strict=True):
                scheme, point = points[k]
                self._proposals[_key(recipes[k])] = (
                    None if shown is None else Proposal(scheme, tuple(point), recipes[k], *shown)
                )
        return [self._proposals[_key(one)] for one in recipes]

    def _judged(self, parts: Sequence[Sequence[Recipe]]) -> list[list[Shown | None]]:
        """The results of each part, in order; the parts do not depend on where they are simulated."""
        if self.workers is None or len(parts) < 2:
            return [self.judge(part) for part in parts]
        work = Workshop(tuple(map(sent, self.rivals)), self.known, self.stage).judge
        results = dict(map_tasks(work, parts, self.workers))
        return [results[index] for index in range(len(parts))]

    @one_thread()
    def judge(self, recipes: Sequence[Recipe]) -> list[Shown | None]:
        """The record of each recipe and its information; None for one that is not acceptable."""
        scenes = self._scenes(recipes)
        return [None if one is None else (one.record, Evidence.of(one.responses)) for one in scenes]

    def scene(self, proposal: Proposal) -> Scene:
        """Every rival's prediction of a record; recomputed, as those of all candidates take gigabytes."""
        if id(proposal) not in self._shown:
            (scene,) = predict(self.rivals, [proposal.record])
            if scene is None:
                raise RigctlError("a record that was simulated cannot be simulated again")
            self._shown[id(proposal)] = (proposal, scene)
        return self._shown[id(proposal)][1]

    def forget(self) -> None:
        """Forget the proposals made so far, so that they may be proposed again."""
        self._proposals.clear()
        self._shown.clear()

    def refuse(self, proposal: Proposal) -> None:
        """Never propose it again."""
        self._proposals[_key(proposal.recipe)] = None

    def _scenes(self, recipes: Sequence[Recipe]) -> list[Scene | None]:
        measurements = self.rivals[0].fit.problem.measurements
        # In turn: the rest before the record, the record with every rival, its distance from the limits, and
        # the ranges over which the rivals' laws were learned. What fails goes no further.
        courses = self._courses(recipes)
        group = 1 + max(record.group for record in measurements.records)
        good = [k for k, course in enumerate(courses) if course is not None]
        records = [
            course.record(measurements, group + k) for k, course in enumerate(courses) if course is not None
        ]
        scenes = dict(zip(good, predict(self.rivals, records), strict=True))
        clear = {k: scene for k, scene in scenes.items() if scene is not None and self._clear(scene)}
        inside = inside_validity(self.rivals, [scene.record for scene in clear.values()])
        valid = {k: scene for (k, scene), known in zip(clear.items(), inside, strict=True) if known}
        return [valid.get(k) for k in range(len(recipes))]

    def _clear(self, scene: Scene) -> bool:
        channels = self.rivals[0].fit.problem.measurements.outputs
        return keeps_clear(self.stage.rig, channels, scene, self.known.covariances)

    def _courses(
        self, recipes: Sequence[Recipe], readings: Mapping[str, float] | None = None
    ) -> list[PlannedRecord | None]:
        """The inputs of the records, each starting where the preceding levels leave the bench; None if that
        comes near a limit."""
        courses: list[PlannedRecord | None] = [self.stage.course(one) for one in recipes]
        # A record of levels starts where the levels before it have brought the bench: that rest is simulated
        # first, and must keep clear of the limits as well.
        resting = [k for k, one in enumerate(recipes) if one.rest > 0.0]
        if not resting:
            return courses
        measurements = self.rivals[0].fit.problem.measurements
        before = [self.stage.standing_course(recipes[k], readings).record(measurements) for k in resting]
        for k, scene in zip(resting, predict(self.rivals, before), strict=True):
            course = courses[k]
            if scene is None or course is None or not self._clear(scene):
                courses[k] = None
            else:
                courses[k] = replace(course, readings=_ends(scene.record, measurements.outputs))
        return courses

    def one_after_the_other(self, chosen: Sequence[Proposal]) -> list[Proposal]:
        """Proposals that respect every limit if each starts in the state in which its predecessor ended."""
        outputs = self.rivals[0].fit.problem.measurements.outputs
        accepted: list[Proposal] = []
        for one in chosen:
            readings = _ends(accepted[-1].record, outputs) if accepted else None
            (course,) = self._courses([one.recipe], readings)
            if course is not None:
                accepted.append(one)
        return accepted


def _ends(record: MeasuredRecord, outputs: Sequence[str]) -> dict[str, float]:
    """The channels' readings at the end of a record, as predicted by the most probable rival."""
    return dict(zip(outputs, record.values[-1].tolist(), strict=True))


def _key(recipe: Recipe) -> object:
    steps = tuple(
        (one.verb, round(one.seconds, 9), tuple(sorted(one.levels.items()))) for one in recipe.steps
    )
    before = tuple(sorted(recipe.before.items()))
    return steps, recipe.temperature, recipe.pressure, before, recipe.rest, recipe.rate


def _some_at_once(scheme: Scheme, points: Floats) -> Floats:
    """The points, every fourth at the bench's present temperature: heating takes most of the bench time."""
    for k, one in enumerate(scheme.free):
        if one.name == "temperature":
            points[::_AT_START, k] = 0.0
    return points


def first_candidates(workshop: Workshop, schemes: Sequence[Scheme], seed: int) -> list[Proposal]:
    """The initial candidates, spread evenly over the rig's operating range."""
    from scipy.stats.qmc import Sobol

    count = max(1, CANDIDATES // len(schemes))
    points: list[tuple[Scheme, Sequence[float]]] = []
    for k, scheme in enumerate(schemes):
        drawn = Sobol(len(scheme.free), rng=np.random.default_rng([seed, k])).random_base2(
            max(1, math.ceil(math.log2(count)))
        )
        points += [(scheme, point) for point in _some_at_once(scheme, drawn[:count]).tolist()]
    return [one for one in workshop.propose(points) if one is not None]


@dataclass(frozen=True)
class _Taken:
    """The state of the set of records chosen so far."""

    recipes: tuple[Recipe, ...]
    evidence: Evidence | None
    worth: float
    seconds: float

    @classmethod
    def of(cls, chosen: Sequence[Proposal], criterion: Criterion, clock: RigTime) -> _Taken:
        if not chosen:
            return cls((), None, 0.0, 0.0)
        recipes, evidence = tuple(one.recipe for one in chosen), together(chosen)
        return cls(recipes, evidence, criterion.worth(evidence), clock.rising(recipes).seconds)


@dataclass
class Search:
    """Grows a set of records.

    Attributes
    ----------
    pool: all proposals so far; improved ones are added.
    per_minute: whether worth counts per minute of bench time, or by itself.
    exchange: whether the leading candidate is improved, or used unchanged.
    """

    workshop: Workshop
    criterion: Criterion
    clock: RigTime
    pool: list[Proposal]
    records: int
    budget: float
    per_minute: bool = True
    exchange: bool = True

    def best_set(self) -> list[Proposal]:
        """The records, greedily, in the order in which they were found."""
        chosen: list[Proposal] = []
        while len(chosen) < self.records:
            added = self._next(chosen)
            if added is None or (chosen and self._adds_little(chosen, added)):
                break
            chosen.append(added)
            if self.criterion.predicted_probability(together(chosen)) >= ENOUGH:
                break
        return chosen

    def _next(self, chosen: Sequence[Proposal]) -> Proposal | None:
        """The proposal that adds most, improved; None if none adds anything, or the budget is spent."""
        best = self._leader(chosen, self.pool)
        return best if best is None or not self.exchange else self._exchanged(chosen, best)

    def without(self, refused: Sequence[Proposal]) -> Search:
        """This search without the proposals `refused`."""
        for one in refused:
            self.workshop.refuse(one)
        names = set(map(id, refused))
        return replace(self, pool=[one for one in self.pool if id(one) not in names])

    def _leader(self, chosen: Sequence[Proposal], among: Sequence[Proposal]) -> Proposal | None:
        """The proposal that adds most to `chosen` within the budget; None if none adds anything."""
        before = _Taken.of(chosen, self.criterion, self.clock)
        rated = [(self._rate(before, one), -k) for k, one in enumerate(among)]
        value, k = max(rated, default=(0.0, 0))
        return among[-k] if value > 0.0 else None

    def _rate(self, before: _Taken, one: Proposal) -> float:
        """Gain of a proposal, per minute if time counts; 0 without a gain or beyond the budget."""
        evidence = one.evidence if before.evidence is None else before.evidence + one.evidence
        added = self.criterion.worth(evidence) - before.worth
        if added < _LEAST:
            return 0.0
        spent = self.clock.rising([*before.recipes, one.recipe]).seconds
        if spent > self.budget:
            return 0.0
        return added / max(spent - before.seconds, 1.0) * 60.0 if self.per_minute else added

    def _exchanged(self, chosen: Sequence[Proposal], best: Proposal) -> Proposal:
        """`best` with its free numbers changed one after the other as long as that improves it."""
        # Coordinate exchange: one number after the other at seven values, the best kept; a second sweep,
        # since the best value of one depends on the others.
        so_far = _Taken.of(chosen, self.criterion, self.clock)
        for _ in range(SWEEPS):
            before = self._rate(so_far, best)
            for k in range(len(best.point)):
                values = np.linspace(0.0, 1.0, VALUES)
                points = [(*best.point[:k], float(value), *best.point[k + 1 :]) for value in values]
                proposals = self.workshop.propose([(best.scheme, point) for point in points])
                good = [one for one in proposals if one is not None]
                pooled = set(map(id, self.pool))
                self.pool += [one for one in good if id(one) not in pooled]
                best = self._leader(chosen, [best, *good]) or best
            if self._rate(so_far, best) < (1.0 + _GAIN) * before:
                break
        return best

    def _adds_little(self, chosen: Sequence[Proposal], added: Proposal) -> bool:
        before = self.criterion.worth(together(chosen))
        return self.criterion.worth(together([*chosen, added])) - before < _ADDS * before


def together(chosen: Sequence[Proposal]) -> Evidence:
    """The information in proposals together."""
    return Evidence.total(one.evidence for one in chosen)
