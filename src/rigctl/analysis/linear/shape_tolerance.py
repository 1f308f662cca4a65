"""A tolerance for the shape of an effect's law, in addition to the noise: a model discrepancy.

No effect of a library has a bench's exact law. Its term T may therefore deviate over each of its variables x:

    T·(1 + Σ_k b_k·B_k(x)),   b ~ N(0, τ²·K),   K_ij = exp(−(i − j)²/(2ℓ²)),   τ = `SHAPE_TOLERANCE`

with cubic B-splines B over the range that the data cover. The changes of the readings with b are further
columns of the linearisation, with a prior: the right effect with a slightly different law needs little of it,
an effect that only resembles it needs much, at a cost in evidence. If the term is not a multiple of the
effect's parameters, the discrepancy multiplies the parameters.

Source: M. C. Kennedy, A. O'Hagan, J. R. Stat. Soc. B 63 (2001) 425, the discrepancy inside the equations;
C. de Boor, A Practical Guide to Splines (1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.slopes import base_at
from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.drivers import Driver, drivers
from rigctl.engine.splines import SplineArgument, SplineColumn, SplineColumns, knots_over
from rigctl.engine.trajectories import Trajectories
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: number of splines over each variable
FUNCTIONS = 8
#: ℓ, in splines
_SMOOTH = 1.5
#: the ends of a variable's range, as quantiles of the samples
_ENDS = (0.002, 0.998)
#: least distance of two knots, as a share of the range
_APART = 0.02
#: a variable that changes by less than this share of its magnitude counts as constant
_VARIES = 0.005


@dataclass(frozen=True)
class LawDiscrepancy:
    """The splines over one variable of one effect: a discrepancy of its law.

    Attributes
    ----------
    effect: its name.
    driver: the variable.
    knots: (functions + 4) of the splines, SI.
    columns: their indices among all columns of a set.
    root: (functions, functions) L of ``K = L·Lᵀ``: the coefficients are ``b = L·a``, a ~ N(0, τ²).
    """

    effect: str
    driver: Driver
    knots: Floats = field(repr=False)
    columns: slice
    root: Floats = field(repr=False)

    def weights(self, amplitudes: Floats, x: Floats) -> Floats:
        """(n) ``1 + Σ b_k·B_k(x)`` for the amplitudes a of all columns; constant beyond the ends."""
        from scipy.interpolate import BSpline

        spline = BSpline(self.knots, self.root @ amplitudes[self.columns], 3)
        return np.asarray(1.0 + spline(np.clip(x, self.knots[3], self.knots[-4])))


@dataclass(frozen=True)
class ShapeColumns:
    """The changes of the readings by discrepancies of the laws of some effects.

    Attributes
    ----------
    discrepancies: the meaning of the columns.
    readings: (n, channels, columns) for each record, the derivatives by the amplitudes a.
    """

    discrepancies: tuple[LawDiscrepancy, ...]
    readings: tuple[Floats, ...] = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each column."""
        return tuple(
            f"shape of {discrepancy.effect} over {discrepancy.driver.name}, {k}"
            for discrepancy in self.discrepancies
            for k in range(discrepancy.columns.stop - discrepancy.columns.start)
        )


def shape_columns(fit: FitResult, problem: Problem, effects: Sequence[Effect]) -> ShapeColumns:
    """The columns of `effects` at a fit that has them, on its fitted records; `problem` is the same data with
    the equations of the whole library.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    inner = problem.only(fit.fitted)
    base = base_at(inner, fit)
    local = [fit.local[k] for k in fit.fitted]
    at = inner.with_shared((), base)
    width = len(inner.measurements.outputs)
    nothing = tuple(np.empty((record.times.size, width, 0)) for record in inner.records)
    wanted = [(effect, driver) for effect in effects for driver in drivers(effect)]
    if not wanted:
        return ShapeColumns((), nothing)
    # 1. The variables along the fitted trajectories: the knots follow what these data visit.
    simulated = at.simulate(np.empty(0), local).require()
    # 2. For each law and variable, columns of the derivative by the effect's size, weighted by each spline
    #    along the trajectory: ∂y/∂b_k at b = 0, without compiling any equation.
    discrepancies: list[LawDiscrepancy] = []
    arguments: list[SplineArgument] = []
    columns: list[SplineColumn] = []
    root = prior_root()
    for effect, driver in wanted:
        knots = knots_of(courses(at, simulated, driver))
        carried = _carried(effect, at, base)
        if knots is None or not carried:
            continue
        first = len(columns)
        columns += [SplineColumn(carried, (len(arguments), k)) for k in range(FUNCTIONS)]
        arguments.append(SplineArgument(dict(driver.weights), knots))
        discrepancies.append(LawDiscrepancy(effect.name, driver, knots, slice(first, len(columns)), root))
    if not discrepancies:
        return ShapeColumns((), nothing)
    # 3. One simulation with all columns. Those of one law are multiplied by L, K = L·Lᵀ: the unknowns are
    #    then independent, with the same standard deviation τ, which is all that the tests need to know of the
    #    prior.
    readings: list[Floats] = []
    for part in at.parts(len(columns)):
        some = at.only(part)
        slopes = some.simulate(
            np.empty(0), [local[k] for k in part], splines=SplineColumns(tuple(arguments), tuple(columns))
        ).require()
        for array in slopes.sensitivities:
            sensitivity = np.take(array, at.channels, axis=1)
            readings.append(
                np.concatenate([sensitivity[:, :, one.columns] @ one.root for one in discrepancies], axis=2)
            )
    return ShapeColumns(tuple(discrepancies), tuple(readings))


def _carried(effect: Effect, problem: Problem, base: Floats) -> dict[str, float]:
    """The parameters that switch an effect on, each with its distance from its null, if that is not 0."""
    names = problem.compiled.system.parameter_names
    values = {}
    for one in effect.parameters:
        name = qualified(effect.name, one.name)
        value = float(base[names.index(name)]) - one.at_null
        if value and not one.shape:
            values[name] = value
    return values


def courses(problem: Problem, simulated: Trajectories, driver: Driver) -> list[Floats]:
    """(n) for each record: the variable at its samples, SI."""
    states, inputs = problem.compiled.system.state_names, problem.compiled.system.input_names
    result = []
    for record, known in zip(problem.records, simulated.states, strict=True):
        total = np.zeros(record.times.size)
        for name, weight in driver.weights:
            if name in states:
                total += weight * known[:, states.index(name)]
            else:
                total += weight * record.input_course(inputs.index(name))
        result.append(total)
    return result


def knots_of(values_of: Sequence[Floats], functions: int = FUNCTIONS) -> Floats | None:
    """Knots with equal numbers of samples between them, subject to a least distance; None for a constant."""
    values = np.concatenate(values_of) if values_of else np.empty(0)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    low, high = (float(end) for end in np.quantile(values, _ENDS))
    largest = max(abs(low), abs(high))
    if not high - low > _VARIES * largest:
        return None
    inner: list[float] = []
    shares = np.arange(1, functions - 3) / (functions - 3)
    gap = min(_APART, 0.2 / functions) * (high - low)
    for index, value in enumerate(np.quantile(values, shares).tolist()):
        previous = inner[-1] if inner else low
        reserve = (functions - 4 - index) * gap
        inner.append(min(max(value, previous + gap), high - reserve))
    return knots_over(low, high, functions, inner)


def prior_root(functions: int = FUNCTIONS, smooth: float = _SMOOTH) -> Floats:
    """(functions, functions) L of ``L·Lᵀ = K``; `smooth` is ℓ, in splines."""
    distance = np.subtract.outer(np.arange(functions), np.arange(functions))
    covariance = np.exp(-0.5 * np.square(distance / smooth)) + 1e-8 * np.eye(functions)
    return np.asarray(np.linalg.cholesky(covariance))
