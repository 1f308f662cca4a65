"""The term of an effect as a function of one of its variables, the others at their averages in the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.drivers import Driver
from rigctl.effects.writing import write_out
from rigctl.engine.symbols import Expr, evaluate, variables_of

Floats = NDArray[np.float64]

#: step of a parameter for a numerical slope, as a share of its magnitude
_STEP = 1e-4


@dataclass(frozen=True)
class LawTerm:
    """One term of an effect at a fit.

    Attributes
    ----------
    slot: where it acts; for an effect with several slots, the first that depends on the variable.
    known: every other variable of the term, SI: parameters as fitted, states and inputs as their median.
    nothing: the term when the effect is off: 1 if the slot multiplies.
    """

    effect: Effect
    driver: Driver
    slot: str
    expr: Expr = field(repr=False)
    known: Mapping[str, float] = field(repr=False)
    nothing: float = 0.0

    def values(self, x: Floats, changed: Mapping[str, float] | None = None) -> Floats:
        """(points) what the term adds at x; for a factor, its difference from 1."""
        known = {**self.known, **(changed or {})}
        weights = dict(self.driver.weights)
        at = sum(weight * known[name] for name, weight in weights.items())
        square = sum(weight**2 for weight in weights.values())
        terms = []
        for value in x.tolist():
            moved = {name: known[name] + weight * (value - at) / square for name, weight in weights.items()}
            terms.append(evaluate(self.expr, {**known, **moved}) - self.nothing)
        return np.array(terms)

    def slope(self, name: str, x: Floats) -> Floats:
        """(points) its derivative by a parameter of the effect, by its name in a system; 0 by any other."""
        if name not in self.known or not name.startswith(f"{self.effect.name}."):
            return np.zeros(x.size)
        value = self.known[name]
        declared = self.effect.parameter(name.partition(".")[2])
        step = _STEP * max(abs(value), abs(declared.start - declared.at_null), 1e-300)
        up, down = (self.values(x, {name: value + side * step}) for side in (1.0, -1.0))
        return np.asarray((up - down) / (2.0 * step))


def law_term(known: Mapping[str, float], effect: Effect, driver: Driver) -> LawTerm | None:
    """The term of `effect` that depends on `driver`, all other variables as `known`; None if it has no curve.

    That is a term which depends on a rate of change or on a state of the effect itself, and so has a memory.
    """
    family = effect.model_family
    for slot, uses in write_out(effect, family, rates=False).terms.items():
        named = {variable.name for variable in variables_of(uses[0])}
        if driver.variables <= named <= set(known):
            states = {qualified(effect.name, state.name) for state in effect.states}
            if not named & states:
                nothing = 1.0 if family.slot(slot).combine == "product" else 0.0
                return LawTerm(effect, driver, slot, uses[0], {name: known[name] for name in named}, nothing)
    return None
