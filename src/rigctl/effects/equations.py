"""An effect's terms as LaTeX or text, from the same formulas that are compiled."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from rigctl.effects.declaration import Effect, qualified
from rigctl.engine.symbols import Expr, Graph, Scalar, substitute, to_latex, to_text
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import parse_unit

#: symbols of variables in the literature
SYMBOLS: Mapping[str, str] = MappingProxyType(
    {
        "oil_temperature": "T",
        "line_temperature": "T_L",
        "ambient_temperature": "T_a",
        "room_temperature": "T_a",
        "temperature": "T",
        "temperature_1": "T_1",
        "temperature_2": "T_2",
        "supply_pressure": "p_S",
        "pressure_a": "p_A",
        "pressure_b": "p_B",
        "pressure": "p",
        "position": "x",
        "velocity": "v",
        "spool": "u",
        "viscosity": r"\mu",
        "true_dynamic_viscosity": r"\mu",
        "true_kinematic_viscosity": r"\nu",
        "density": r"\rho",
        "true_density": r"\rho",
        "reynolds": r"\mathrm{Re}",
        "flow_area": "A_t",
        "bulk_modulus": r"\beta",
        "bore": "D",
        "rod": "d",
        "stroke": "L",
        "before": "c_0",
        "after": "c_1",
        "heater_1": "Q_1",
        "heater_2": "Q_2",
        "heater_gain_1": r"\alpha_1",
        "heater_gain_2": r"\alpha_2",
        "vogel_a": "a",
        "vogel_b": "b",
        "vogel_c": "c",
    }
)

#: numbers with a customary form, in LaTeX and in text
_NUMBERS = {
    repr(math.pi): (r"\pi", "pi"),
    repr(math.pi / 4.0): (r"\frac{\pi}{4}", "pi/4"),
    repr(math.log(10.0)): (r"\ln 10", "log(10)"),
}


def terms_in_symbols(effect: Effect, family: ModelFamily) -> dict[str, Expr]:
    """The term at each slot, in the family's variables by name."""
    graph = Graph()
    terms: dict[str, Expr] = {}
    # The formula itself is called, with symbols for numbers: what is printed is what is compiled.
    # Quantities that the family defines, such as a viscosity, are then put back by name, or each term would
    # contain their whole law.
    for slot, term in effect.terms:
        known = _variables(graph, effect, family) | {
            name: graph.variable(name, parse_unit(unit).dimension) for name, unit in family.slot(slot).local
        }
        expr = graph.expression(effect.bind(term)(Scope(family, known)))
        expr = substitute(expr, _definitions(graph, family, known))
        terms[slot] = expr if slot not in terms else terms[slot] + expr
    return terms


def term_texts(effect: Effect, family: ModelFamily) -> list[tuple[str, str, str]]:
    """Slot, text and LaTeX of each term; of a measured curve its equation, without its polynomials."""
    # The polynomials between the points of a curve are of no use to a reader.
    if effect.curve is not None:
        text = effect.curve.equation
        plain = text.replace("_", r"\_")
        return [(slot, text, rf"\mathrm{{{plain}}}") for slot in effect.slots]
    return [
        (slot, text_of(term, effect, family), latex_of(term, effect))
        for slot, term in terms_in_symbols(effect, family).items()
    ]


def latex_of(expr: Expr, effect: Effect) -> str:
    """The LaTeX of a term; the effect's parameters have their unqualified names."""
    plain = {
        qualified(effect.name, name): rf"\mathrm{{{name}}}".replace("_", r"\_") for name in _own_names(effect)
    }
    text = to_latex(expr, {**SYMBOLS, **plain})
    for number, (latex, _) in _NUMBERS.items():
        text = text.replace(number, latex)
    return text


def text_of(expr: Expr, effect: Effect, family: ModelFamily) -> str:
    """A term in one line; the effect's parameters have unqualified names unless the family uses them too."""
    text = to_text(expr)
    for name in _own_names(effect):
        if name not in family.units():
            text = re.sub(rf"\b{re.escape(qualified(effect.name, name))}\b", name, text)
    for number, (_, plain) in _NUMBERS.items():
        text = text.replace(number, plain)
    return text


def _own_names(effect: Effect) -> tuple[str, ...]:
    return (*(p.name for p in effect.parameters), *(state.name for state in effect.states))


def _variables(graph: Graph, effect: Effect, family: ModelFamily) -> dict[str, Scalar]:
    units = family.units() | {qualified(effect.name, state.name): state.unit for state in effect.states}
    units |= {qualified(effect.name, p.name): si_unit(p.unit) for p in effect.parameters}
    rates: dict[str, Scalar] = {
        f"rate of {state.name}": graph.variable(
            rf"rate_of_{state.name}", parse_unit(state.unit).dimension / parse_unit("s").dimension
        )
        for state in family.states
    }
    return rates | {name: graph.variable(name, parse_unit(unit).dimension) for name, unit in units.items()}


def _definitions(graph: Graph, family: ModelFamily, known: Mapping[str, Scalar]) -> dict[Expr, Scalar]:
    """Variables by their definitions, to replace these where a formula contains one, e.g. a viscosity."""
    definitions: dict[Expr, Scalar] = {}
    for definition in family.definitions:
        expr = definition.formula(Scope(family, known, options={}))
        if isinstance(expr, Expr) and expr.args:
            definitions[expr] = known[definition.name]
    return definitions
