"""The terms of an effect as they appear in the equations of its family."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigctl.effects.declaration import Effect, qualified
from rigctl.engine.symbols import Expr, Graph, Scalar, check_dimension
from rigctl.engine.system import after, before
from rigctl.errors import RigctlError
from rigctl.physics.family import Formula, ModelFamily, Slot
from rigctl.physics.scope import Addition, Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import parse_unit


@dataclass
class Written:
    """The result of writing an effect into its family's equations.

    Attributes
    ----------
    terms: for each slot, the term at every point of the equations that uses the slot.
    rates: of the effect's own states.
    refused: the slot whose term could not be written, and the reason.
    """

    terms: dict[str, list[Expr]] = field(default_factory=dict)
    rates: list[Expr] = field(default_factory=list)
    refused: tuple[str, RigctlError] | None = None

    @property
    def expressions(self) -> list[Expr]:
        """All terms, and the rates."""
        return [expr for uses in self.terms.values() for expr in uses] + self.rates


#: prefix of the variable for the rate of a state if rates are not substituted
RATE = "rate of "


def write_out(effect: Effect, family: ModelFamily, *, rates: bool = True) -> Written:
    """The terms of `effect` in symbols: the family's states, inputs and parameters, and the effect's own.

    Without `rates`, the rate of a state in a term is a variable, not that state's equation.
    """
    written = Written()
    graph = Graph()
    known = _variables(graph, effect, family)
    if not rates:
        known |= {
            f"{RATE}{state.name}": graph.variable(
                f"{RATE}{state.name}", parse_unit(state.unit).dimension / parse_unit("s").dimension
            )
            for state in family.states
        }
    # The terms are not called by themselves: the family's equations are evaluated, and each use of a slot
    # records the term it receives. So a slot with local variables gives one term per use, with the arguments
    # of that use.
    scope = Scope(
        family,
        known,
        additions=[
            Addition(slot, effect.name, _noting(written, graph, family.slot(slot), effect.bind(term)))
            for slot, term in effect.terms
        ],
    )
    try:
        _write_equations(scope, graph, effect, family, written)
    except RigctlError as error:
        written.refused = written.refused or (effect.slots[0], error)
    return written


def _variables(graph: Graph, effect: Effect, family: ModelFamily) -> dict[str, Scalar]:
    units = {state.name: state.unit for state in family.states}
    units |= {item.name: item.unit for item in family.inputs}
    units |= {parameter.name: si_unit(parameter.unit) for parameter in family.parameters}
    units |= {qualified(effect.name, state.name): state.unit for state in effect.states}
    units |= {qualified(effect.name, p.name): si_unit(p.unit) for p in effect.parameters}
    return {name: graph.variable(name, parse_unit(unit).dimension) for name, unit in units.items()}


def _write_equations(
    scope: Scope, graph: Graph, effect: Effect, family: ModelFamily, written: Written
) -> None:
    for state in family.states:
        if f"{RATE}{state.name}" in graph.variables:
            state.rate(scope)
        else:
            scope.rate(state.name)
    for more in effect.states:
        rate = graph.expression(effect.bind(more.rate)(scope))
        expected = parse_unit(more.unit).dimension / parse_unit("s").dimension
        check_dimension(rate, expected, f"the rate of {more.name}")
        written.rates.append(rate)
    for output in family.outputs:
        output.formula(scope)
    for item in family.inputs:
        if item.delay is not None:
            dimension = parse_unit(item.unit).dimension
            item.delay(scope, *(graph.variable(f(item.name), dimension) for f in (before, after)))


def _noting(written: Written, graph: Graph, slot: Slot, formula: Formula) -> Formula:
    """Wrap a formula so that its expression, or the reason for its failure, is recorded."""

    def noted(scope: Scope) -> Scalar:
        try:
            term = graph.expression(_call(formula, scope))
            check_dimension(term, parse_unit(slot.unit).dimension, f"the term at {slot.name}")
        except RigctlError as error:
            written.refused = written.refused or (slot.name, error)
            raise
        written.terms.setdefault(slot.name, []).append(term)
        return term

    return noted


def _call(formula: Formula, scope: Scope) -> Scalar:
    try:
        return formula(scope)
    except RigctlError:
        raise
    except OverflowError as problem:
        raise RigctlError("a number in the term is out of range", expected="below 1e308") from problem
    except Exception as problem:  # the term may be a foreign package's Python function
        raise RigctlError(f"the term fails: {type(problem).__name__}: {problem}") from problem


def nominal(family: ModelFamily) -> Mapping[str, float]:
    """The family's own parameter values, SI."""
    return {parameter.name: parameter.value for parameter in family.parameters}
