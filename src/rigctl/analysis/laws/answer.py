"""The laws of the effects that a diagnosis names, or that its model has, as the data support them.

In: a search and the set whose effects are asked for. Out: a `LawAnswer` for each effect and variable: the
assumed term, the curve that the data support, and an exponent. The linear problem decides whether the data
support another law at all (`posterior`); only then is a power fitted (`power_law`), because a fit of the
whole model is needed for it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import ALPHA, AT_LIMIT, INTERVAL, SHAPE_TOLERANCE
from rigctl.analysis.laws.posterior import EstimatedLaw, chance_of, estimated_laws, laws_of
from rigctl.analysis.laws.power_law import PowerLaw, fit_power, shown_unit
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.errors import RigctlError
from rigctl.model.model import Model
from rigctl.notebook import worded
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: least share of a misfit that a law must remove to be reported if no effect is named
_NEARLY = 0.8
#: error of an exponent by the rounding of laws near the zero of their variable
_ROUNDING = 5e-4
#: an exponent with a larger standard deviation than this is not reported
_UNKNOWN = 10.0


@dataclass(frozen=True)
class LawAnswer:
    """The law of one effect over one of its explanatory variables.

    Attributes
    ----------
    law: the curve that is drawn; at the fitted power if there is one, else at the effect as fitted.
    unit: in which the variable is shown; `value_unit` that of the term.
    assumed: (points) the term by the library's law.
    differs: the data support another law.
    exponent, exponent_std: of the variable, or of a further power if the assumed law is not a power;
        `assumed_exponent` is None then.
    model: the model with which it was found.
    power: fitted, if the data support another law and one could be written.
    follows: the data show nothing beyond that power.
    fitted: a fit already changes the shape of the law, for example its exponent.
    file: the effect file to which it was written; None if it was not.
    """

    effect: str
    law: EstimatedLaw = field(repr=False)
    unit: str
    value_unit: str
    assumed: Floats = field(repr=False)
    differs: bool
    exponent: float
    exponent_std: float
    assumed_exponent: float | None
    model: Model = field(repr=False)
    power: PowerLaw | None
    follows: bool
    fitted: bool = False
    file: Path | None = None

    @property
    def statement(self) -> str:
        """In words."""
        return worded(self, "findings.laws.law_text")

    @property
    def formula(self) -> str | None:
        """The term that the data support, as in an effect file; None if there is none."""
        return None if self.power is None else "; ".join(self.power.terms.values())

    @property
    def constant(self) -> bool:
        """Whether, by the data, the term does not change with the variable as the assumed law does.

        Its exponent is fitted, and is 0 within its uncertainty or within the shape tolerance.
        """
        fitted = self.power is not None
        return fitted and _hardly_changes(self.assumed_exponent, self.exponent, self.exponent_std)

    @property
    def offered(self) -> Literal["power", "curve", ""]:
        """What an effect file can contain: the fitted power if that is the whole law, or the only option.

        Else the curve itself, for an effect that is a single term over a single variable.
        """
        alone = self.differs and not self.law.others and len(self.law.effect.terms) == 1
        drawn = np.isfinite([self.law.low, self.law.high]).all() and bool(np.any(self.law.asked))
        if alone and drawn and not (self.power is not None and self.follows):
            return "curve"
        return "" if self.power is None else "power"

    @property
    def x(self) -> Floats:
        """(points) the variable, in its unit."""
        return self._driver(self.law.x)

    def document(self) -> dict[str, Any]:
        """Its machine-readable form; the values of the term in SI units of its slot."""
        low, high = (self.exponent + side * INTERVAL * self.exponent_std for side in (-1.0, 1.0))
        known = self.exponent_std < _UNKNOWN
        return {
            "effect": self.effect,
            "driver": self.law.driver.name,
            "unit": self.unit,
            "slot": self.law.slot,
            "value_unit": self.value_unit,
            "x": self.x.tolist(),
            "assumed": _listed(self.assumed),
            "asked": _listed(self.law.asked),
            "low": _listed(self.law.low),
            "high": _listed(self.law.high),
            "differs": self.differs,
            "exponent": {
                "value": self.exponent if known else None,
                "std": self.exponent_std if known else None,
                "low": low if known else None,
                "high": high if known else None,
                "assumed": self.assumed_exponent,
            },
            "follows": self.follows,
            "statement": self.statement,
            "formula": self.formula,
            "file": None if self.file is None else self.file.as_posix(),
        }

    def _driver(self, x: Floats) -> Floats:
        unit = parse_unit(self.unit)
        interval = len(self.law.driver.weights) > 1
        return np.asarray(x / unit.factor if interval else (x - unit.offset) / unit.factor)


def _listed(values: Floats) -> list[float | None]:
    """For programs: missing values are null."""
    return [value if math.isfinite(value) else None for value in values.tolist()]


@dataclass(frozen=True)
class Laws:
    """The laws of all effects in the best set's model, both those named and those already there.

    A law that the data do not distinguish from another needs no fit; the others are fitted when their effect
    is first asked for.
    """

    search: Search = field(repr=False)
    best: RefittedSet = field(repr=False)
    _answers: dict[str, tuple[LawAnswer, ...]] = field(default_factory=dict, repr=False)

    def of(self, effects: Collection[str] | None = None) -> tuple[LawAnswer, ...]:
        """The laws of `effects`, by default of all."""
        answers: list[LawAnswer] = []
        for name, laws in self._estimated.items():
            if effects is None or name in effects:
                if name not in self._answers:
                    self._answers[name] = tuple(_of_effect(self.search, self.best, laws))
                answers += self._answers[name]
        return tuple(answers)

    @cached_property
    def _estimated(self) -> dict[str, list[EstimatedLaw]]:
        by_effect: dict[str, list[EstimatedLaw]] = {}
        if not self.best.fit.problem.model.with_laws:
            return by_effect
        try:
            for law in estimated_laws(self.search, self.best):
                by_effect.setdefault(law.effect.name, []).append(law)
        except RigctlError:  # the model cannot be simulated with deviating laws, so nothing can be drawn
            return {}
        return by_effect


def laws_instead(search: Search) -> tuple[LawAnswer, ...]:
    """The laws that remove nearly all of a misfit that no further effect explains; none if there are none.

    Only effects already in the model are tried: a second effect would leave more than the tests see.
    """
    trial = search.null
    try:
        estimated = estimated_laws(search, trial)
    except RigctlError:
        return ()
    count = sum(trial.fit.problem.whiteners[k].size for k in trial.fit.fitted)
    threshold = _NEARLY * max(trial.chi2 - count, 0.0)
    able = dict.fromkeys(  # in the order of the laws: the iteration order of a set differs between processes
        law.effect.name for law in estimated if law.differs and law.explained * law.noise > threshold
    )
    answers: list[LawAnswer] = []
    for name in able:
        laws = [law for law in estimated if law.effect.name == name]
        answers += [one for one in _of_effect(search, trial, laws) if _takes_all(one, trial, count)]
    return tuple(answers)


def _takes_all(one: LawAnswer, trial: RefittedSet, count: int) -> bool:
    """Whether a fitted power is the whole law, and removes nearly all of the misfit."""
    if one.power is None or not one.follows:
        return False
    return one.power.gain > _NEARLY * (trial.chi2 - count)


def _of_effect(search: Search, best: RefittedSet, laws: list[EstimatedLaw]) -> list[LawAnswer]:
    """The answers for one effect: a power of the variable that explains most is fitted."""
    # The linear problem says whether the data support another law. Only then a power of one variable, the one
    # that explains most, is fitted with everything else; the other variables are judged again at that fit,
    # since a wrong law over one variable is partly absorbed by splines over another.
    asking = [law for law in laws if law.differs or law.clear]
    if not asking:
        return [_plain(law, best) for law in laws]
    first = max(asking, key=lambda law: law.explained)
    search.on_progress(f"Estimating the law of {first.effect.name} over {first.driver.name}")
    power = fit_power(first, best)
    if power is None:
        return [_plain(law, best) for law in laws]
    try:
        after = {law.driver: law for law in laws_of(power.fit, [power.effect])}
    except RigctlError:
        return [_plain(law, best) for law in laws]
    return [
        _fitted(law, after[law.driver], power, best)
        if law is first and law.driver in after
        else _plain(_beside(law, after.get(law.driver)), best)
        for law in laws
    ]


def _beside(law: EstimatedLaw, after: EstimatedLaw | None) -> EstimatedLaw:
    """The law over another variable, as far as the power of the first one leaves anything."""
    if after is None:
        return law
    return replace(law, differs=law.differs and after.differs, clear=law.clear and after.clear)


def _fitted(law: EstimatedLaw, after: EstimatedLaw, power: PowerLaw, best: RefittedSet) -> LawAnswer:
    # The family-wise level counts all laws tested; σ of the exponent is widened by what the fit leaves.
    std = math.hypot(power.std * math.sqrt(after.noise), _ROUNDING)
    assumed = law.assumed_exponent
    z = (power.exponent - (assumed or 0.0)) / std if std > 0.0 else math.inf
    significant = law.tried * chance_of(z, after.degrees) < ALPHA and power.gain > 0.0
    if not significant:
        return _plain(replace(law, clear=False), best)
    curve = replace(after, driver=law.driver)
    return LawAnswer(
        effect=law.effect.name,
        law=curve,
        unit=shown_unit(law, best.fit),
        value_unit=_value_unit(law),
        assumed=law.term.values(after.x),
        differs=True,
        exponent=power.exponent,
        exponent_std=std,
        assumed_exponent=assumed,
        model=best.fit.problem.model,
        power=power,
        follows=not after.differs,
    )


def _plain(law: EstimatedLaw, best: RefittedSet) -> LawAnswer:
    """The law as far as the linear problem determines it."""
    assumed = law.assumed_exponent
    return LawAnswer(
        effect=law.effect.name,
        law=law,
        unit=shown_unit(law, best.fit),
        value_unit=_value_unit(law),
        assumed=law.assumed,
        differs=law.differs,
        exponent=(assumed or 0.0) + law.change,
        exponent_std=law.change_std,
        assumed_exponent=assumed,
        model=best.fit.problem.model,
        power=None,
        follows=False,
        fitted=_fitted_shape(law, best),
    )


def _fitted_shape(law: EstimatedLaw, best: RefittedSet) -> bool:
    """Whether a fit already changes the shape of the law, for example its exponent."""
    values = best.fit.problem.model.effects[law.effect.name]
    return any(one.shape and values[one.name].fit for one in law.effect.parameters)


def _value_unit(law: EstimatedLaw) -> str:
    return law.effect.model_family.slot(law.slot).unit


def _hardly_changes(assumed: float | None, exponent: float, std: float) -> bool:
    """Whether a power that is assumed to change with its variable may be constant: an exponent that may be
    0."""
    return bool(assumed) and abs(exponent) < max(SHAPE_TOLERANCE, AT_LIMIT * std)
