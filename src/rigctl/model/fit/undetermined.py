"""Which combinations of a model's parameters the data determine, where they do not determine each of them.

A direction in which parameters change together without any effect, at the fit, has relative changes
``dp_i/p_i = n_i``. If the n_i are small whole numbers, products ``Π p_i^m_i`` with ``Σ m_i·n_i = 0`` act,
and nothing else of these parameters: with n = (1, 1, 1) for ``C·dT/dt = k·P - G·(T - T0)`` the ratios k/G and
C/G.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.identifiability import Combination
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.reached_bounds import ReachedBound
from rigctl.units import interval_unit, parse_unit
from rigctl.wording import listed, noun

Floats = NDArray[np.float64]

#: an exponent is a whole number, or a half, if it is this close to it
_WHOLE = 0.02
#: the largest exponent that is put into words
_LARGEST = 3.0
_COUNTS = {1: "one", 2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True)
class Undetermined:
    """Parameters of which the data determine only combinations.

    Attributes
    ----------
    parameters: by name; `spare` of them have to be fixed or measured, before the data determine the others:
        of `fixable`, which have the most weight among them.
    acting: the combinations that act, such as ``gain/conductance``; empty if they have no simple form.
    """

    parameters: tuple[str, ...]
    spare: int
    acting: tuple[str, ...]
    fixable: tuple[str, ...]

    @property
    def statement(self) -> str:
        """In words: ``only gain/conductance and heat_capacity/conductance act: fix one of ...``."""
        names = ", ".join(self.parameters)
        if len(self.parameters) == 1:
            return f"these data do not determine {names}: fix it, or measure it"
        count = _COUNTS.get(self.spare, str(self.spare))
        fix = f"fix or measure {count} of {', '.join(self.fixable)}"
        if self.acting:
            acts = "acts" if len(self.acting) == 1 else "act"
            return f"only {listed(self.acting)} {acts}: {fix}"
        return f"these data do not determine {names} one by one, only {_only(self)}: {fix}"

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "parameters": list(self.parameters),
            "to_fix": self.spare,
            "fixable": list(self.fixable),
            "acting": list(self.acting),
            "statement": self.statement,
        }


def undetermined(fitted: FitResult) -> tuple[Undetermined, ...]:
    """The groups of the model's parameters that the data do not determine individually; usually none."""
    if fitted.solution is None or not fitted.solution.weak:
        return ()
    free = fitted.problem.model.fitted
    values = {one.name: float(v) for one, v in zip(fitted.problem.shared, fitted.values, strict=True)}
    units = {name: unit_of(fitted, name) for name in free}
    found = []
    for names, weak in _groups(fitted.solution.weak, free):
        acting = _acting(names, weak, values, units)
        heavy = {name for one in weak for name, _ in one.parts}
        fixable = tuple(name for name in names if name in heavy)
        found.append(Undetermined(tuple(names), len(weak), acting, fixable))
    return tuple(found)


def first_statements(bounds: Sequence[ReachedBound], groups: Sequence[Undetermined]) -> tuple[str, ...]:
    """What has to be known of a fit before anything else, a sentence each."""
    return (*(one.statement for one in bounds), *(one.statement for one in groups))


def unit_of(fitted: FitResult, name: str) -> str:
    """The declared unit of a parameter of the family or of an effect."""
    model = fitted.problem.model
    effect, dot, parameter = name.partition(".")
    return model.effect(effect).parameter(parameter).unit if dot else model.family.parameter(name).unit


def _groups(
    weak: Sequence[Combination], free: Sequence[str]
) -> Iterator[tuple[list[str], list[Combination]]]:
    """The combinations that share parameters, with these in the model's order."""
    left = [one for one in weak if any(name in free for name, _ in one.parts)]
    while left:
        group = [left.pop(0)]
        # two combinations that share a parameter are one group: which of their parameters is fixed decides
        # for both
        names = set(dict(group[0].changes))
        while near := [one for one in left if names & set(dict(one.changes))]:
            group += near
            left = [one for one in left if one not in near]
            names |= {name for one in near for name, _ in one.changes}
        yield [name for name in free if name in names], group


def _acting(
    names: Sequence[str],
    weak: Sequence[Combination],
    values: Mapping[str, float],
    units: Mapping[str, str],
) -> tuple[str, ...]:
    """The products, or else the sums, that act; empty if their exponents are not simple."""
    # (combinations, parameters) of the group: directions without effect. In relative changes whole numbers
    # mean that products act, in absolute ones of one unit that sums do. A temperature in degC has no products
    changes = np.zeros((len(weak), len(names)))
    for row, one in zip(changes, weak, strict=True):
        for name, change in one.changes:
            if name in names:
                row[names.index(name)] = change
    size = np.array([values[name] for name in names])
    scale = all(size) and not any(parse_unit(units[name]).absolute_temperature for name in names)
    if scale and (products := _texts(names, changes / size, _product)):
        return products
    same = len({interval_unit(units[name]) for name in names}) == 1
    return _texts(names, changes, _sum) if same else ()


def _texts(names: Sequence[str], null: Floats, text: Any) -> tuple[str, ...]:
    """What acts, from the (q, p) directions without effect: one combination for each of p - q parameters.

    In the reduced echelon form of the directions each of q parameters appears in one of them alone; what acts
    is each other parameter, compensated by these. The last ones are taken, so that the first are named first.
    """
    # Gauss-Jordan elimination; the pivot is not the largest entry but the last strong one, for the order of
    # the names, and strong enough for the division not to magnify rounding
    rows = null / np.abs(null).max(axis=1, keepdims=True)
    pivots: list[int] = []
    for k in range(len(rows)):
        open_rows = rows[k:]
        strong = np.abs(open_rows).max(axis=0) > 0.3 * np.abs(open_rows).max()
        column = max(index for index in range(len(names)) if strong[index])
        best = k + int(np.argmax(np.abs(open_rows[:, column])))
        rows[[k, best]] = rows[[best, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
        pivots.append(column)
    texts = []
    for index in [index for index in range(len(names)) if index not in pivots]:
        exponents = {index: 1.0} | {
            pivot: -float(row[index])
            for pivot, row in zip(pivots, rows, strict=True)
            if abs(row[index]) > _WHOLE
        }
        whole = _whole(exponents)
        if whole is None:
            return ()
        texts.append(text([(names[k], power) for k, power in sorted(whole.items())]))
    return tuple(texts)


def _whole(exponents: Mapping[int, float]) -> dict[int, int] | None:
    """The exponents as whole numbers, doubled if some are halves; None if they are not simple."""
    for factor in (1.0, 2.0):
        scaled = {index: factor * power for index, power in exponents.items()}
        if all(abs(p - round(p)) <= factor * _WHOLE and abs(p) <= _LARGEST for p in scaled.values()):
            return {index: round(p) for index, p in scaled.items()}
    return None


def _product(powers: Sequence[tuple[str, int]]) -> str:
    above = [_power(name, power) for name, power in powers if power > 0]
    below = [_power(name, -power) for name, power in powers if power < 0]
    if not below:
        return "*".join(above)
    return f"{'*'.join(above) or '1'}/{below[0] if len(below) == 1 else '(' + '*'.join(below) + ')'}"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"


def _sum(parts: Sequence[tuple[str, int]]) -> str:
    first, *others = (f"{'' if abs(n) == 1 else f'{abs(n)}*'}{name}" for name, n in parts)
    signs = ("+" if n > 0 else "-" for _, n in parts[1:])
    return " ".join([first, *(f"{sign} {other}" for sign, other in zip(signs, others, strict=True))])


def _only(one: Undetermined) -> str:
    count = len(one.parameters) - one.spare
    return f"{_COUNTS.get(count, count)} {noun(count, 'combination')} of them"
