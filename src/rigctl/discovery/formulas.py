"""Formulas for what is left, scored through the trajectories, never on differentiated data.

The columns of fine splines at a slot give the signature of any smooth function of the variable there:
``g(x) = Σ_k c_k·B_k(x)``, ``s = Σ_k c_k·s̃_k``. A formula explains ``(s·r̃)²/s·s`` of χ², and costs
``p·ln N_eff + 2·ln K + 2·C``, with p its parameters, K the number of formulas tried and C its operations.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.mbic import mbic
from rigctl.discovery.grammar import DISTANCES, Argument, Form, argument, factors, forms
from rigctl.discovery.locate import Located
from rigctl.discovery.open_slots import OpenSlots, products_at, splines_at
from rigctl.effects.registry import library
from rigctl.engine.one_thread import one_thread
from rigctl.engine.splines import SplineArgument
from rigctl.model.model import Model
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]

#: number of splines for a function of one variable, and for each factor of a product
FINE, FINE_PRODUCT = 24, 11
#: number of points between two knots at which a function is approximated
_POINTS = 15
#: number of formulas whose scales are refined, and whose columns are compared
_FIRST = 40
#: number of those at each slot that is not among the first ones
_OF_A_SLOT = 2
#: two formulas with a larger cosine than this are equivalent
SAME = 0.99
#: of equivalent formulas the simplest is kept, unless its cost exceeds the least by more than this
_SIMPLER = 6.0
#: largest number of scales in a formula
_SCALES = 2
#: initial step of a position, as a share of the range
_NEAR = 0.1
#: largest length of a name
_LONGEST = 60


@dataclass(frozen=True)
class Factor:
    """A form of one argument, its scales as values of x."""

    argument: Argument
    form: Form = field(repr=False)
    scales: tuple[float, ...] = ()

    def of(self, z: Floats) -> Floats:
        """(n) its values at values of the variable, SI."""
        return self.form.of(self.argument.of(z), *self.scales)


@dataclass(frozen=True)
class Formula:
    """One formula at one slot, evaluated on the linear problem.

    Attributes
    ----------
    factors: one, or two for a product.
    gain: reduction of χ².
    size: in the slot's unit, SI; the term is size·Π factors.
    cost: its penalty less what it explains; less is better.
    same: other formulas that are equivalent for these data.
    number: of its effect's name, above 1 if the model has another effect of this name already.
    """

    slot: Slot
    factors: tuple[Factor, ...]
    gain: float
    size: float
    cost: float
    same: tuple[Formula, ...] = field(default=(), repr=False)
    number: int = 1

    @property
    def key(self) -> str:
        """Its form, whatever its scales."""
        product = " times ".join(f"{one.form.name} of {one.argument.driver.name}" for one in self.factors)
        return f"{self.slot.name}: {product}"

    @property
    def name(self) -> str:
        """The name of its effect: ``friction_bump_of_position``."""
        name = re.sub(r"[^a-z0-9]+", "_", self.key.casefold())[:_LONGEST].strip("_")
        return name if self.number == 1 else f"{name}_{self.number}"

    @property
    def over(self) -> tuple[str, ...]:
        """The variables on which it depends."""
        return tuple(sorted(one.argument.driver.name for one in self.factors))

    @property
    def scales(self) -> tuple[float, ...]:
        """The scales of all factors."""
        return tuple(scale for one in self.factors for scale in one.scales)

    @property
    def parameters(self) -> int:
        """The number of its parameters: size and scales."""
        return 1 + len(self.scales)

    @property
    def complexity(self) -> int:
        """The number of operations and constants."""
        return sum(one.form.complexity for one in self.factors) + len(self.factors) - 1

    def with_scales(self, scales: Sequence[float]) -> Formula:
        """The formula with other scales."""
        remaining, chosen = list(scales), []
        for one in self.factors:
            count = len(one.scales)
            chosen.append(replace(one, scales=tuple(remaining[:count])))
            remaining = remaining[count:]
        return replace(self, factors=tuple(chosen))

    def price(self, samples: float, tried: int) -> float:
        """The reduction of χ² that it must exceed, its penalty."""
        return mbic(0.0, self.parameters, 1, samples, tried) + 2.0 * self.complexity


@dataclass(frozen=True)
class Scored:
    """The formulas tried: `formulas` the best of each form, by increasing cost; `tried` their number."""

    formulas: tuple[Formula, ...]
    tried: int


@dataclass(frozen=True)
class _Basis:
    """Splines at one slot over one variable, or their products over two, and their signatures.

    `square` and `along` are ``S̃ᵀS̃`` and ``S̃ᵀr̃``; `grids` are points of each variable, SI, and `follow`
    (functions, points) maps a function's values there to its spline coefficients.
    """

    located: Located
    known: tuple[SplineArgument, ...]
    arguments: tuple[Argument, ...]
    square: Floats = field(repr=False)
    along: Floats = field(repr=False)
    grids: tuple[Floats, ...] = field(repr=False)
    follow: tuple[Floats, ...] = field(repr=False)

    def weights(self, chosen: Sequence[Factor]) -> Floats:
        """The spline coefficients of a product of factors, one of each variable."""
        parts = []
        for wanted, grid, follow in zip(self.arguments, self.grids, self.follow, strict=True):
            (factor,) = (one for one in chosen if one.argument is wanted)
            parts.append(follow @ factor.of(grid))
        return parts[0] if len(parts) == 1 else np.outer(parts[0], parts[1]).ravel()

    def score(self, weights: Floats) -> tuple[float, float]:
        """The reduction of χ² by a column, and its size."""
        length = float(weights @ self.square @ weights)
        along = float(weights @ self.along)
        if not length > 0.0 or not math.isfinite(length) or not math.isfinite(along):
            return 0.0, 0.0
        return along**2 / length, along / length


@one_thread()
def score_formulas(opened: OpenSlots, located: Sequence[Located], samples: float) -> Scored:
    """Every formula of the grammar at the located slots and variables.

    Parameters
    ----------
    located: over one variable or two.
    samples: N_eff.
    """
    # 1. Every formula at every location: a weighted sum of spline columns that were simulated once. Of one
    #    form the best scales are kept.
    best: dict[str, tuple[Formula, _Basis]] = {}
    tried = 0
    for one in located:
        basis = _basis(opened, one)
        if basis is None:
            continue
        for formula in _every(basis):
            tried += 1
            known = best.get(formula.key)
            if formula.gain > 0.0 and (known is None or formula.gain > known[0].gain):
                best[formula.key] = (formula, basis)

    def priced(formula: Formula) -> Formula:
        formula = numbered(formula, opened.problem.model)
        return replace(formula, cost=formula.price(samples, tried) - formula.gain)

    # 2. The price of the search is known only now: ln K with the number of formulas tried.
    scored = sorted(
        ((priced(formula), basis) for formula, basis in best.values()), key=lambda one: one[0].cost
    )
    # 3. Scales of the best ones by a local search, still in the linear problem.
    first = [(priced(_refined(formula, basis)), basis) for formula, basis in _of_every_slot(scored)]
    first.sort(key=lambda one: one[0].cost)
    return Scored(tuple(_merged(opened, first)), tried)


def numbered(formula: Formula, model: Model) -> Formula:
    """The formula with a number that makes its name new in a model."""
    taken = {*library(model.family), *model.effects, *(effect.name for effect in model.own_effects)}
    while formula.name in taken:
        formula = replace(formula, number=formula.number + 1)
    return formula


def _of_every_slot(scored: Sequence[tuple[Formula, _Basis]]) -> list[tuple[Formula, _Basis]]:
    """The first formulas, and the first ones of each slot that is not among these: at one slot there may be
    dozens that are nearly equivalent."""
    first = list(scored[:_FIRST])
    slots = {formula.slot.name for formula, _ in first}
    others: dict[str, list[tuple[Formula, _Basis]]] = {}
    for one in scored[_FIRST:]:
        if one[0].slot.name not in slots:
            others.setdefault(one[0].slot.name, []).append(one)
    return [*first, *(one for of_slot in others.values() for one in of_slot[:_OF_A_SLOT])]


def _basis(opened: OpenSlots, one: Located) -> _Basis | None:
    family = opened.problem.model.family
    functions = FINE if len(one.over) == 1 else FINE_PRODUCT
    known, arguments, grids, follow = [], [], [], []
    for driver in one.over:
        knots = opened.knots(driver, functions)
        if knots is None:
            return None
        grid = points_over(knots)
        known.append(SplineArgument(dict(driver.weights), knots))
        arguments.append(argument(driver, float(grid[0]), float(grid[-1]), family))
        grids.append(grid)
        follow.append(following(grid, knots))
    splines = splines_at([(one.slot, known[0])]) if len(known) == 1 else products_at(one.slot, *known)
    projected = opened.project(opened.readings(splines))
    # (S̃ᵀS̃, S̃ᵀr̃) of the fine splines: all that scoring needs of the data. ``gain = (c·g)²/(cᵀAc)`` with
    # the spline coefficients c of a function, and its best size ``c·g/cᵀAc``.
    columns = np.where(projected.usable, projected.signatures, 0.0)
    return _Basis(
        one,
        tuple(known),
        tuple(arguments),
        columns.T @ columns,
        columns.T @ projected.residual,
        tuple(grids),
        tuple(follow),
    )


def points_over(knots: Floats) -> Floats:
    """Points over a range, equally many between any two knots."""
    inner = knots[3:-3]
    parts = [np.linspace(a, b, _POINTS, endpoint=False) for a, b in pairwise(inner.tolist())]
    return np.concatenate([*parts, [np.nextafter(inner[-1], inner[0])]])


def following(grid: Floats, knots: Floats) -> Floats:
    """(functions, points) the matrix that maps a function's values at the points to its spline
    coefficients."""
    from scipy.interpolate import BSpline

    return np.asarray(np.linalg.pinv(BSpline.design_matrix(grid, knots, 3).toarray()))


def _every(basis: _Basis) -> Iterator[Formula]:
    for chosen in _choices(basis.arguments):
        gain, size = basis.score(basis.weights(chosen))
        yield Formula(basis.located.slot, chosen, gain, size, 0.0)


def _choices(arguments: Sequence[Argument]) -> Iterator[tuple[Factor, ...]]:
    """A form of the single variable, or of either of two with a factor of the other."""
    for index, chosen in enumerate(arguments):
        inner = list(_factors(chosen, forms))
        outer = list(_factors(arguments[1 - index], factors)) if len(arguments) == 2 else []
        for one in inner:
            if not outer:
                yield (one,)
            for other in outer:
                if len(one.scales) + len(other.scales) <= _SCALES:
                    yield (one, other)


def _factors(argument: Argument, kinds: Callable[[float, float], Iterator[Form]]) -> Iterator[Factor]:
    ends = argument.of(np.array([argument.low, argument.high]))
    for form in kinds(float(ends[0]), float(ends[1])):
        for scales in form.starts:
            yield Factor(argument, form, scales)


def _refined(formula: Formula, basis: _Basis) -> Formula:
    """The formula with its scales at a local optimum of the linear problem, near their starts."""
    if not formula.scales:
        return formula
    from scipy.optimize import minimize

    begin = np.array(formula.scales)
    distance = np.array([name in DISTANCES for one in formula.factors for name in one.form.scales])
    length = np.concatenate([np.full(len(one.scales), one.argument.length) for one in formula.factors])

    def at(moved: Floats) -> list[float]:
        near = np.clip(moved, -1.5, 1.5)
        return [
            float(value) for value in np.where(distance, begin * np.exp(near), begin + _NEAR * length * near)
        ]

    def loss(moved: Floats) -> float:
        return -basis.score(basis.weights(formula.with_scales(at(moved)).factors))[0]

    done = minimize(loss, np.zeros(begin.size), method="Nelder-Mead", options={"maxfev": 60, "xatol": 0.02})
    if not -done.fun > formula.gain:
        return formula
    better = formula.with_scales(at(done.x))
    gain, size = basis.score(basis.weights(better.factors))
    return replace(better, gain=gain, size=size)


def _merged(opened: OpenSlots, scored: Sequence[tuple[Formula, _Basis]]) -> Iterator[Formula]:
    """One formula of each group of equivalent ones, ``|cos| > 0.99``: the simplest, which lists the
    others."""
    if not scored:
        return
    # Columns of formulas at different slots are comparable only as readings: each is composed of its own
    # splines, and all are projected together.
    readings: list[list[Floats]] = []
    order: list[int] = []
    for key in dict.fromkeys(id(basis) for _, basis in scored):
        indices = [k for k, (_, basis) in enumerate(scored) if id(basis) == key]
        basis = scored[indices[0]][1]
        slot = basis.located.slot
        splines = (
            splines_at([(slot, basis.known[0])]) if len(basis.known) == 1 else products_at(slot, *basis.known)
        )
        weights = np.column_stack([basis.weights(scored[k][0].factors) for k in indices])
        readings.append([one @ weights for one in opened.readings(splines)])
        order += indices
    projected = opened.project([np.concatenate(parts, axis=2) for parts in zip(*readings, strict=True)])
    lengths = np.where(projected.lengths > 0.0, projected.lengths, 1.0)
    unit = projected.signatures / lengths
    cosines = np.empty((len(order), len(order)))
    cosines[np.ix_(order, order)] = np.abs(unit.T @ unit)
    # In order of cost, each group around its best member; the simplest member speaks for the group, since
    # within it the data cannot tell.
    remaining = list(range(len(scored)))
    while remaining:
        leader = remaining.pop(0)
        same = [leader, *(k for k in remaining if cosines[leader, k] > SAME)]
        remaining = [k for k in remaining if k not in same]
        near = [k for k in same if scored[k][0].cost < scored[leader][0].cost + _SIMPLER]
        plain = min(near, key=lambda k: (*_operations(scored[k][0]), scored[k][0].cost))
        others = [scored[k][0] for k in same if k != plain]
        yield replace(scored[plain][0], same=tuple(others))


def _operations(formula: Formula) -> tuple[int, int]:
    """The number of its parameters, and of its operations, a difference of two variables among them."""
    arguments = sum(len(one.argument.driver.variables) - 1 for one in formula.factors)
    return formula.parameters, formula.complexity + arguments
