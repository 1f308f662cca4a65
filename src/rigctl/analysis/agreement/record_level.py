"""Record-level nuisance parameters: do they vary by more than their priors allow, or follow the conditions?

A room temperature, a setting, a zero or the time of a switch belongs to one record and has a prior. With û
the estimates of one such quantity over the records, G its prior covariance and C the covariance of û − u, the
other unknowns being free,

    Var(û) = G − C        when the model is right,

so that ``û'ᵀ(G − C)⁺û'`` is χ², and ``lᵀû'/√(lᵀ(G − C)l)`` standard normal for every contrast l over the
records, û' = û less the prior's mean. The first tests whether the records vary by more than the prior allows;
the second, with l an operating variable less its mean, whether they follow that variable. Neither happens by
chance: either the prior is too narrow, or these quantities compensate for something that the model lacks.
Source: Henderson, Biometrics 31 (1975) 423, on the variance of best linear unbiased predictions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import free_unknowns
from rigctl.engine.least_squares import Refused
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.json_values import finite_or_none
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.unknowns import LocalUnknown
from rigctl.notebook import worded
from rigctl.units import parse_unit, show

Floats = NDArray[np.float64]

#: an estimate to which the data contribute less than this share of the prior variance is no evidence
_LEAST_SEPARABLE = 0.02
#: least number of records for a trend
_FEWEST = 4
#: largest number of estimates of one quantity that are tested
_MOST = 400
#: common name of the switch times of a record
SWITCHES = "switches"


@dataclass(frozen=True)
class Estimate:
    """A quantity of one record, SI; `std` is NaN if the record was not fitted.

    `prior_mean` and `prior_std` are NaN if it has no prior.
    """

    name: str
    record: str
    value: float
    std: float
    prior_mean: float
    prior_std: float


@dataclass(frozen=True)
class RecordQuantity:
    """One quantity over the records.

    Attributes
    ----------
    name, meaning: its name in programs, and its description.
    unit: in which it is shown; `difference`: True for a temperature difference.
    estimates: for each record that has it.
    p_value: probability that a right model shows so much variation; NaN if not tested.
    over, over_p_value: the operating variable that it follows most closely, and the p-value of that among all
        variables.
    count: number of such tests over all quantities.
    span: the range given for it if only a range is known, SI.
    """

    name: str
    meaning: str
    unit: str
    difference: bool
    estimates: tuple[Estimate, ...]
    p_value: float = math.nan
    over: str = ""
    over_p_value: float = math.nan
    count: int = 1
    span: tuple[float, float] | None = None

    @property
    def exceeds(self) -> bool:
        """True if the records vary by more than the prior allows."""
        return self.p_value * self.count < ALPHA

    @property
    def follows(self) -> bool:
        """True if it follows an operating variable."""
        return self.over_p_value * self.count < ALPHA

    @property
    def values(self) -> Floats:
        """(records) the estimates, SI."""
        return np.array([one.value for one in self.estimates])

    def shown(self, value: float, digits: int = 3) -> str:
        """An SI value with its unit."""
        return show(value, self.unit, difference=self.difference, digits=digits)

    @property
    def evident(self) -> bool:
        """Whether it is more than ordinary variation between records."""
        return self.exceeds or self.follows

    @property
    def has_prior(self) -> bool:
        """Whether anything is known of it beforehand."""
        return not math.isnan(self.estimates[0].prior_std)

    @property
    def statement(self) -> str:
        """What it is evidence of, in words; "" if it is ordinary variation."""
        return worded(self, "findings.agreement.record_level_text")

    def document(self) -> dict[str, Any]:
        """Its summary in the machine-readable answer."""
        values = [
            self._in_unit(value) for value in (self.values.min(), self.values.mean(), self.values.max())
        ]
        return {
            "name": self.name,
            "meaning": self.meaning,
            "unit": self.unit,
            "records": len(self.estimates),
            "lowest": values[0],
            "mean": values[1],
            "highest": values[2],
            "p_value": finite_or_none(self.p_value),
            "over": self.over or None,
            "over_p_value": finite_or_none(self.over_p_value),
            "tests": self.count,
            "evidence": self.evident,
            "statement": self.statement,
        }

    def rows(self) -> list[dict[str, Any]]:
        """A row for each record in the machine-readable answer, in `unit`."""
        factor = parse_unit(self.unit).factor
        return [
            {
                "name": one.name,
                "unit": self.unit,
                "record": one.record,
                "value": self._in_unit(one.value),
                "std": finite_or_none(one.std / factor),
                "prior_mean": finite_or_none(self._in_unit(one.prior_mean)),
                "prior_std": finite_or_none(one.prior_std / factor),
            }
            for one in self.estimates
        ]

    def _in_unit(self, value: float) -> float:
        unit = parse_unit(self.unit)
        return float((value - (0.0 if self.difference else unit.offset)) / unit.factor)


def record_level(fit: FitResult) -> tuple[RecordQuantity, ...]:
    """The record-level quantities; those that are evidence of something first."""
    indices = _positions(fit)
    if not indices:
        return ()
    inverse = _Inverse.of(fit)
    quantities = [_quantity(fit, key, members, inverse) for key, members in indices.items()]
    tests = sum(
        (0 if math.isnan(one.p_value) else 1) + (0 if math.isnan(one.over_p_value) else 1)
        for one in quantities
    )
    counted = [replace(one, count=max(tests, 1)) for one in quantities]
    return tuple(sorted(counted, key=lambda one: not one.evident))


def _positions(fit: FitResult) -> dict[str, list[tuple[int, int]]]:
    """(record, index among its own unknowns) of each quantity; the switches of all records count as one."""
    positions: dict[str, list[tuple[int, int]]] = {}
    for record, members in enumerate(fit.problem.local):
        for index, one in enumerate(members):
            positions.setdefault(SWITCHES if one.kind == "switch" else one.name, []).append((record, index))
    return positions


def _quantity(
    fit: FitResult, key: str, members: Sequence[tuple[int, int]], inverse: _Inverse
) -> RecordQuantity:
    problem = fit.problem
    local = [problem.local[record][index] for record, index in members]
    estimates = tuple(
        _estimate(fit, one, record, index, inverse.std(record, index))
        for one, (record, index) in zip(local, members, strict=True)
    )
    meaning, unit, difference = _named(fit, key, local[0])
    quantity = RecordQuantity(key.removeprefix("record."), meaning, unit, difference, estimates)
    span = fit.problem.records[members[0][0]].unrecorded.get(quantity.name)
    if local[0].unknown.prior is None or span is not None:
        return replace(quantity, span=span)  # an unrecorded input may have any value
    p_value, over, over_p = _tests(fit, members, estimates, inverse, trends=key != SWITCHES)
    return replace(quantity, p_value=p_value, over=over, over_p_value=over_p)


def _estimate(fit: FitResult, one: LocalUnknown, record: int, index: int, std: float) -> Estimate:
    value, mean, spread = float(fit.local[record][index]), math.nan, math.nan
    if one.unknown.prior is not None:
        mean, spread = one.unknown.prior.mean, one.unknown.prior.std
    for shared, common in zip(fit.problem.shared, fit.values, strict=True):
        if shared.name == one.name and shared.prior is not None:  # the record's is a deviation from it
            value, mean, spread = (
                value + float(common),
                shared.prior.mean,
                math.hypot(spread, shared.prior.std),
            )
    label = fit.problem.records[record].label
    return Estimate(one.name.removeprefix("record."), label, value, std, mean, spread)


def _named(fit: FitResult, key: str, one: LocalUnknown) -> tuple[str, str, bool]:
    """(meaning, unit, difference) for display."""
    problem = fit.problem
    if key == SWITCHES:
        return "the time of a switch beside its sample", "s", True
    if one.kind == "start":
        shown = dict(zip(problem.measurements.outputs, problem.measurements.units, strict=True))
        state = next((s for s in problem.model.family.states if s.name == one.name), None)
        si = state.unit if state is not None else one.unknown.unit
        difference = state is not None and state.difference
        usual = problem.measurements.unit_for(si, interval=difference)
        return f"{one.name} at the start", shown.get(one.name) or usual, difference
    level, name = problem.level, one.name.removeprefix("record.")
    parameter = level.effect.parameter(name) if level.effect is not None else None
    meanings = {quantity.parameter: quantity.meaning for quantity in level.quantities}
    if parameter is None:
        return name, one.unknown.unit, False
    meaning = meanings.get(name, parameter.meaning)
    return meaning, parameter.unit, parameter.difference


@dataclass(frozen=True)
class _Inverse:
    """The covariance of the record-level unknowns, the shared ones being free.

    For records i and j it is ``δ_ij·A_i⁻¹ + B_i·S·B_jᵀ``: A_i the record's own normal matrix, B_i the change
    of its own unknowns with the shared ones, S the covariance of the shared ones. An unknown that is a
    deviation from a shared one represents their sum.
    """

    record_local: Mapping[int, Floats]
    passed: Mapping[int, Floats]
    shared: Floats

    @classmethod
    def of(cls, fit: FitResult) -> _Inverse:
        # Block elimination: the joint normal matrix has a block A_i for each record, and couples records
        # through the shared unknowns alone. Its inverse follows from the blocks and from the Schur complement
        # of the shared ones, so that thousands of records need no matrix of all their unknowns.
        problem = fit.problem.only(fit.fitted)
        blocks = problem.evaluate(fit.values, [fit.local[k] for k in fit.fitted], derivatives=True)
        if isinstance(blocks, Refused):
            return cls({}, {}, np.zeros((0, 0)))
        free = free_unknowns(fit)
        columns = [k for k, unknown in enumerate(fit.problem.shared) if unknown in free]
        _, weight = prior_rows(free, fit.values[columns])
        matrix = np.diag(weight**2)
        record_local: dict[int, Floats] = {}
        passed: dict[int, Floats] = {}
        for record, block in zip(fit.fitted, blocks, strict=True):
            unknowns = [one.unknown for one in fit.problem.local[record]]
            shared = np.zeros((block.residual.size, 0)) if block.shared is None else block.shared[:, columns]
            local = np.zeros((block.residual.size, 0)) if block.local is None else block.local
            _, prior = prior_rows(unknowns, fit.local[record])
            normal = _inverted(local.T @ local + np.diag(prior**2))
            cross = local.T @ shared
            matrix += shared.T @ shared - cross.T @ normal @ cross
            shares = [[float(one.name == other.name) for other in free] for one in unknowns]
            record_local[record] = normal
            passed[record] = normal @ cross - np.reshape(shares, (len(unknowns), len(free)))
        return cls(record_local, passed, _inverted(matrix))

    def covariance(self, indices: Sequence[tuple[int, int]]) -> Floats:
        """(indices, indices) of the unknowns at these indices of these records."""
        rows = np.array([self.passed[record][index] for record, index in indices])
        product = rows @ self.shared @ rows.T
        by_record: dict[int, tuple[list[int], list[int]]] = {}
        for row, (record, index) in enumerate(indices):
            rows_of, indices_of = by_record.setdefault(record, ([], []))
            rows_of.append(row)
            indices_of.append(index)
        for record, (rows_of, indices_of) in by_record.items():
            product[np.ix_(rows_of, rows_of)] += self.record_local[record][np.ix_(indices_of, indices_of)]
        return np.asarray(product)

    def std(self, record: int, index: int) -> float:
        """Standard deviation of one unknown; NaN if the record was not fitted."""
        if record not in self.record_local:
            return math.nan
        return float(np.sqrt(max(0.0, self.covariance([(record, index)])[0, 0])))


def _inverted(matrix: Floats) -> Floats:
    """The inverse of a normal matrix with unknowns in units of very different sizes, where it has full
    rank."""
    scale = np.sqrt(np.diag(matrix))
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(matrix / scales, rcond=1e-12, hermitian=True) / scales)


def _tests(
    fit: FitResult,
    members: Sequence[tuple[int, int]],
    estimates: Sequence[Estimate],
    inverse: _Inverse,
    *,
    trends: bool,
) -> tuple[float, str, float]:
    """(p of the spread, the variable that it follows most, p of that); NaN if there is nothing to test."""
    usable = [k for k, (record, _) in enumerate(members) if record in inverse.record_local]
    if not usable:
        return math.nan, "", math.nan
    if len(usable) > _MOST:  # as many are enough, and the cost increases with their cube
        usable = [usable[k] for k in np.linspace(0, len(usable) - 1, _MOST).astype(int).tolist()]
    indices = [members[k] for k in usable]
    prior = np.array([estimates[k].prior_std for k in usable])
    off = np.array([estimates[k].value - estimates[k].prior_mean for k in usable])
    # in units of the prior: the variation between records that the data can show
    variance = np.eye(len(usable)) - inverse.covariance(indices) / np.outer(prior, prior)
    values, vectors = np.linalg.eigh(0.5 * (variance + variance.T))
    separable = values > _LEAST_SEPARABLE
    if not separable.any():
        return math.nan, "", math.nan
    # In the directions that the data show at all: of an unknown that they hardly determine the estimate stays
    # at the prior's mean, and its small deviations would be evidence for nothing.
    along = vectors[:, separable].T @ (off / prior)
    p_value = chi2_tail(float(np.sum(along**2 / values[separable])), int(separable.sum()))
    if not trends:
        return p_value, "", math.nan
    best, tried = ("", math.nan), 0
    for name, x in _operating(fit, [record for record, _ in indices]):
        # l = x − x̄; in units of the prior ``lᵀû'/√(lᵀ(G − C)l)``.
        contrast = (x - x.mean()) * prior
        projected = vectors[:, separable].T @ contrast
        statistic = float(np.sqrt(np.square(projected) @ values[separable]))
        if statistic <= math.sqrt(_LEAST_SEPARABLE) * float(np.linalg.norm(contrast)):
            continue
        z = float(projected @ along) / statistic
        tried += 1
        p = math.erfc(abs(z) / math.sqrt(2.0))
        if math.isnan(best[1]) or p < best[1]:
            best = (name, p)
    return p_value, best[0], min(1.0, best[1] * tried) if tried else math.nan


def _operating(fit: FitResult, records: Sequence[int]) -> Iterator[tuple[str, Floats]]:
    """The operating variables: conditions, and the mean of each input over a record."""
    if len(set(records)) < _FEWEST:
        return
    all_records, varying = fit.problem.records, set[str]()
    for name in fit.problem.measurements.variables:
        x = np.array([all_records[k].condition.get(name, math.nan) for k in records])
        if np.isfinite(x).all() and np.ptp(x) > 0.0:
            varying.add(name)
            yield name, x
    for index, name in enumerate(fit.problem.measurements.inputs):
        x = np.array([_mean_input(fit, k, index) for k in records])
        if name not in varying and np.ptp(x) > 1e-9 * float(np.abs(x).max(initial=0.0)):
            yield f"the mean of {name}", x


def _mean_input(fit: FitResult, k: int, index: int) -> float:
    record = fit.problem.records[k]
    if index in record.along:
        line = record.lines[:, record.along.index(index)]
        width = float(record.knots[-1] - record.knots[0])
        return float(np.trapezoid(line, record.knots)) / width if width else float(line.mean())
    ends = np.append(record.switch_times[1:], max(record.times[-1], record.switch_times[-1]))
    lengths = np.maximum(ends - record.switch_times, 0.0)
    total = float(lengths.sum())
    values = record.inputs[:, index]
    return float(values @ lengths) / total if total else float(values[0])
