"""The law of an effect that the data support: its term with a discrepancy over its variables, and a band.

    T(x)·(1 + Σ_k b_k·B_k(x)),   b ~ N(0, τ²·K)   (`rigctl.analysis.linear.shape_tolerance`)

The amplitudes of the discrepancies and all fitted unknowns form one linear problem with a normal prior on the
discrepancies; its posterior is a curve with a band. τ is the most likely of a few values, of which the shape
tolerance is the smallest. The evidence decides whether the data support another law at all. By how much the
exponent of a power of x would have to differ is estimated from the direction ``T·ln|x|``: ``T·|x|^δ`` to
first order. `rigctl.analysis.laws.power_law` fits the exponent, and decides whether a power describes the
law.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), chapter 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import ALPHA, INTERVAL, LEAST_DIFFERENCE, SHAPE_TOLERANCE
from rigctl.analysis.laws.term import LawTerm, law_term
from rigctl.analysis.linear.linearisation import Linearisation, linearise
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.shape_tolerance import LawDiscrepancy, courses, shape_columns
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.effects.declaration import Effect
from rigctl.effects.drivers import Driver
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]

#: standard deviations of a discrepancy that are tried
_WIDTHS = tuple(SHAPE_TOLERANCE * 2.0**k for k in range(5))
#: points of a curve
_POINTS = 41
#: share of a variable's largest magnitude within which its logarithm is rounded
_CORNER = 0.01


@dataclass(frozen=True)
class EstimatedLaw:
    """The law of one effect over one of its explanatory variables; SI.

    Attributes
    ----------
    effect, driver: the effect, and the variable.
    slot: of the term that is drawn.
    x: (points) over the range that the data cover; `assumed` the term as fitted; `asked` the term that the
        data support, between `low` and `high` with a probability of 95 %.
    differs: the data support another law than the assumed one.
    width: τ, the standard deviation of the discrepancy.
    change, change_std: by how much an exponent of the variable would have to differ, to first order.
    clear: that exponent is significant at the family-wise level.
    explained: the reduction of χ² by the discrepancy.
    noise: variance of the whitened residuals on which all of this is based, at least 1.
    degrees: of freedom of that noise; 0 if it counts as known.
    tried: number of laws that were tested together.
    visited: the lowest and the highest value of the variable.
    others: the ranges of the effect's other variables.
    term: the term itself, to be drawn and written.
    """

    effect: Effect
    driver: Driver
    slot: str
    x: Floats = field(repr=False)
    assumed: Floats = field(repr=False)
    asked: Floats = field(repr=False)
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)
    differs: bool
    width: float
    change: float
    change_std: float
    clear: bool
    explained: float
    noise: float
    degrees: int
    tried: int
    visited: tuple[float, float]
    others: tuple[tuple[Driver, float, float], ...]
    term: LawTerm = field(repr=False)

    @property
    def assumed_exponent(self) -> float | None:
        """n of ``T ∝ |x|^n`` if the assumed law is such a power; else None."""
        return _exponent(self.x, self.assumed)


def estimated_laws(search: Search, trial: RefittedSet) -> tuple[EstimatedLaw, ...]:
    """The law that the data support for every effect in a trial's model, over each of its variables.

    Empty if no term has a discrepancy: for effects without variables, or with variables that do not vary.
    """
    point = search.at(trial)
    if not point.shapes.discrepancies:
        return ()
    agrees = point.view(SHAPE_TOLERANCE).adequacy.agrees
    return _laws(trial.fit, point.shaped(), point.shapes.discrepancies, 1.0 if agrees else None)


def laws_of(fit: FitResult, effects: Sequence[Effect]) -> tuple[EstimatedLaw, ...]:
    """The law that the data support for each of `effects` in the model of any fit.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    shapes = shape_columns(fit, fit.problem, effects)
    if not shapes.discrepancies:
        return ()
    return _laws(
        fit, linearise(fit, fit.problem, (), (shapes.names, shapes.readings)), shapes.discrepancies, None
    )


def _laws(
    fit: FitResult, shaped: Linearisation, discrepancies: Sequence[LawDiscrepancy], noise: float | None
) -> tuple[EstimatedLaw, ...]:
    course = _Prediction(fit)
    visited = {discrepancy.driver: course.range(discrepancy.driver) for discrepancy in discrepancies}
    laws = []
    for discrepancy in discrepancies:
        term = law_term(course.known, fit.problem.model.effect(discrepancy.effect), discrepancy.driver)
        if term is None:
            continue
        others = tuple(
            (driver, *visited[driver])
            for driver in dict.fromkeys(
                one.driver for one in discrepancies if one.effect == discrepancy.effect
            )
            if driver != discrepancy.driver
        )
        law = _law(shaped, discrepancy, term, len(discrepancies), noise)
        laws.append(replace(law, visited=visited[discrepancy.driver], others=others))
    return tuple(laws)


class _Prediction:
    """The fitted records' time series: the ranges of variables, and the average of each."""

    def __init__(self, fit: FitResult) -> None:
        self._inner = fit.problem.only(fit.fitted)
        self._found = self._inner.simulate(fit.values, [fit.local[k] for k in fit.fitted]).require()
        self._fit = fit

    def range(self, driver: Driver) -> tuple[float, float]:
        """The lowest and the highest value of a variable, SI."""
        values = self._values(driver)
        return float(values.min()), float(values.max())

    @cached_property
    def known(self) -> dict[str, float]:
        """Parameters as fitted, states and inputs as their median, SI."""
        problem = self._fit.problem
        system = problem.compiled.system
        known = dict(problem.model.values)
        known |= dict(zip(system.parameter_names, problem.base.tolist(), strict=True))
        known |= {one.name: float(v) for one, v in zip(problem.shared, self._fit.values, strict=True)}
        for name in (*system.state_names, *system.input_names):
            known[name] = float(np.median(self._values(Driver(((name, 1.0),), "1"))))
        return known

    def _values(self, driver: Driver) -> Floats:
        values = np.concatenate(courses(self._inner, self._found, driver))
        return values[np.isfinite(values)]


def _law(
    shaped: Linearisation, discrepancy: LawDiscrepancy, term: LawTerm, count: int, noise: float | None
) -> EstimatedLaw:
    """One effect over one variable, with the other discrepancies free within the tolerance.

    `noise` is the variance of whitened residuals; if None, that which the widest discrepancy leaves.
    """
    # The splines of this variable are the question (columns); those of all other laws are nuisances within
    # the tolerance, so that an error of one law is not read as a shape of another.
    of_discrepancy = np.zeros(len(shaped.shapes), dtype=bool)
    of_discrepancy[discrepancy.columns] = True
    weights = np.where(of_discrepancy, 1.0, SHAPE_TOLERANCE)
    rows = _rows(shaped, weights)
    projected = project(_with_other_discrepancies(shaped, of_discrepancy))
    columns, residual = projected.signatures[:, of_discrepancy], projected.residual
    # Where the model leaves more than noise, the residuals beside the widest discrepancy are the scale of the
    # errors: otherwise any misfit from elsewhere would make a law significant.
    if noise is None:
        absorbed = _evidence(columns * _WIDTHS[-1], residual)[1]
        noise = max(1.0, (float(residual @ residual) - absorbed) / max(projected.dof, 1))
    columns, residual = columns / math.sqrt(noise), residual / math.sqrt(noise)
    # The width τ by the largest evidence (empirical Bayes); its choice, and that among the laws, is paid for
    # in `price`.
    width, evidence, explained = min(
        ((one, *_evidence(columns * one, residual)) for one in _WIDTHS), key=lambda known: known[1]
    )
    x = np.linspace(discrepancy.knots[3], discrepancy.knots[-4], _POINTS)
    assumed = term.values(x)
    estimate, spread = _posterior(rows, discrepancy, of_discrepancy, width, noise, term, x, assumed)
    change, std = _power_change(columns, residual, discrepancy, x)
    price = 2.0 * math.log(count * len(_WIDTHS))
    table = shaped.fit.problem.measurements.table
    degrees = projected.noise_degrees or (max(projected.dof, 1) if table else 0)
    clear = count * chance_of(change / std, degrees) < ALPHA
    return EstimatedLaw(
        effect=term.effect,
        driver=discrepancy.driver,
        slot=term.slot,
        x=x,
        assumed=assumed,
        asked=estimate,
        low=estimate - INTERVAL * spread,
        high=estimate + INTERVAL * spread,
        differs=evidence + price < -LEAST_DIFFERENCE and (clear or not degrees),
        width=width,
        change=change,
        change_std=std,
        clear=clear,
        explained=explained,
        noise=noise,
        degrees=degrees,
        tried=count,
        visited=(float(x[0]), float(x[-1])),
        others=(),
        term=term,
    )


@dataclass(frozen=True)
class _Rows:
    """Everything that was fitted beside the discrepancies, as one linear problem."""

    names: tuple[str, ...]
    nuisance: Floats
    shapes: Floats
    residual: Floats


def _rows(shaped: Linearisation, weights: Floats) -> _Rows:
    weight, prior = shaped.prior
    nuisance = np.vstack([*(one.nuisance for one in shaped.records), weight])
    shapes = np.vstack(
        [*(one.signatures for one in shaped.records), np.zeros((len(weight), len(shaped.shapes)))]
    )
    residual = np.concatenate([*(one.residual for one in shaped.records), prior])
    return _Rows(shaped.nuisances, nuisance, shapes * weights, residual)


def _with_other_discrepancies(shaped: Linearisation, of_discrepancy: NDArray[np.bool_]) -> Linearisation:
    """The discrepancies of the other laws among the nuisances, within the tolerance."""
    others = np.flatnonzero(~of_discrepancy)
    weight, prior = shaped.prior
    more = others.size
    joint = np.pad(weight, (0, more))
    joint[weight.shape[0] :, weight.shape[1] :] = np.eye(more)
    records = tuple(
        replace(one, nuisance=np.hstack([one.nuisance, one.signatures[:, others] * SHAPE_TOLERANCE]))
        for one in shaped.records
    )
    names = tuple(shaped.shapes[k] for k in others)
    return replace(
        shaped,
        records=records,
        nuisances=(*shaped.nuisances, *names),
        prior=(joint, np.pad(prior, (0, more))),
    )


def _evidence(columns: Floats, residual: Floats) -> tuple[float, float]:
    """``−gᵀ(I + A)⁻¹g + ln|I + A|``, and the first part of it, the reduction of χ²."""
    matrix = columns.T @ columns + np.eye(columns.shape[1])
    slope = columns.T @ residual
    explained = float(slope @ np.linalg.solve(matrix, slope))
    return float(np.linalg.slogdet(matrix)[1]) - explained, explained


def _posterior(
    rows: _Rows,
    discrepancy: LawDiscrepancy,
    of_discrepancy: NDArray[np.bool_],
    width: float,
    noise: float,
    term: LawTerm,
    x: Floats,
    assumed: Floats,
) -> tuple[Floats, Floats]:
    """(points) The term that the data support and its standard deviation: the combined result of the effect's
    fitted sizes and the discrepancy, with all other unknowns free as well."""
    # Joint least squares of nuisances (no prior here, theirs are rows) and scaled splines with prior N(0, 1):
    # cov = (XᵀX + P)⁻¹, mean = cov·Xᵀr. `acts` is the derivative of the term at each point by every unknown,
    # so that the band contains the uncertainty of the effect's size as well.
    shapes = np.where(of_discrepancy, width, 1.0) * rows.shapes
    joint = np.hstack([rows.nuisance, shapes]) / math.sqrt(noise)
    scale = np.linalg.norm(joint, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    first = rows.nuisance.shape[1]
    priors = np.zeros(scale.size)
    priors[first:] = 1.0
    matrix = (joint / scale).T @ (joint / scale) + np.diag(priors / scale**2)
    covariance = np.linalg.pinv(matrix, hermitian=True)
    mean = covariance @ ((joint / scale).T @ (rows.residual / math.sqrt(noise)))
    acts = np.zeros((x.size, scale.size))
    for index, name in enumerate(rows.names):
        acts[:, index] = term.slope(name, x)
    # discrepancy of the term: the splines' amplitudes are L·a, a = width·(this unknown)
    acts[:, first + np.flatnonzero(of_discrepancy)] = (
        assumed[:, None] * (_basis(discrepancy, x) @ discrepancy.root) * width
    )
    acts = acts / scale
    spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", acts, covariance, acts), 0.0))
    return assumed + acts @ mean, spread


def _basis(discrepancy: LawDiscrepancy, x: Floats) -> Floats:
    """(points, functions) the splines."""
    from scipy.interpolate import BSpline

    inside = np.clip(x, discrepancy.knots[3], discrepancy.knots[-4])
    count = discrepancy.columns.stop - discrepancy.columns.start
    return np.column_stack([BSpline(discrepancy.knots, unit, 3)(inside) for unit in np.eye(count)])


def _power_change(
    columns: Floats, residual: Floats, discrepancy: LawDiscrepancy, x: Floats
) -> tuple[float, float]:
    """δ of ``T·|x|^δ`` and its standard deviation, to first order; 0 and infinite if undetermined."""
    largest = float(np.abs(x).max())
    # ln|x| in the basis of the splines: to first order T·|x|^δ = T·(1 + δ·ln|x|), rounded near 0.
    wanted = 0.5 * np.log(np.square(x / largest) + _CORNER**2)
    coefficients = np.linalg.lstsq(_basis(discrepancy, x), wanted, rcond=None)[0]
    signature = columns @ np.linalg.solve(discrepancy.root, coefficients)
    square = float(signature @ signature)
    if not square > 0.0:
        return 0.0, math.inf
    return float(signature @ residual) / square, 1.0 / math.sqrt(square)


def chance_of(z: float, degrees: int) -> float:
    """Two-sided p-value of z standard deviations; by Student's t if the noise has few degrees of freedom."""
    if not math.isfinite(z):
        return 1.0
    if not degrees:
        return math.erfc(abs(z) / math.sqrt(2.0))
    from scipy.special import stdtr

    return 2.0 * float(stdtr(degrees, -abs(z)))


#: share of a variable's largest magnitude above which its exponent is determined
_FROM = 0.2
#: exponents that differ by no more than this over that range count as equal
_SAME = 0.05


def _exponent(x: Floats, y: Floats) -> float | None:
    slopes: list[float] = []
    largest = float(np.abs(x).max())
    for side in (1.0, -1.0):
        inside = (side * x > _FROM * largest) & (np.abs(y) > 0.0)
        if inside.sum() < 5:
            continue
        slopes += np.gradient(np.log(np.abs(y[inside])), np.log(side * x[inside])).tolist()
    if not slopes or float(np.ptp(slopes)) > 2.0 * _SAME:
        return None
    exponent = float(np.median(slopes))
    rounded = round(2.0 * exponent) / 2.0
    return rounded if abs(exponent - rounded) < _SAME else exponent
