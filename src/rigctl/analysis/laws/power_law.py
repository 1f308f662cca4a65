"""A power of a variable as the law of an effect: fitted, judged, and written as a user's effect.

The term T of an effect becomes ``T·(√(x² + c²)/x_0)^(n − n_0)``: a power of x with exponent n if T is a power
with exponent n_0, and T times a power otherwise. What the data show beyond such a power is determined again
at that fit, where the linearisation is most accurate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.analysis.laws.posterior import EstimatedLaw
from rigctl.analysis.search.refit import RefittedSet
from rigctl.effects.declaration import Effect, EffectParameter, Term, qualified
from rigctl.effects.drivers import Driver
from rigctl.effects.equations import terms_in_symbols
from rigctl.effects.examine import examine
from rigctl.effects.user.formula import read_term
from rigctl.effects.user.formula_text import formula_text, number_text
from rigctl.effects.user.names import taken_names, term_types
from rigctl.effects.writing import write_out
from rigctl.engine.least_squares import started
from rigctl.engine.symbols import variables_of
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.model import Model, Value
from rigctl.physics.family import ModelFamily
from rigctl.units import parse_unit

#: largest difference of an exponent from the assumed one
_FURTHEST = 2.5
#: largest difference at which the fit starts
_BEGIN = 0.6
#: share of a variable's largest magnitude within which a power of it is rounded
_ROUNDED = 1e-3
#: the fit ends when the next step would lower its cost by less than this share; a parameter may double
_COST, _STEP = 1e-6, 1.0


@dataclass(frozen=True)
class PowerLaw:
    """An effect with a power of one of its variables, fitted.

    Attributes
    ----------
    effect: as declared in a user's file.
    terms: the text of each of its terms.
    exponent: n, or n − n_0 if the assumed law is not a power.
    std: of the exponent, with the noise that the fit leaves.
    fit: of the model with this effect in place of the original one.
    gain: the reduction of χ².
    """

    effect: Effect
    terms: Mapping[str, str]
    exponent: float
    std: float
    fit: FitResult = field(repr=False)
    gain: float


def fit_power(law: EstimatedLaw, trial: RefittedSet) -> PowerLaw | None:
    """The power fitted to a law; None if its term cannot be written in a file, or not be fitted."""
    definition = power_effect(law, trial.fit.at_end)
    if definition is None:
        return None
    # The fit starts at the exponent that the linear problem predicts, but no further than that is valid.
    effect, terms = definition
    base = law.assumed_exponent or 0.0
    begin = base + float(np.clip(law.change, -_BEGIN, _BEGIN))
    try:
        refitted = _fitted(trial.fit, law.effect, effect, begin)
    except RigctlError:  # the model cannot be simulated there
        return None
    name = qualified(effect.name, EXPONENT)
    names = [unknown.name for unknown in refitted.problem.shared]
    if (
        refitted.solution is None
        or trial.fit.solution is None
        or name not in names
        or name in refitted.at_bound
    ):
        return None
    return PowerLaw(
        effect=effect,
        terms=terms,
        exponent=float(refitted.values[names.index(name)]),
        std=refitted.std[name],
        fit=refitted,
        gain=2.0 * (trial.fit.solution.cost - refitted.solution.cost),
    )


#: name of a power's parameter
EXPONENT = "exponent"


def power_effect(law: EstimatedLaw, model: Model) -> tuple[Effect, dict[str, str]] | None:
    """The effect with a power of the law's variable, and the text of its terms; None if impossible."""
    old, family = law.effect, model.family
    if old.states or EXPONENT in ({p.name for p in old.parameters} | taken_names(family)):
        return None
    parameters = (*_old_parameters(old, model), _exponent(law))
    try:
        terms = dict(_terms(law, family))
        read: tuple[tuple[str, Term], ...] = tuple(
            (slot, read_term(text, family, family.slot(slot), parameters)) for slot, text in terms.items()
        )
    except (RigctlError, TypeError):  # a rate of change or a look-up table cannot be written in a file
        return None
    effect = Effect(
        name=f"{old.name}_power",
        family=old.family,
        summary=f"{old.name} with a power of {law.driver.name}.",
        equation="; ".join(f"{slot}: {text}" for slot, text in terms.items()),
        source=old.source,
        looks_like=old.looks_like,
        terms=read,
        parameters=parameters,
        kind=old.kind,
        instead_of=(old.name,),
        needs=old.needs,
        own_family=old.own_family,
    )
    return None if examine(effect, family) else (effect, terms)


def _old_parameters(effect: Effect, model: Model) -> tuple[EffectParameter, ...]:
    """The effect's own parameters, which start at their fitted values."""
    parameters = []
    for one in effect.parameters:
        value = model.effects[effect.name][one.name].si
        low, high = one.bounds_around(value)
        start = value if value != one.null else one.start
        parameters.append(
            replace(one, start=start, low=low, high=high, grid=(), within="", shares=(), at_least=None)
        )
    return tuple(parameters)


def _exponent(law: EstimatedLaw) -> EffectParameter:
    base = law.assumed_exponent or 0.0
    phrase = "of" if law.assumed_exponent is not None else "of a further power of"
    return EffectParameter(
        EXPONENT, "1", None, base, base - _FURTHEST, base + _FURTHEST, f"{phrase} {law.driver.name}"
    )


def _terms(law: EstimatedLaw, family: ModelFamily) -> dict[str, str]:
    old = law.effect
    names = {qualified(old.name, one.name): one.name for one in old.parameters}
    written = write_out(old, family, rates=False).terms
    driven = {
        slot
        for slot, uses in written.items()
        if law.driver.variables <= {variable.name for expr in uses for variable in variables_of(expr)}
    }
    terms = {}
    for slot, expr in terms_in_symbols(old, family).items():
        declared = family.slot(slot)
        types = term_types(family, declared, old.parameters)
        points = {name for name, one in types.items() if one.temperature == "point"}
        text = formula_text(
            expr, names, points | {known for known, plain in names.items() if plain in points}
        )
        if slot in driven:
            power = _power_text(law, points)
            multiplies = declared.combine == "product"
            text = f"1 + (({text}) - 1)*{power}" if multiplies else f"({text})*{power}"
        terms[slot] = text
    return terms


def _power_text(law: EstimatedLaw, points: set[str]) -> str:
    """``(absolute(x, c)/(x_0))^(exponent - n_0)``, which is 1 at the largest x."""
    base, dimension = law.assumed_exponent, parse_unit(law.driver.unit).dimension
    largest = float(f"{np.abs(law.x).max():.3g}")
    width, reference = (number_text(value, dimension) for value in (_ROUNDED * largest, largest))
    less = "" if not base else f" - {number_text(base)}" if base > 0.0 else f" + {number_text(-base)}"
    exponent = f"({EXPONENT}{less})" if less else EXPONENT
    return f"(absolute({driver_text(law.driver, points)}, {width})/({reference}))^{exponent}"


def driver_text(driver: Driver, points: set[str] | frozenset[str] = frozenset()) -> str:
    """A variable as a formula in a file."""
    single = len(driver.weights) == 1 and driver.weights[0][1] == 1.0
    if single or all(name not in points for name, _ in driver.weights):
        return driver.name if all(abs(w) == 1.0 for _, w in driver.weights) else _weighted(driver)
    if sorted(weight for _, weight in driver.weights) == [-1.0, 1.0]:
        return driver.name  # the difference of two temperatures is an interval
    return _weighted(driver, points)


def _weighted(driver: Driver, points: set[str] | frozenset[str] = frozenset()) -> str:
    parts = []
    for name, weight in driver.weights:
        text = f"({name} - 0 K)" if name in points else name
        parts.append(f"{number_text(weight)}*{text}" if weight >= 0.0 else f"({number_text(weight)})*{text}")
    return " + ".join(parts)


def _fitted(before: FitResult, old: Effect, new: Effect, begin: float) -> FitResult:
    """The model with the new effect in place of the old one, fitted from where the old one ended."""
    model = before.model
    known = {name: value.si for name, value in model.effects[old.name].items()}
    free = {name for name, value in model.effects[old.name].items() if value.fit}
    declared = new.parameter(EXPONENT)
    known[EXPONENT] = min(max(begin, declared.low), declared.high)
    changed = model.without_effect(old.name).with_effect(new, known)
    settings: dict[str, Value] = {
        name: replace(value, fit=name in free or name == EXPONENT)
        for name, value in changed.effects[new.name].items()
    }
    changed = replace(changed, effects={**changed.effects, new.name: settings})
    problem = before.problem.rebuilt(changed)
    values = {unknown.name: float(v) for unknown, v in zip(before.problem.shared, before.values, strict=True)}
    starts = []
    for unknown in problem.shared:
        effect, _, parameter = unknown.name.partition(".")
        source = qualified(old.name, parameter) if effect == new.name else unknown.name
        value = values.get(source, unknown.start)
        starts.append(min(max(value, unknown.lower), unknown.upper))
    problem = problem.with_shared(started(problem.shared, np.array(starts)))
    return fit(problem, before.held_out, local=before.local, cost=_COST, largest_step=_STEP)


def shown_unit(law: EstimatedLaw, fitted: FitResult) -> str:
    """The unit in which the law's variable is shown: that of a channel of its dimension, else SI."""
    interval = len(law.driver.weights) > 1
    return fitted.problem.measurements.unit_for(law.driver.unit, interval=interval)
