"""A refitted set of effects as linearised at its fit: the tests of what it leaves, with and without a
shape tolerance of its laws.

In: a `RefittedSet`, and its data with the equations of the whole library. Out: `View`s, in each of which
other columns count as fitted: the members, the discrepancies of their laws, or all but one member. One
simulation serves all of them, because they differ only in what is projected off.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.adequacy import Adequacy, adequacy
from rigctl.analysis.linear.candidates import Candidate, candidates, data_ranges
from rigctl.analysis.linear.linearisation import Linearisation, linearise
from rigctl.analysis.linear.nuisance_projection import Projected, project
from rigctl.analysis.linear.score_test import Screening, screen
from rigctl.analysis.linear.shape_tolerance import ShapeColumns, shape_columns
from rigctl.analysis.linear.size_scatter import SizeScatter, size_scatter, switch_columns, with_scatter
from rigctl.analysis.linear.slopes import KnownSlopes
from rigctl.analysis.search.refit import RefittedSet
from rigctl.effects.declaration import qualified
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A fit with everything that it frees projected off, and the tests of the rest.

    Attributes
    ----------
    linearisation: the fitted parameters are the nuisances, every effect that could be added is a candidate.
    """

    linearisation: Linearisation = field(repr=False)

    @cached_property
    def projected(self) -> Projected:
        """The linearisation with the fitted unknowns projected off."""
        return project(self.linearisation)

    @cached_property
    def screening(self) -> Screening:
        """Scores of the effects that could be added."""
        return screen(self.projected)

    @cached_property
    def adequacy(self) -> Adequacy:
        """Whether anything is left to explain."""
        return adequacy(self.projected, self.screening)


@dataclass(frozen=True)
class LinearisedSet:
    """A refitted set, linearised once with its own effects among the candidates.

    Attributes
    ----------
    whole: the data with the equations of the whole library, every effect at its null.
    excluded: effects that are not to be considered.
    known: derivatives at the same point, if they were computed before.
    """

    trial: RefittedSet
    whole: Problem = field(repr=False)
    excluded: Collection[str] = ()
    known: KnownSlopes | None = field(default=None, repr=False)
    _views: dict[float, View] = field(default_factory=dict, repr=False)
    _scatters: dict[str, SizeScatter | None] = field(default_factory=dict, repr=False)

    def view(self, tolerance: float) -> View:
        """The trial's effects among the nuisances, and the laws of all effects of the model with a
        discrepancy of standard deviation `tolerance`; at 0 they are exactly those of the library."""
        if tolerance not in self._views:
            contradicted = {name for one in self.trial.candidates for name in one.effect.instead_of}
            compatible = [index for index in self._others if self._name(index) not in contradicted]
            self._views[tolerance] = View(self._everything.rearranged(self._members, compatible, tolerance))
        return self._views[tolerance]

    @property
    def linearisation(self) -> Linearisation:
        """The linearisation with the laws exactly as declared."""
        return self.view(0.0).linearisation

    @property
    def projected(self) -> Projected:
        """The projection with the laws exactly as declared."""
        return self.view(0.0).projected

    @property
    def screening(self) -> Screening:
        """The scores with the laws exactly as declared."""
        return self.view(0.0).screening

    @property
    def adequacy(self) -> Adequacy:
        """The tests with the laws exactly as declared."""
        return self.view(0.0).adequacy

    def discrepancy_evidence(self, tolerance: float) -> float:
        """``−gᵀ(I + A)⁻¹g + ln|I + A|`` of the discrepancies of the laws; 0 if there are none."""
        shaped = self.shaped()
        count = len(shaped.shapes)
        if not count:
            return 0.0
        fixed = project(shaped)
        # Scaled by τ, the amplitudes have the prior N(0, I), and integrating them out of exp(−½‖r̃ − S̃a‖²)
        # gives −2·ln L = r̃ᵀr̃ − gᵀ(I + A)⁻¹g + ln|I + A|.
        columns = fixed.signatures * tolerance
        matrix = columns.T @ columns + np.eye(count)
        slope = columns.T @ fixed.residual
        return float(np.linalg.slogdet(matrix)[1]) - float(slope @ np.linalg.solve(matrix, slope))

    def shaped(self) -> Linearisation:
        """The trial's effects among the nuisances, the discrepancies of the model's laws, unscaled, in S."""
        return self._alone.rearranged(self._members, (), shaped=True)

    def without(self, member: Candidate) -> Projected:
        """The linearisation with one of the trial's effects back among the candidates, as the first of
        them."""
        removed = self._index(member)
        rest = [index for index in self._members if index != removed]
        return project(self._everything.rearranged(rest, [removed, *self._others]))

    def size_beyond(self, member: Candidate, tolerance: float) -> float:
        """λ of a member beyond what the model's unknowns and the other members explain, with a discrepancy of
        the others' laws of standard deviation `tolerance`.

        ``λ² = sᵀ(I + C·Cᵀ)⁻¹s``, with s the member's contribution to the whitened readings, C the columns of
        the other laws' discrepancies times the tolerance, and the fitted unknowns projected off both.
        """
        removed = self._index(member)
        rest = [index for index in self._members if index != removed]
        shaped = project(self._alone.rearranged(rest, [removed], shaped=True))
        width = len(member.columns)
        own_law = (f"shape of {member.name} ", f"size of {member.name} ")
        others = [
            width + k for k, name in enumerate(shaped.linearisation.shapes) if not name.startswith(own_law)
        ]
        contribution = shaped.signatures[:, :width] @ self.trial.amplitudes(member)
        columns = shaped.signatures[:, others] * tolerance
        common = columns.T @ contribution
        explained = float(common @ np.linalg.solve(columns.T @ columns + np.eye(len(others)), common))
        return math.sqrt(max(0.0, float(contribution @ contribution) - explained))

    def held(self, member: Candidate) -> list[Floats]:
        """(rows of each record) the contribution of those parameters of a member that the fit left at
        bounds."""
        index = self._index(member)
        start, at_bound = self._everything.starts[index], self.trial.fit.at_bound
        moved = np.where([name in at_bound for name in member.columns], self.trial.amplitudes(member), 0.0)
        return [one.signatures[:, start : start + moved.size] @ moved for one in self._everything.records]

    def _index(self, member: Candidate) -> int:
        """The index of one of the trial's own effects among the candidates."""
        return self.trial.effects.index(member.name)

    def _name(self, index: int) -> str:
        return self._everything.candidates[index].name

    @property
    def _members(self) -> range:
        return range(len(self.trial.candidates))

    @property
    def _others(self) -> range:
        return range(len(self.trial.candidates), len(self._everything.candidates))

    @cached_property
    def _everything(self) -> Linearisation:
        """The model's unknowns are the nuisances and every effect is a candidate, the trial's effects
        first."""
        ranges, present = data_ranges(self.whole.model.family, self.whole.measurements), self.trial.effects
        return self._linearised(
            [one for one in candidates(self.whole.model, self.excluded, ranges) if one.name not in present]
        )

    @cached_property
    def _alone(self) -> Linearisation:
        """The linearisation without the effects to be added, which hold most columns."""
        known: Linearisation | None = self.__dict__.get("_everything")
        return self._linearised(()) if known is None else known

    def _linearised(self, others: Sequence[Candidate]) -> Linearisation:
        """The trial's own effects are the first candidates, followed by `others`."""
        trial = self.trial
        # The effects of the trial are taken out of the unknowns and put into the parameter values: they
        # become the first candidates, as which they can be made nuisances (`view`) or tested (`without`) by
        # rearranging columns, without another simulation.
        problem = trial.fit.problem
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
        members = [_from_here_to_null(one) for one in trial.candidates]
        names, readings = self._shapes_and_switches
        tried = [*members, *others]
        lin = replace(linearise(fixed, self.whole, tried, (names, readings), known=self.known), fit=trial.fit)
        if problem.measurements.table:
            return lin
        return with_scatter(lin, self._undriven(lin), len(names) - len(self.shapes.names))

    @cached_property
    def _shapes_and_switches(self) -> tuple[tuple[str, ...], tuple[Floats, ...]]:
        """Names and readings of the laws' discrepancies, followed by what each switch contributes, in case
        that is the action of an effect without explanatory variables."""
        names, readings = self.shapes.names, self.shapes.readings
        with_columns = {one.effect for one in self.shapes.discrepancies}
        problem = self.trial.fit.problem
        if problem.measurements.table or set(problem.model.with_laws) <= with_columns:
            return names, readings
        switches, moved = switch_columns(self.trial.fit, self.whole)
        if not switches:
            return names, readings
        joined = [np.concatenate(both, axis=2) for both in zip(readings, moved, strict=True)]
        return (*names, *switches), tuple(joined)

    def scatter(self, effect: str) -> SizeScatter | None:
        """Scatter of an effect's size between records; None if the effect has explanatory variables."""
        if effect not in self._scatters:
            self._scatters[effect] = size_scatter(self.shaped(), effect)
        return self._scatters[effect]

    def _undriven(self, lin: Linearisation) -> list[tuple[str, Floats]]:
        """The effects in the model without explanatory variables, with the amplitudes of their parameters."""
        model, values = self.trial.fit.problem.model, self.trial.fit.values
        known = {one.name: float(v) for one, v in zip(self.trial.fit.problem.shared, values, strict=True)}
        columns = [*lin.nuisances, *(name for one in lin.candidates for name in one.columns)]
        with_columns = {one.effect for one in self.shapes.discrepancies}
        result = []
        for effect in (model.effect(name) for name in model.effects):
            if effect.name in with_columns or not effect.terms:
                continue
            null = {
                qualified(effect.name, one.name): one.at_null for one in effect.parameters if not one.shape
            }
            sizes = [known.get(name, null[name]) - null[name] if name in null else 0.0 for name in columns]
            amplitudes = np.array([*sizes, *np.zeros(len(lin.shapes))])
            result += [(effect.name, amplitudes)] if amplitudes.any() else []
        return result

    @cached_property
    def shapes(self) -> ShapeColumns:
        """The changes of the readings by discrepancies of the laws of the effects in the model."""
        model = self.trial.fit.problem.model
        present = [model.effect(name) for name in model.effects]
        return shape_columns(self.trial.fit, self.whole, [one for one in present if one.terms])


def _from_here_to_null(member: Candidate) -> Candidate:
    """The member at the shapes of the fit; with a threshold, by the secant to its null, not the slope."""
    null = {name: member.parameter(name).at_null for name in member.secants}
    return replace(member, shapes={}, secants=null)
