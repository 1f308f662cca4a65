"""Look for the set of effects that explains a misfit: singles, pairs, forward, and backward again.

No effect of a library has a bench's exact shape. What a second effect explains beyond a first one is
therefore more likely to be the first one's shape than an effect where it is little (`_SLIGHT`), and a set
that leaves more than hardly anything (`SHAPE`) may be it in another shape, a part of it, or a stand-in: it is
not named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from rigctl.compare.candidates import Candidate
from rigctl.compare.result import ModelComparison
from rigctl.compare.scores import Score
from rigctl.diagnose.alone import Alone, alone, near_best
from rigctl.diagnose.confound import LEAST_DIFFERENCE, LEAST_SEPARATION, cosine, separation
from rigctl.diagnose.pairs import pair_gains
from rigctl.diagnose.point import Point
from rigctl.diagnose.trial import Trial, plain, refit
from rigctl.model.fit.problem import Problem

#: told what is being done
Tell = Callable[[str], None]

#: the share of a squared misfit that an effect of the right cause may leave by not having the bench's exact
#: shape: a sixth of its size
SHAPE = 0.03
#: a member of a pair that explains less than this share of what both explain may be the shape of the other
_SLIGHT = 0.15
_BEST = 3
#: rivals more alike than this are refitted
_ALIKE = 0.5
#: but not those that the signatures separate by more than this: no refit brings them back
_FAR = 3.0 * LEAST_SEPARATION
#: never more refits of rivals than these
_MOST_RIVALS = 7
_PAIRS = 2
_SWAPS = 3
#: never more effects in a set than these: three that are not missing explain almost anything together, and
#: where three are, the loop finds them one after the other
_TOGETHER = 2
#: a set of another size must be better by this to be looked at, in χ²
_WORTH = 6.0


@dataclass
class Search:
    """The sets that were tried on one comparison, and the best of them.

    Attributes
    ----------
    before: the model as it is.
    whole: its data with the whole library at its null.
    most: effects in a set.
    """

    before: ModelComparison
    whole: Problem
    most: int = _TOGETHER
    tell: Tell = field(default=lambda _: None)
    trials: dict[tuple[str, ...], Trial] = field(default_factory=dict)
    alone: dict[str, Alone | None] = field(default_factory=dict)
    _points: dict[tuple[str, ...], Point] = field(default_factory=dict)
    _rivals: dict[tuple[tuple[str, ...], str], list[tuple[Trial, float, float]]] = field(default_factory=dict)

    @cached_property
    def none(self) -> Trial:
        """The model as it is."""
        return plain(self.before.fit)

    @cached_property
    def library(self) -> int:
        """How many effects were looked at."""
        return len({candidate.name for candidate in self.before.linearisation.candidates})

    @cached_property
    def samples(self) -> float:
        """Effective sample size: n/(1 + 2·Σρ_k) of each channel, ρ_k at lag k; records at least once each.

        What acts between records only is paid for as dearly as what acts within them: by too much, never by
        too little.
        """
        problem = self.before.fit.problem
        total = 0.0
        for c, channel in enumerate(problem.noise.channels):
            count = sum(int(problem.ok[k][:, c].sum()) for k in self.before.fit.fitted)
            together = (1.0 - channel.white) * channel.correlation / (1.0 - channel.correlation)
            total += count / (1.0 + 2.0 * together)
        return max(total, float(len(self.before.fit.fitted)), 2.0)

    def price(self, candidate: Candidate) -> float:
        """What mBIC asks of one effect more."""
        return len(candidate.columns) * math.log(self.samples) + 2.0 * math.log(max(self.library, 2))

    def mbic(self, trial: Trial) -> float:
        """The criterion of a trial."""
        return trial.mbic(self.samples, self.library)

    def best(self) -> Trial:
        """The set that explains the misfit best: singles, pairs, backward, and what could stand instead."""
        if not self.before.screening.scores:
            return self.none
        self._singles()
        best = self._swapped(self._least([self.none, *self.trials.values()]))
        return self._exchanged(self._swapped(self._backward(self._pairs(best))))

    def left(self, trial: Trial) -> float:
        """The share of the squared misfit that stays with a set; 0 when the tests find nothing any more.

        Measured by what the tests see: the excess of the plane test and of χ² over their own spread, and the
        largest fall of χ² that any further effect promises beyond what mBIC asks of it; against the fall that
        was reached.
        """
        if not trial.candidates:
            return 0.0 if self.before.adequate else 1.0
        here = self.at(trial)
        if here.adequacy.adequate:
            return 0.0
        excess = max(test.excess for test in here.adequacy.tests.values())
        there = here.linearisation.candidates
        promised = max(
            (score.gain - self.price(there[score.candidate]) for score in here.screening.scores),
            default=0.0,
        )
        reached = max(self.none.chi2 - trial.chi2, 1e-12)
        return max(excess, promised) / (reached + max(excess, promised))

    def at(self, trial: Trial) -> Point:
        """The linearisation and the tests at a trial's fit."""
        key = _key(trial.candidates)
        if key not in self._points:
            self._points[key] = Point(trial, self.whole, self.before.excluded)
        return self._points[key]

    def rivals(self, trial: Trial, member: Candidate) -> list[tuple[Trial, float, float]]:
        """(rival set, cosine, separation d) of the sets that have another effect in `member`'s place.

        Those that are alike or close are refitted; the others are told apart already.
        """
        key = (_key(trial.candidates), member.name)
        if key not in self._rivals:
            self._rivals[key] = self._find_rivals(trial, member)
        return self._rivals[key]

    def _find_rivals(self, trial: Trial, member: Candidate) -> list[tuple[Trial, float, float]]:
        rest = tuple(one for one in trial.candidates if one is not member)
        without = self.none if not rest else self._try(rest, trial)
        if without is None:
            return []
        size = max(without.chi2 - trial.chi2, 0.0) ** 0.5
        projected = self.at(trial).without(member)
        close: dict[str, tuple[float, Candidate, float]] = {}
        silent = set(self.before.screening.untestable)
        look = projected.linearisation
        for place, candidate in enumerate(look.candidates):
            if candidate.name == member.name or not projected.usable[look.columns_of(place)].any():
                continue
            if candidate.name in silent:  # these data do not show it on the model as it is
                continue
            cos = cosine(projected, 0, place)
            d = separation(size, cos)
            held = close.get(candidate.name)
            if held is None or cos > held[0]:
                close[candidate.name] = (cos, candidate, d)
        near = [
            one for one in close.values() if (one[0] > _ALIKE or one[2] < LEAST_SEPARATION) and one[2] < _FAR
        ]
        near.sort(key=lambda one: -one[0])
        found = []
        if self.alone and not rest:  # what is far off alone need not be fitted again
            kept = near_best(self.alone)
            near = [one for one in near if one[1].name in kept]
        for cos, candidate, d in near[: None if self._few else _MOST_RIVALS]:
            rival = self._try((*rest, candidate), without)
            if rival is not None and not (self._few and self._far(rival, trial)):
                found.append((rival, cos, d))
        return found

    @property
    def _few(self) -> bool:
        """A table: its few rows are quickly refitted, and tell many effects apart by refits alone."""
        return self.before.fit.problem.measurements.table

    def _far(self, rival: Trial, best: Trial) -> bool:
        """Of a table, both fitted to it: the other is a hundred times as probable."""
        return self.mbic(rival) - self.mbic(best) >= LEAST_DIFFERENCE

    def _singles(self) -> None:
        scores = self.before.screening.scores
        lin, projected = self.before.linearisation, self.before.projected
        by_gain = sorted(scores, key=lambda score: -score.gain)
        leader = by_gain[0]
        alike = [
            score
            for score in by_gain
            if score.gain > 0.0 and self._near(cosine(projected, leader.candidate, score.candidate), leader.z)
        ]
        chosen = list(dict.fromkeys(score.effect for score in [*by_gain[:_BEST], *alike]))
        if self._few:
            chosen = self._near_alone([score.effect for score in by_gain])
        for effect in chosen[: None if self._few else _BEST + _MOST_RIVALS]:
            score = next(one for one in scores if one.effect == effect)
            if score.gain > 0.0 or self._few:
                self.tell(f"Refitting with {effect}")
                self._try((lin.candidates[score.candidate],), self.none)

    def promised(self, score: Score) -> float:
        """The fall of χ² that an effect makes: fitted alone where it was, else by the linear problem."""
        found = self.alone.get(score.effect)
        return score.gain if found is None else max(self.none.chi2 - found.chi2, 0.0)

    def alone_sizes(self, effect: str) -> list[float]:
        """An effect's parameters less their null as fitted alone, SI; empty where it was not."""
        found = self.alone.get(effect)
        if found is None:
            return []
        at = {u.name: float(v) for u, v in zip(found.fit.problem.shared, found.fit.values, strict=True)}
        own = {name: found.candidate.parameter(name) for name in found.candidate.columns}
        return [at.get(name, declared.at_null) - declared.at_null for name, declared in own.items()]

    def _near_alone(self, effects: Sequence[str]) -> list[str]:
        """Those that come near the best when each is fitted in the equations of the whole library."""
        scores = {score.effect: score for score in self.before.screening.scores}
        for effect in effects:
            self.tell(f"Asking what {effect} could do alone")
            candidate = self.before.linearisation.candidates[scores[effect].candidate]
            self.alone[effect] = alone(self.before, candidate, from_null=scores[effect].gain > 0.0)
        return near_best(self.alone)

    @staticmethod
    def _near(cos: float, size: float) -> bool:
        """Whether two signatures are so alike that a refit must tell which is right."""
        return cos > _ALIKE and separation(size, cos) < _FAR

    def _pairs(self, best: Trial) -> Trial:
        """The best pairs of the linear problem, with what the best single effect asks for and without it."""
        if self.most < 2 or (best.candidates and self.left(best) <= SHAPE):
            return best
        lin = self.before.linearisation
        promised = self.none.chi2 - min(trial.chi2 for trial in (best, *self.trials.values()))
        pairs = [
            (pair.gain, [lin.candidates[k] for k in pair.places])
            for pair in pair_gains(self.before.projected)
        ]
        better = [chosen for gain, chosen in pairs[:_PAIRS] if gain > promised + _WORTH]
        own = set(best.effects)
        without = [chosen for gain, chosen in pairs if gain > _WORTH and not {c.name for c in chosen} & own]
        for chosen in better + [one for one in without[: _PAIRS if own else 0] if one not in better]:
            self.tell(f"Refitting with {chosen[0].name} and {chosen[1].name}")
            self._try(chosen, self.none)
        if best.candidates:
            self._forward(best)
        return self._least([best, *self.trials.values()])

    def _exchanged(self, best: Trial) -> Trial:
        """With a member of a pair that leaves something replaced by what its own linearisation asks for."""
        for _ in range(_SWAPS):
            if len(best.candidates) < 2 or not self.left(best):
                break
            found = self._least([best, *self._exchanges(best)])
            if found is best:
                break
            best = self._swapped(self._backward(found))
        return best

    def _exchanges(self, best: Trial) -> list[Trial]:
        here = self.at(best)
        found = []
        for score in sorted(here.screening.scores, key=lambda one: -one.gain)[:_PAIRS]:
            candidate = here.linearisation.candidates[score.candidate]
            for member in best.candidates if score.gain > _WORTH else ():
                self.tell(f"Refitting with {candidate.name} for {member.name}")
                rest = tuple(one for one in best.candidates if one is not member)
                found.append(self._try((*rest, candidate), best))
        return [trial for trial in found if trial is not None]

    def _forward(self, best: Trial) -> Trial | None:
        """`best` and one effect more: the ones that its own linearisation promises most of."""
        here = self.at(best)
        tried = []
        for score in sorted(here.screening.scores, key=lambda one: -one.gain)[:_PAIRS]:
            if score.gain > _WORTH:
                candidate = here.linearisation.candidates[score.candidate]
                self.tell(f"Refitting with {', '.join([*best.effects, candidate.name])}")
                tried.append(self._try((*best.candidates, candidate), best))
        return self._least([one for one in tried if one is not None]) if any(tried) else None

    def _backward(self, best: Trial) -> Trial:
        """Without the members that do not pay for themselves, or explain no more than a shape may."""
        while len(best.candidates) > 1:
            tried = [
                self._try(tuple(one for one in best.candidates if one is not member), best)
                for member in best.candidates
            ]
            shorter = [one for one in tried if one is not None]
            found = self._least([best, *shorter])
            if found is best:
                reached = self.none.chi2 - best.chi2
                slight = [one for one in shorter if one.chi2 - best.chi2 < _SLIGHT * reached]
                if not slight:
                    break
                found = min(slight, key=lambda one: one.chi2)
            best = found
        return best

    def _swapped(self, best: Trial) -> Trial:
        """With a member replaced by a rival where that explains more: what came first need not be right."""
        for _ in range(_SWAPS):
            sets = [rival for member in best.candidates for rival, _, _ in self.rivals(best, member)]
            found = self._least([best, *sets])
            if found is best:
                break
            best = self._backward(found)
        return best

    def _try(self, chosen: Sequence[Candidate], begin: Trial) -> Trial | None:
        """The set fitted, beginning at another one's fit; each set once."""
        key = _key(chosen)
        if key not in self.trials:
            found = refit(self.before.fit, chosen, begin.fit)
            if found is None:
                return None
            self.trials[key] = found
        return self.trials[key]

    def _least(self, trials: Iterable[Trial]) -> Trial:
        return min(trials, key=self.mbic)


def _key(chosen: Sequence[Candidate]) -> tuple[str, ...]:
    return tuple(sorted(f"{one.name} {sorted(one.shapes.items())}" for one in chosen))
