"""The explanatory variables of an effect: the states and inputs on which its terms depend.

A difference of two (``pressure_a − pressure_b``) in a term is one variable. Dependences through a definition
of the family, a local variable of the slot, or the effect's own states are traced back to states and inputs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rigctl.effects.declaration import Effect
from rigctl.effects.writing import RATE, write_out
from rigctl.engine.symbols import Expr
from rigctl.physics.family import InputVariable, ModelFamily, StateVariable


@dataclass(frozen=True)
class Driver:
    """A linear combination of states and inputs on which a term depends.

    Attributes
    ----------
    weights: (variable, weight), in the order of their names.
    unit: in SI.
    """

    weights: tuple[tuple[str, float], ...]
    unit: str

    @property
    def name(self) -> str:
        """For display: ``velocity``, ``pressure_a - pressure_b``."""
        text = ""
        for name, weight in sorted(self.weights, key=lambda one: -one[1]):
            sign = "-" if weight < 0.0 else "+"
            size = "" if abs(weight) == 1.0 else f"{abs(weight):g} "
            text += f" {sign} {size}{name}" if text or weight < 0.0 else f"{size}{name}"
        return text.strip()

    @property
    def variables(self) -> frozenset[str]:
        """The states and inputs in it."""
        return frozenset(name for name, _ in self.weights)


def drivers(effect: Effect) -> tuple[Driver, ...]:
    """The variables of all of an effect's terms, each once; none for a constant term."""
    family = effect.model_family
    result: dict[tuple[tuple[str, float], ...], Driver] = {}
    units = _leaves(family)
    for term in write_out(effect, family, rates=False).expressions:
        # Rates of states stay variables here (`rates=False`): a lag that depends on dx/dt is a function of x,
        # not of everything on which dx/dt depends.
        for form in _forms(term, frozenset(units), {}):
            weights = _normalised(form)
            unit = units[weights[0][0]]
            result.setdefault(weights, Driver(weights, unit))
    return tuple(result.values())


def driver_variables(effect: Effect) -> frozenset[str]:
    """All states and inputs on which an effect depends."""
    return frozenset().union(*(one.variables for one in drivers(effect)))


def _leaves(family: ModelFamily) -> dict[str, str]:
    named: tuple[StateVariable | InputVariable, ...] = (*family.states, *family.inputs)
    return {item.name: item.unit for item in named}


def _forms(expr: Expr, leaves: frozenset[str], done: dict[int, bool]) -> Iterator[dict[str, float]]:
    """The largest linear combinations of leaves in an expression."""
    form = _linear(expr, leaves)
    if form:
        yield form
        return
    # Expressions are a graph with shared parts: each node is descended into once.
    if done.setdefault(expr.index, False):
        return
    done[expr.index] = True
    for arg in expr.args:
        yield from _forms(arg, leaves, done)


def _linear(expr: Expr, leaves: frozenset[str]) -> dict[str, float] | None:
    """An expression as a weighted sum of leaves; None if it is not one."""
    if expr.op == "variable":
        name = expr.name.removeprefix(RATE)
        return {name: 1.0} if name in leaves else None
    if expr.op == "negative":
        inner = _linear(expr.args[0], leaves)
        return None if inner is None else {name: -weight for name, weight in inner.items()}
    if expr.op in ("+", "-"):
        left, right = (_linear(arg, leaves) for arg in expr.args)
        if left is None or right is None:
            return None
        sign = 1.0 if expr.op == "+" else -1.0
        total = dict(left)
        for name, weight in right.items():
            total[name] = total.get(name, 0.0) + sign * weight
        return {name: weight for name, weight in total.items() if weight}
    return None


def _normalised(form: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """A linear form up to its sign: the weight of the first name is positive."""
    ordered = sorted(form.items())
    sign = 1.0 if ordered[0][1] > 0.0 else -1.0
    return tuple((name, sign * weight) for name, weight in ordered)
