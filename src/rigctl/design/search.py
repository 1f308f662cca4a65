"""Look for the records to take: many candidates at first, then one number after the other, record by record.

A set grows greedily, what its records teach counted for the next one. Of the candidates some 300 are spread
evenly over all that the rig can do (Sobol's sequence); the best one is improved in two sweeps over its free
numbers, each tried at seven values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.design.criterion import Criterion
from rigctl.design.feasible import inside_validity, keeps_clear
from rigctl.design.information import Evidence
from rigctl.design.recipe import Recipe, Stage
from rigctl.design.rig_time import RigTime
from rigctl.design.rivals import Rival
from rigctl.design.scheme import Scheme
from rigctl.design.so_far import Known
from rigctl.design.virtual_records import Course, Scene, predict

Floats = NDArray[np.float64]

#: candidates that a search begins with, of all schemes together
CANDIDATES = 300
#: sweeps of the exchange, and values that each free number is tried at
_SWEEPS, _VALUES = 2, 7
#: a set is complete at this probability
ENOUGH = 0.95
#: a record that adds a smaller share of what a set is worth is not worth the rig's time
_ADDS = 0.02
#: least worth of a record at all
_LEAST = 1e-4
#: numbers of a prediction held at once: more candidates are gone through in parts
_AT_ONCE = 64


@dataclass(frozen=True)
class Proposal:
    """A record that may be taken."""

    scheme: Scheme
    point: tuple[float, ...]
    recipe: Recipe
    scene: Scene = field(repr=False)
    evidence: Evidence = field(repr=False)


@dataclass
class Workshop:
    """Makes proposals: whatever comes out of it can be carried out, stays clear of every limit, and every
    rival has a value there.

    Attributes
    ----------
    tried: how many recipes were simulated.
    """

    rivals: Sequence[Rival]
    known: Known
    stage: Stage
    tried: int = 0
    _made: dict[object, Proposal | None] = field(default_factory=dict)

    def propose(self, points: Sequence[tuple[Scheme, Sequence[float]]]) -> list[Proposal | None]:
        """A proposal for each point of a scheme; None where it is not to be proposed."""
        recipes = [scheme.recipe(point) for scheme, point in points]
        fresh = {_key(one): k for k, one in enumerate(recipes) if _key(one) not in self._made}
        places = list(fresh.values())
        for begin in range(0, len(places), _AT_ONCE):
            part = places[begin : begin + _AT_ONCE]
            for k, scene in zip(part, self._scenes([recipes[k] for k in part]), strict=True):
                scheme, point = points[k]
                self._made[_key(recipes[k])] = (
                    None
                    if scene is None
                    else Proposal(scheme, tuple(point), recipes[k], scene, Evidence.of(scene.responses))
                )
        return [self._made[_key(one)] for one in recipes]

    def refuse(self, proposal: Proposal) -> None:
        """Never make it again."""
        self._made[_key(proposal.recipe)] = None

    def _scenes(self, recipes: Sequence[Recipe]) -> list[Scene | None]:
        self.tried += len(recipes)
        fit = self.rivals[0].fit
        measurements = fit.problem.measurements
        courses = self._begun(recipes)
        group = 1 + max(record.group for record in measurements.records)
        records = [course.record(measurements, group + k) for k, course in enumerate(courses)]
        scenes = predict(self.rivals, records)
        rig, channels = self.stage.rig, measurements.outputs
        clear = [
            scene is not None and keeps_clear(rig, channels, scene, self.known.covariances)
            for scene in scenes
        ]
        kept = [scene for scene, good in zip(scenes, clear, strict=True) if good and scene is not None]
        inside = dict(
            zip(map(id, kept), inside_validity(self.rivals, [one.record for one in kept]), strict=True)
        )
        return [scene if scene is not None and inside.get(id(scene), False) else None for scene in scenes]

    def _begun(self, recipes: Sequence[Recipe]) -> list[Course]:
        """The courses of the records, each begun where what holds before it leaves the bench."""
        courses = [self.stage.course(one) for one in recipes]
        resting = [k for k, one in enumerate(recipes) if one.rest > 0.0]
        if not resting:
            return courses
        measurements = self.rivals[0].fit.problem.measurements
        before = [self.stage.standing_course(recipes[k]).record(measurements) for k in resting]
        for k, scene in zip(resting, predict(self.rivals[:1], before), strict=True):
            if scene is not None:
                ends = scene.predicted[0].outputs[-1]
                readings = dict(zip(measurements.outputs, ends.tolist(), strict=True))
                courses[k] = replace(courses[k], readings=readings)
        return courses


def _key(recipe: Recipe) -> object:
    steps = tuple(
        (one.verb, round(one.seconds, 9), tuple(sorted(one.levels.items()))) for one in recipe.steps
    )
    before = tuple(sorted(recipe.before.items()))
    return steps, recipe.temperature, recipe.pressure, before, recipe.rest, recipe.rate


def first_candidates(workshop: Workshop, schemes: Sequence[Scheme], seed: int) -> list[Proposal]:
    """Spread evenly over all that the rig can do."""
    from scipy.stats.qmc import Sobol

    count = 2 ** max(4, round(math.log2(CANDIDATES / len(schemes))))
    points: list[tuple[Scheme, Sequence[float]]] = []
    for k, scheme in enumerate(schemes):
        drawn = Sobol(len(scheme.free), rng=np.random.default_rng([seed, k])).random(count)
        points += [(scheme, point) for point in drawn.tolist()]
    return [one for one in workshop.propose(points) if one is not None]


@dataclass(frozen=True)
class _Taken:
    """What the records chosen so far come to."""

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
    pool: all proposals so far; those that improve the best ones join.
    per_minute: whether worth counts for each minute of the rig's time, or for itself.
    acceptable: whether a proposal may be taken, asked only of one that would be.
    """

    workshop: Workshop
    criterion: Criterion
    clock: RigTime
    pool: list[Proposal]
    records: int
    budget: float
    per_minute: bool = True
    acceptable: Callable[[Proposal], bool] = field(default=lambda _: True)

    def best_set(self) -> list[Proposal]:
        """The records, greedily, in the order in which they were found."""
        chosen: list[Proposal] = []
        while len(chosen) < self.records:
            added = self._next(chosen)
            if added is None or (chosen and self._adds_little(chosen, added)):
                break
            chosen.append(added)
            if self.criterion.promise(together(chosen)) >= ENOUGH:
                break
        return chosen

    def _next(self, chosen: Sequence[Proposal]) -> Proposal | None:
        """The proposal that adds most, improved; None where none adds anything, or the budget is spent."""
        while True:
            best = self._leader(chosen, self.pool)
            if best is None:
                return None
            best = self._exchanged(chosen, best)
            if self.acceptable(best):
                return best
            self.workshop.refuse(best)
            self.pool = [one for one in self.pool if one is not best]

    def _leader(self, chosen: Sequence[Proposal], among: Sequence[Proposal]) -> Proposal | None:
        """The one that adds most to `chosen` within the budget; None where none adds anything."""
        before = _Taken.of(chosen, self.criterion, self.clock)
        rated = [(self._rate(before, one), -k) for k, one in enumerate(among)]
        value, k = max(rated, default=(0.0, 0))
        return among[-k] if value > 0.0 else None

    def _rate(self, before: _Taken, one: Proposal) -> float:
        """What it adds, for each minute where that counts; 0 where it adds nothing or the budget is spent."""
        whole = one.evidence if before.evidence is None else before.evidence + one.evidence
        added = self.criterion.worth(whole) - before.worth
        if added < _LEAST:
            return 0.0
        spent = self.clock.rising([*before.recipes, one.recipe]).seconds
        if spent > self.budget:
            return 0.0
        return added / max(spent - before.seconds, 1.0) * 60.0 if self.per_minute else added

    def _exchanged(self, chosen: Sequence[Proposal], best: Proposal) -> Proposal:
        """Its free numbers changed one after the other where that makes it better."""
        for _ in range(_SWEEPS):
            before = best
            for k in range(len(best.point)):
                values = np.linspace(0.0, 1.0, _VALUES)
                points = [(*best.point[:k], float(value), *best.point[k + 1 :]) for value in values]
                made = self.workshop.propose([(best.scheme, point) for point in points])
                good = [one for one in made if one is not None]
                seen = set(map(id, self.pool))
                self.pool += [one for one in good if id(one) not in seen]
                best = self._leader(chosen, [best, *good]) or best
            if best is before:
                break
        return best

    def _adds_little(self, chosen: Sequence[Proposal], added: Proposal) -> bool:
        before = self.criterion.worth(together(chosen))
        return self.criterion.worth(together([*chosen, added])) - before < _ADDS * before


def together(chosen: Sequence[Proposal]) -> Evidence:
    """What proposals say together."""
    return Evidence.total(one.evidence for one in chosen)
