"""What a table shows about a model: how far off it is and where, and what so few values can show.

In: the linearisation, the tests and the rows of a fitted table. Out: `Finding`s, which
`rigctl.answers.findings.tables` words. Effects that would improve the fit, though not significantly, are
among it: with a handful of values, what could not be found matters as much as what was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.power import significant_size
from rigctl.analysis.linear.score_test import Score, Screening
from rigctl.analysis.single_values.rows import TableRow, shows_unfitted
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.table import curve_variable, set_variable

#: least reduction of the misfit, in standard deviations, for an effect to be mentioned
_NOTABLE = 2.5
#: an effect is not mentioned if less than this share of its signature cannot be imitated by the fitted
#: parameters
_OWN = 0.05
#: standard deviations beyond which a single value is mentioned, and below which it is unremarkable
_FAR, _NEAR = 3.0, 2.0
#: with more than this share of it left, a misfit counts as not removed
_MOST = 0.7


@dataclass(frozen=True)
class Ends:
    """The rows at the two ends of the curve, where a slightly wrong law shows first."""

    low: TableRow
    high: TableRow
    fitted: bool


@dataclass(frozen=True)
class OfTheConstants:
    """A row that the constants of the model's file miss, and that fitted ones reach, or (`left`) do not."""

    row: TableRow
    left: bool


@dataclass(frozen=True)
class EndLeftOut:
    """How a curve fitted to the other rows predicts those at an end of the table.

    Attributes
    ----------
    rows: those left out, in order.
    worst, predicted: the one that is missed most, and its prediction.
    deviations: that in standard deviations of noise and extrapolation combined.
    p_value: of all of them together.
    alone: the table has no other quantity.
    """

    rows: tuple[TableRow, ...]
    worst: TableRow
    predicted: float
    deviations: float
    p_value: float
    alone: bool


@dataclass(frozen=True)
class HeldOut:
    """The values that no fit saw: how many, and the one that is missed most."""

    count: int
    worst: TableRow


@dataclass(frozen=True)
class SettingOffsets:
    """The offset of each setting of a variable from their mean, as a share."""

    variable: str
    unit: str
    offsets: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Sensitivity:
    """What so few values can show.

    Attributes
    ----------
    values, constants, settings: how many there are, of settings with levels of their own.
    degrees: of freedom of the noise; 0 if it is only guessed.
    effects: how many were tested.
    needed, if_known: sigmas beyond which one is significant, now and if the noise were known.
    """

    values: int
    constants: int
    settings: int
    degrees: int
    effects: int
    needed: float = math.nan
    if_known: float = math.nan

    @property
    def freedom(self) -> int:
        """Degrees of freedom that the constants leave."""
        return self.values - self.constants - self.settings


@dataclass(frozen=True)
class NearChance:
    """Effects that would reduce the misfit, though not significantly."""

    scores: tuple[Score, ...]


Finding: TypeAlias = Ends | OfTheConstants | EndLeftOut | HeldOut | SettingOffsets | Sensitivity | NearChance


def near_chance(screening: Screening) -> list[Score]:
    """The scores worth mentioning for a table that no effect explains with certainty, best first."""
    return [score for score in screening.scores if score.z > _NOTABLE and score.kappa > _OWN]


def table_findings(
    linearisation: Linearisation, adequacy: Adequacy, screening: Screening, every: Sequence[TableRow]
) -> tuple[Finding, ...]:
    """The ends of the table, the model as given in its file, and what remains undecided."""
    fit, found = linearisation.fit, list[Finding]()
    rows = [row for row in every if row.fitted]
    for quantity in dict.fromkeys(row.quantity for row in rows):
        of_quantity = [row for row in rows if row.quantity == quantity]
        found += _ends(fit, of_quantity)
        found += _before(of_quantity)
    found += end_left_out(linearisation, rows)
    outside = [row for row in every if not row.fitted]
    if outside:
        found.append(HeldOut(len(outside), max(outside, key=lambda row: abs(row.z))))
    found += _levels(fit)
    found += _power(fit, rows, len(screening.scores), len(adequacy.tests))
    near = near_chance(screening) if adequacy.adequate else []
    return (*found, *([NearChance(tuple(near))] if near else []))


def _ends(fit: FitResult, rows: Sequence[TableRow]) -> list[Finding]:
    over = curve_variable(fit.problem.measurements)
    if over is None or len(fit.problem.measurements.variables) > 1:
        return []
    points = [fit.problem.records[row.record].condition.get(over, math.nan) for row in rows]
    low, high = rows[int(np.nanargmin(points))], rows[int(np.nanargmax(points))]
    return [Ends(low, high, fit.solution is not None)]


def end_left_out(linearisation: Linearisation, rows: Sequence[TableRow]) -> list[Finding]:
    """Whether a curve fitted to the other rows predicts those at an end of the table.

    With J and r the whitened derivatives and residuals, the rows left out deviate by ``e = r₂ − J₂·J₁⁺·r₁``,
    whose covariance by chance is ``I + J₂·(J₁ᵀJ₁)⁻¹·J₂ᵀ``.
    """
    fit, records = linearisation.fit, linearisation.records
    over = curve_variable(fit.problem.measurements)
    count = max(2, len(rows) // 4)
    at = {fit.fitted.index(row.record): row for row in rows}
    single = all(one.residual.size == 1 for one in records) and len(records) == len(rows) == len(at)
    if fit.solution is None or over is None or not single or len(rows) < 2 * count + 2:
        return []
    if len(fit.problem.measurements.variables) > 1 or linearisation.prior[0].any():
        return []
    # rows are ordered by quantity, the linearisation by record
    by_record = [at[k] for k in range(len(records))]
    points = [fit.problem.records[row.record].condition[over] for row in by_record]
    order = np.argsort(points, kind="stable").tolist()
    return [_end_off(linearisation, by_record, end) for end in (order[-count:], order[:count])]


def _end_off(linearisation: Linearisation, rows: Sequence[TableRow], out: Sequence[int]) -> EndLeftOut:
    """The prediction of the rows at `out` by a fit to the others; `rows` in the order of the
    linearisation."""
    # One row is one value: e = r₂ − J₂·J₁⁺·r₁, in σ. Its covariance contains the uncertainty of the
    # extrapolation, which at an end of a curve is the larger part.
    matrix = np.vstack([one.nuisance for one in linearisation.records])
    residual = np.concatenate([one.residual for one in linearisation.records])
    matrix = matrix / np.where((norms := np.linalg.norm(matrix, axis=0)) > 0.0, norms, 1.0)
    rest = [k for k in range(len(rows)) if k not in out]
    inverse = np.linalg.pinv(matrix[rest], rcond=1e-9)
    off_by = residual[out] - matrix[out] @ inverse @ residual[rest]
    lead = matrix[out] @ inverse
    covariance = np.eye(len(out)) + lead @ lead.T
    degrees = min((c.degrees for c in linearisation.fit.problem.noise.channels if c.degrees), default=0)
    chance = chi2_tail(float(off_by @ np.linalg.solve(covariance, off_by)), len(out), degrees)
    worst = int(np.argmax(np.abs(off_by) / np.sqrt(np.diag(covariance))))
    row, wide = rows[out[worst]], float(np.sqrt(covariance[worst, worst]))
    return EndLeftOut(
        rows=tuple(rows[k] for k in out),
        worst=row,
        predicted=row.measured - float(off_by[worst]) * row.noise,
        deviations=abs(float(off_by[worst])) / wide,
        p_value=chance,
        alone=len({one.quantity for one in rows}) == 1,
    )


def _before(rows: Sequence[TableRow]) -> list[Finding]:
    """The effect of refitting the constants on the misfit that the file's values have."""
    if not shows_unfitted(rows):
        return []
    far = [row for row in rows if row.z_unfitted is not None and abs(row.z_unfitted) > _FAR]
    if not far:
        return []
    worst = max(far, key=lambda row: abs(row.z_unfitted or 0.0))
    removed, left = abs(worst.z) < _NEAR, abs(worst.z) > _MOST * abs(worst.z_unfitted or 1.0)
    return [OfTheConstants(worst, not removed)] if removed or left else []


def _levels(fit: FitResult) -> list[Finding]:
    """The differences between a table's settings, if each has its own level."""
    problem = fit.problem
    if fit.solution is None or not problem.level.settings:
        return []
    values = {u.name: float(value) for u, value in zip(problem.shared, fit.values, strict=True)}
    parts = [values[name] for name in problem.level.setting_names if name in values]
    if len(parts) < len(problem.level.settings):
        return []
    name = set_variable(problem.measurements)
    unit = variable_units(problem.measurements).get(name, "Pa")
    mean = float(np.mean(parts))
    offsets = zip(problem.level.settings, (value - mean for value in parts), strict=True)
    return [SettingOffsets(name, unit, tuple(offsets))]


def _power(fit: FitResult, rows: Sequence[TableRow], effects: int, tests: int) -> list[Finding]:
    """The numbers of values and constants, and the smallest detectable effect."""
    known = fit.problem.model.fitted
    free = [u.name for u in fit.problem.shared if u.name in known and u.prior is None]
    if fit.solution is None or not free:
        return []
    degrees = min((channel.degrees for channel in fit.problem.noise.channels if channel.degrees), default=0)
    counted = len(rows), len(free), len(fit.problem.level.settings), degrees, effects
    if not degrees:
        return [Sensitivity(*counted)]
    needed, known_noise = (significant_size(one, effects, tests) for one in (degrees, math.inf))
    return [Sensitivity(*counted, needed, known_noise)]
