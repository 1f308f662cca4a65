"""What would remove a misfit on records that no fit saw: other initial states, other values, another
effect.

In: a fit with these records as its fitted ones, and its tests. Out: `Remedy`s, by the share of the misfit
that each removes on those records alone. They say why a prediction fails. The model is not changed, and
nothing is chosen by them: the records would not be held out any more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.effects.declaration import EffectState, qualified
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.unknowns import LocalUnknown, shared_unknowns
from rigctl.units import parse_unit

#: least share of the misfit for a remedy to be reported
_LEAST = 0.2
#: one effect's states are enough if they remove this share of what all states remove
_ENOUGH = 0.95
#: a value has changed if it moved by more than this many standard deviations, and this share of it
_SURE, _NOTABLE = 3.0, 0.05
_MOST_VALUES = 3


@dataclass(frozen=True)
class Remedy:
    """A change that would remove part of the misfit.

    Attributes
    ----------
    kind: "starts": the effects' own states are free at the start of each record; "values": the model's
        parameters are fitted to these records alone; "effect": one more effect of the library, to first
        order.
    names: the effects, or the parameters that moved.
    share: of the misfit beyond noise that it removes, 0 to 1.
    rmse: by channel with it, SI; empty to first order.
    moved: (parameter, before, after, unit) in the unit in which it is shown.
    """

    kind: Literal["starts", "values", "effect"]
    names: tuple[str, ...]
    share: float
    rmse: dict[str, float]
    moved: tuple[tuple[str, float, float, str], ...] = ()


def remedies(fitted: FitResult, judged: ModelComparison) -> tuple[Remedy, ...]:
    """The remedies on the records of `fitted`, the best first; `judged` is the same with its tests."""
    # Three causes of a worse prediction: the record began in another state than assumed, the bench has other
    # values here, or the model lacks something that these conditions show.
    tried = [_starts(fitted), _values(fitted), _effect(fitted, judged)]
    kept = [one for one in tried if one is not None and one.share >= _LEAST]
    return tuple(sorted(kept, key=lambda one: -one.share))


def misfit(fitted: FitResult) -> float:
    """Sum of squared errors over the noise variance, beyond the noise: ``Σ n·(nrmse² − 1)``."""
    return sum(one.count * (one.nrmse**2 - 1.0) for one in fitted.errors.values())


def _share(before: FitResult, after: FitResult, parameters: int) -> float:
    """The share of the misfit removed, with a penalty of ``ln N`` for each parameter."""
    count = sum(one.count for one in before.errors.values())
    fall = misfit(before) - misfit(after) - parameters * math.log(max(count, 2))
    return _of(fall, misfit(before))


def _of(fall: float, total: float) -> float:
    return min(max(fall / total, 0.0), 1.0) if total > 0.0 else 0.0


def _starts(fitted: FitResult) -> Remedy | None:
    """The remedy with the effects' own states free at the start of each record."""
    model = fitted.problem.model
    states = {name: model.effect(name).states for name in model.effects}
    stores = {name: its_states for name, its_states in states.items() if its_states}
    everything = _with_free(fitted, stores)
    if everything is None:
        return None
    for name, its_states in stores.items() if len(stores) > 1 else ():
        alone = _with_free(fitted, {name: its_states})
        if alone is not None and alone.share >= _ENOUGH * everything.share:
            return alone
    return everything


def _with_free(fitted: FitResult, stores: dict[str, tuple[EffectState, ...]]) -> Remedy | None:
    problem = _alone(fitted)
    names = problem.compiled.system.state_names
    extra = {
        qualified(effect, state.name): state.scale
        for effect, its_states in stores.items()
        for state in its_states
        if qualified(effect, state.name) in names
    }
    if not extra:
        return None
    local = tuple(
        (
            *record_local,
            *(_free(name, float(start[names.index(name)]), scale) for name, scale in extra.items()),
        )
        for record_local, start in zip(problem.local, problem.starts, strict=True)
    )
    try:
        freed = fit(replace(problem, local=local), refit=False)
    except RigctlError:  # the model cannot be simulated, so this is no remedy
        return None
    share = _share(fitted, freed, len(extra) * len(problem.records))
    return Remedy("starts", tuple(stores), share, _rmse(freed))


def _alone(fitted: FitResult) -> Problem:
    """These records alone, with the shared unknowns starting where they were fitted."""
    known = _known(fitted)
    problem = fitted.problem.only(fitted.fitted)
    return problem.with_shared(
        [replace(u, start=min(max(known[u.name], u.lower), u.upper)) for u in problem.shared]
    )


def _known(fitted: FitResult) -> dict[str, float]:
    """The values of the model's parameters and of all other shared unknowns."""
    names = [unknown.name for unknown in fitted.problem.shared]
    return {**fitted.problem.model.values, **dict(zip(names, fitted.values.tolist(), strict=True))}


def _free(name: str, start: float, scale: float) -> LocalUnknown:
    return LocalUnknown(name, Unknown(name, start, scale=scale), "start")


def _values(fitted: FitResult) -> Remedy | None:
    """The remedy with the model's parameters fitted to these records alone."""
    problem, known = _alone(fitted), _known(fitted)
    free = [
        replace(one, start=min(max(known[one.name], one.lower), one.upper))
        for one in shared_unknowns(problem.model)
    ]
    others = [one for one in problem.shared if one.name not in problem.model.fitted]
    if not free:
        return None
    try:
        freed = fit(problem.with_shared([*free, *others]), local=[fitted.local[k] for k in fitted.fitted])
    except RigctlError:  # too few values for the parameters, or the model cannot be simulated
        return None
    moved = _moved(fitted, freed)
    share = _share(fitted, freed, len(freed.problem.shared))
    return Remedy("values", tuple(one[0] for one in moved), share, _rmse(freed), moved) if moved else None


def _moved(before: FitResult, after: FitResult) -> tuple[tuple[str, float, float, str], ...]:
    """The parameters that moved most relative to their uncertainty."""
    model, moved = before.problem.model, []
    known = _known(before)
    values = zip([u.name for u in after.problem.shared], after.values.tolist(), strict=True)
    for name, value in values:
        if name not in model.fitted:
            continue
        effect, dot, parameter = name.partition(".")
        declared = model.effect(effect).parameter(parameter) if dot else model.family.parameter(name)
        unit = parse_unit(declared.unit)
        change = value - known[name]
        std = after.std.get(name, math.inf)
        if abs(change) > max(_SURE * std, _NOTABLE * abs(known[name])):
            shown = (unit.from_si(known[name]), unit.from_si(value))
            moved.append((abs(change) / max(std, 1e-300), (name, *shown, declared.unit)))
    moved.sort(key=lambda one: -one[0])
    return tuple(one for _, one in moved[:_MOST_VALUES])


def _effect(fitted: FitResult, judged: ModelComparison) -> Remedy | None:
    """The remedy with one more effect of the library, by its score."""
    visible = [one for one in judged.screening.scores if one.effect not in judged.screening.untestable]
    best = max(visible, key=lambda score: score.gain, default=None)
    if best is None or fitted.problem.measurements.table:  # a few values are compatible with every effect
        return None
    whitened = sum(one.count * (one.chi2_reduced - 1.0) for one in fitted.errors.values())
    return Remedy("effect", (best.effect,), _of(best.gain, whitened), {})


def _rmse(fitted: FitResult) -> dict[str, float]:
    return {name: one.rmse for name, one in fitted.errors.items()}


def still_missing(tried: Sequence[Remedy]) -> bool:
    """True if no remedy removes most of the misfit."""
    return not tried or tried[0].share < 0.5
