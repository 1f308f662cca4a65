"""What a trial's fit leaves: its linearisation, from which every question about the trial is answered."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.adequacy import Adequacy, adequacy
from rigctl.compare.candidates import Candidate, candidates
from rigctl.compare.data_ranges import data_ranges
from rigctl.compare.linearise import Linearisation, linearise
from rigctl.compare.projected import Projected, project
from rigctl.compare.scores import Screening, screen
from rigctl.diagnose.trial import Trial
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """A trial's fit, linearised once with its own effects among the candidates.

    Attributes
    ----------
    whole: the data with the whole library at its null.
    excluded: effects that are not to be looked at.
    """

    trial: Trial
    whole: Problem = field(repr=False)
    excluded: Collection[str] = ()

    @cached_property
    def linearisation(self) -> Linearisation:
        """The trial's effects among the nuisances, every effect that could join them among the candidates."""
        contradicted = {name for one in self.trial.candidates for name in one.effect.instead_of}
        return self._everything.rearranged(
            self._members, [place for place in self._others if self._name(place) not in contradicted]
        )

    @cached_property
    def projected(self) -> Projected:
        """The linearisation without what the fitted unknowns can do."""
        return project(self.linearisation)

    @cached_property
    def screening(self) -> Screening:
        """Scores of the effects that could join."""
        return screen(self.projected)

    @cached_property
    def adequacy(self) -> Adequacy:
        """Whether anything is left to explain."""
        return adequacy(self.projected, self.screening)

    def without(self, member: Candidate) -> Projected:
        """The linearisation in which one of the trial's effects is a candidate again, the first of them."""
        own = self._place(member)
        rest = [place for place in self._members if place != own]
        return project(self._everything.rearranged(rest, [own, *self._others]))

    def held(self, member: Candidate) -> list[Floats]:
        """(rows of each record) what those of a member's parameters do that the fit left at their bounds."""
        place = self._place(member)
        start, at_bound = self._everything.starts[place], self.trial.fit.at_bound
        moved = np.where([name in at_bound for name in member.columns], self.trial.sizes(member), 0.0)
        return [one.signatures[:, start : start + moved.size] @ moved for one in self._everything.records]

    def _place(self, member: Candidate) -> int:
        """Where one of the trial's own effects stands among the candidates."""
        return self.trial.effects.index(member.name)

    def _name(self, place: int) -> str:
        return self._everything.candidates[place].name

    @property
    def _members(self) -> range:
        return range(len(self.trial.candidates))

    @property
    def _others(self) -> range:
        return range(len(self.trial.candidates), len(self._everything.candidates))

    @cached_property
    def _everything(self) -> Linearisation:
        """The model's own unknowns are the nuisances, every effect is a candidate: the trial's come first."""
        trial = self.trial
        problem, present = trial.fit.problem, set(trial.effects)
        effects = {column for one in trial.candidates for column in one.columns}
        keep = [k for k, unknown in enumerate(problem.shared) if unknown.name not in effects]
        base = problem.base.copy()
        names = problem.compiled.system.parameter_names
        for unknown, value in zip(problem.shared, trial.fit.values, strict=True):
            base[names.index(unknown.name)] = value
        fixed = replace(
            trial.fit,
            problem=problem.with_shared([problem.shared[k] for k in keep], base),
            values=trial.fit.values[keep],
        )
        ranges = data_ranges(self.whole.model.family, self.whole.measurements)
        members = [_from_here_to_null(one) for one in trial.candidates]
        others = [
            one for one in candidates(self.whole.model, self.excluded, ranges) if one.name not in present
        ]
        return replace(linearise(fixed, self.whole, [*members, *others]), fit=trial.fit)


def _from_here_to_null(member: Candidate) -> Candidate:
    """Its shapes are the fit's; what a threshold keeps from its slope, the way to its null tells."""
    null = {name: member.parameter(name).at_null for name in member.sizes}
    return replace(member, shapes={}, sizes=null)
