"""A model with one more effect, fitted by itself at sizes up to the limit of its usual range.

In: a comparison and a candidate. Out: `Alone`. For tables of single values, whose effects are distinguished
by refits alone: there are few values, fits are cheap, and effects may be so large that scores at their null
say little of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.search.refit import COARSE, NEAR, ROOM, STEP, chi2_of, starting_values
from rigctl.effects.declaration import EffectParameter
from rigctl.engine.least_squares import Options, Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.unknowns import effect_unknown

#: as `COARSE`, with the effect held at a size
_COARSE_HELD = 5e-3
#: number of sizes from the typical one to the bound at which an effect is evaluated, in each direction
_STEPS = 3
#: a fit that leaves less than this share of a misfit has found what the effect can explain
_EXPLAINED = 0.5
#: a fit is restarted at a size at which less than this share of its χ² is left
_BETTER = 0.9


@dataclass(frozen=True)
class Alone:
    """A model with one effect, fitted; `chi2` is what it leaves.

    `at_amplitudes` are the fits of the model's own parameters with the effect held at a series of sizes, if
    these were made (see the function).
    """

    candidate: Candidate
    fit: FitResult = field(repr=False)
    chi2: float
    at_amplitudes: tuple[FitResult, ...] = field(default=(), repr=False)


def alone(
    before: ModelComparison, candidate: Candidate, *, from_null: bool, rival: float = math.inf
) -> Alone | None:
    """Fit a model with one more effect, starting at its null or at its typical size.

    The action of an effect may be nonlinear in its size, and a fit stays in the minimum in which it starts: a
    fit that explains little is restarted at the size, of a series up to the bound, at which the effect
    explains most. None if the model cannot be simulated there.

    Parameters
    ----------
    rival: χ² that another effect leaves: a fit at a size that leaves far more is coarse.
    """
    beside = _WithEffect.of(before, candidate)
    if beside is None:
        return None
    share = 0.0 if from_null else 1.0
    begin = {
        column: declared.at_null + share * (declared.start - declared.at_null)
        for column, declared in _declared(candidate).items()
    }
    # A fit from the null (or the typical size) suffices if it explains at least half of the misfit. Otherwise
    # the profile of χ² over the size of the effect shows where a deeper minimum is.
    fitted = beside.fitted(begin, before.fit)
    if fitted is not None and chi2_of(fitted) < _EXPLAINED * chi2_of(before.fit):
        return Alone(candidate, fitted, chi2_of(fitted))
    held = beside.held_at_amplitudes(rival)
    if held:
        amplitudes, nearest = min(held, key=lambda one: chi2_of(one[1]))
        if fitted is None or chi2_of(nearest) < _BETTER * chi2_of(fitted):
            fitted = beside.fitted(amplitudes, nearest)
    return (
        None if fitted is None else Alone(candidate, fitted, chi2_of(fitted), tuple(one for _, one in held))
    )


def at_amplitudes(before: ModelComparison, tried: Alone, rival: float = math.inf) -> tuple[FitResult, ...]:
    """The model's own parameters fitted with an effect held at sizes from beyond its typical one up to the
    limit of its usual range."""
    beside = None if tried.at_amplitudes else _WithEffect.of(before, tried.candidate)
    return (
        tried.at_amplitudes if beside is None else tuple(fit for _, fit in beside.held_at_amplitudes(rival))
    )


def near_best(fits: Mapping[str, Alone | None]) -> list[str]:
    """The effects whose fits come close to the best one, best first."""
    fitted = [one for one in fits.values() if one is not None]
    fitted.sort(key=lambda one: one.chi2)
    return [one.candidate.name for one in fitted if one.chi2 < fitted[0].chi2 + NEAR]


def _declared(candidate: Candidate) -> dict[str, EffectParameter]:
    return {name: candidate.parameter(name) for name in candidate.columns}


def _amplitudes(candidate: Candidate) -> list[list[dict[str, float]]]:
    """Sizes of an effect's parameters, varied together, in equal ratios from the typical ones to the bounds,
    upwards and downwards."""
    sides = []
    for side in (1.0, -1.0):
        starts = []
        for k in range(1, _STEPS + 1):
            amplitudes = {}
            for column, declared in _declared(candidate).items():
                typical = side * (declared.start - declared.at_null)
                limit = (declared.high if typical > 0.0 else declared.low) - declared.at_null
                if typical and limit / typical > 0.0:
                    amplitudes[column] = declared.at_null + typical * (limit / typical) ** (k / _STEPS)
            if len(amplitudes) == len(candidate.columns):
                starts.append(amplitudes)
        sides.append(starts)
    return sides


def _inside(candidate: Candidate, column: str, value: float) -> float:
    declared = _declared(candidate)[column]
    room = ROOM * (declared.high - declared.low)
    return float(np.clip(value, declared.low + room, declared.high - room))


@dataclass(frozen=True)
class _WithEffect:
    """The equations of a model with one more effect, and fits in them.

    They take a third of the time of the equations with the whole library.
    """

    before: ModelComparison
    candidate: Candidate
    problem: Problem

    @classmethod
    def of(cls, before: ModelComparison, candidate: Candidate) -> _WithEffect | None:
        """None if the effect's term cannot be added."""
        try:
            model = before.fit.at_end.with_effect(candidate.effect, starting_values(candidate))
            return cls(before, candidate, before.fit.problem.rebuilt(model))
        except RigctlError:
            return None

    def held_at_amplitudes(self, rival: float) -> list[tuple[dict[str, float], FitResult]]:
        """Sizes of the effect, and the fits of the model's own parameters at them; sizes that fail are left
        out.

        Each fit starts where the one before ended, which has compensated for most of the effect already.
        """
        fits = []
        for side in _amplitudes(self.candidate):
            begin = self.before.fit
            for amplitudes in side:
                held = {name: _inside(self.candidate, name, one) for name, one in amplitudes.items()}
                fitted = self._fit(held, (), begin, rival)
                if fitted is not None:
                    fits.append((amplitudes, fitted))
                    begin = fitted
        return fits

    def fitted(self, amplitudes: Mapping[str, float], begin: FitResult) -> FitResult | None:
        """The model's own parameters and the effect's, which start at `amplitudes`, inside their bounds."""
        free = [
            effect_unknown(
                self.candidate.effect, name.partition(".")[2], _inside(self.candidate, name, amplitude)
            )
            for name, amplitude in amplitudes.items()
        ]
        return self._fit({}, free, begin)

    def _fit(
        self, held: Mapping[str, float], free: Sequence[Unknown], begin: FitResult, rival: float = math.inf
    ) -> FitResult | None:
        names = self.problem.compiled.system.parameter_names
        base = self.problem.base.copy()
        for name, value in held.items():
            base[names.index(name)] = value
        at = {u.name: float(value) for u, value in zip(begin.problem.shared, begin.values, strict=True)}
        unknowns = self.before.fit.problem.shared
        # a parameter that acted on nothing in that fit is no unknown of it
        shared = [replace(u, start=min(max(at.get(u.name, u.start), u.lower), u.upper)) for u in unknowns]
        problem = self.problem.with_shared([*shared, *free], base)
        cost, step = (_COARSE_HELD, Options.largest_step) if held else (COARSE, STEP)
        try:
            return fit(
                problem,
                self.before.fit.held_out,
                local=begin.local,
                cost=cost,
                largest_step=step,
                rival=0.5 * rival,
            )
        except RigctlError:
            return None
