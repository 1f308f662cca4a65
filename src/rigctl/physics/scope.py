"""The variables of a model by name, each evaluated at its first use.

In: a family and the values of its states, inputs and parameters. Out, on demand: definitions, rates,
readings, and the sums of effects at slots. The order of the equations does not matter, since each name is
evaluated when it is first needed and kept; an equation that depends on itself is found in the same way. The
same equations work with expressions (to be compiled) and with plain numbers (to be tested): a scope holds
either.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from rigctl.engine.symbols import Expr, Scalar, check_dimension
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.family import Formula, ModelFamily, Slot
from rigctl.units import parse_unit


@dataclass(frozen=True)
class Addition:
    """A term or a factor at `slot`; `label` is its origin in messages."""

    slot: str
    label: str
    formula: Formula


class Scope:
    """Variables by attribute: ``m.pressure_a``, ``m.density``; slots by `total` and `factor`.

    Parameters
    ----------
    family: of the equations.
    known: values of its states, inputs and parameters, and of the other variables that the additions use.
    additions: the terms and factors of effects at the family's slots.
    options: the chosen variants of the equations; by default the first of each.
    """

    def __init__(
        self,
        family: ModelFamily,
        known: Mapping[str, Scalar],
        *,
        additions: Sequence[Addition] = (),
        options: Mapping[str, str] | None = None,
    ) -> None:
        self._family = family
        self._known = dict(known)
        self._formulas = {item.name: item.formula for item in family.definitions}
        self._rates = {state.name: state.rate for state in family.states}
        self._additions = tuple(additions)
        self._options = {name: choices[0] for name, choices in family.options.items()} | dict(options or {})
        self._working: list[str] = []

    def __getattr__(self, name: str) -> Scalar:
        if name.startswith("__"):
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, name: str) -> Scalar:
        """The variable `name`.

        Raises
        ------
        RigctlError
            there is none, or it depends on itself.
        """
        if name not in self._known:
            formula = self._formulas.get(name)
            if formula is None:
                raise unknown_name("variable", name, {*self._known, *self._formulas})
            self._known[name] = self._work_out(name, formula)
        return self._known[name]

    def constant(self, value: float, unit: str) -> Scalar:
        """A number with its dimension, for use in an equation; `unit` is an SI unit."""
        # Which kind of scope this is shows in what it holds: with symbols a number becomes a constant of
        # their graph, with a dimension to be checked.
        for known in self._known.values():
            if isinstance(known, Expr):
                return known.graph.constant(value, parse_unit(unit).dimension)
        return value

    def table(self, name: str, x: Scalar) -> Scalar:
        """The value at x of one of the family's tables."""
        return self._family.tables[name](self, x)

    def rate(self, state: str) -> Scalar:
        """The derivative of a state of the family."""
        key = f"rate of {state}"
        if key not in self._known:
            if state not in self._rates:
                raise unknown_name("state", state, self._rates)
            self._known[key] = self._work_out(key, self._rates[state])
        return self._known[key]

    def option(self, name: str) -> str:
        """The chosen variant of the equations.

        Raises
        ------
        RigctlError
            the option does not have this choice.
        """
        chosen, choices = self._options[name], self._family.options[name]
        if chosen not in choices:
            raise unknown_name(f"choice of the option '{name}'", chosen, choices)
        return chosen

    def total(self, slot: str, **local: Scalar) -> Scalar:
        """The sum of the effects' terms at `slot`; exactly 0 if there are none.

        `local` are the values of the slot's local variables.
        """
        declared = self._declared(slot, "sum")
        result: Scalar = 0.0
        for term in self._terms(declared, local):
            result = result + term
        return result

    def factor(self, slot: str, **local: Scalar) -> Scalar:
        """The product of the effects' factors at `slot`; exactly 1 if there are none."""
        declared = self._declared(slot, "product")
        result: Scalar = 1.0
        for term in self._terms(declared, local):
            result = result * term
        return result

    def _declared(self, slot: str, combine: str) -> Slot:
        declared = self._family.slot(slot)
        if declared.combine != combine:
            raise RigctlError(f"the slot {slot} is a {declared.combine}", expected=combine)
        return declared

    def _terms(self, slot: Slot, local: Mapping[str, Scalar]) -> Iterator[Scalar]:
        for addition in self._additions:
            if addition.slot == slot.name:
                # A local variable (of a slot that is used at several places with other arguments) must not
                # outlive its term: the next use has other values, and what is kept in `_known` is kept for
                # good.
                with self._locally(local):
                    value = self._work_out(f"{addition.label} at {slot.name}", addition.formula)
                _check(value, slot, addition.label)
                yield value

    @contextmanager
    def _locally(self, local: Mapping[str, Scalar]) -> Iterator[None]:
        """Make the slot's local variables available while one term is evaluated."""
        hidden = {name: self._known[name] for name in local if name in self._known}
        self._known |= local
        try:
            yield
        finally:
            for name in local:
                del self._known[name]
            self._known |= hidden

    def _work_out(self, what: str, formula: Formula) -> Scalar:
        if what in self._working:
            circle = " -> ".join([*self._working[self._working.index(what) :], what])
            raise RigctlError(f"an equation depends on itself: {circle}")
        self._working.append(what)
        try:
            return formula(self)
        finally:
            self._working.pop()


def _check(value: Scalar, slot: Slot, label: str) -> None:
    if isinstance(value, Expr):
        check_dimension(value, parse_unit(slot.unit).dimension, f"the term of {label} at {slot.name}")
