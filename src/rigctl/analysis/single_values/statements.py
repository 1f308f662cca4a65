"""What a table shows about a model, in sentences: how far off it is and where, and what so few values can
show.

Effects that would improve the fit, though not significantly, are named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigctl.analysis.agreement.adequacy import Adequacy, chance_text
from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.power import significant_size
from rigctl.analysis.linear.score_test import Score, Screening
from rigctl.analysis.single_values.rows import TableRow, shows_unfitted
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.table import curve_variable, set_variable
from rigctl.units import show

#: least reduction of the misfit, in standard deviations, for an effect to be mentioned
_NOTABLE = 2.5
#: an effect is not mentioned if less than this share of its signature cannot be imitated by the fitted
#: parameters
_OWN = 0.05


def near_chance(screening: Screening) -> list[Score]:
    """The scores worth mentioning for a table that no effect explains with certainty, best first."""
    return [score for score in screening.scores if score.z > _NOTABLE and score.kappa > _OWN]


#: standard deviations beyond which a single value is mentioned, and below which it is unremarkable
_FAR, _NEAR = 3.0, 2.0
#: with more than this share of it left, a misfit counts as not removed
_MOST = 0.7


def table_statement(name: str, adequacy: Adequacy, rows: Sequence[TableRow], direction: str) -> str:
    """The verdict of a comparison with a table, with the largest misfit by its operating point."""
    fitted = [row for row in rows if row.fitted]
    worst = max(fitted, key=lambda row: abs(row.z))
    count = f"the {len(fitted)} values of {_quantities(fitted)}"
    chance = chance_text(adequacy.p_value)
    largest = f"the largest misfit is at {worst.condition}: {off(worst, worst.predicted)}"
    if adequacy.adequate:
        return f"{name} agrees with {count} within their noise ({chance}); {largest}"
    text = f"{name} does not agree with {count} ({chance}); {largest}"
    return f"{text}. {direction}" if direction else text


def table_findings(
    linearisation: Linearisation, adequacy: Adequacy, screening: Screening, every: Sequence[TableRow]
) -> tuple[str, ...]:
    """Sentences on the ends of the table, on the model as given in its file, and on what remains
    undecided."""
    fit, lines = linearisation.fit, []
    rows = [row for row in every if row.fitted]
    for quantity in dict.fromkeys(row.quantity for row in rows):
        of_quantity = [row for row in rows if row.quantity == quantity]
        lines += _ends(fit, of_quantity)
        lines += _before(of_quantity)
    lines += end_left_out(linearisation, rows)
    lines += _held_out([row for row in every if not row.fitted])
    lines += _levels(fit)
    lines += _power(fit, rows, len(screening.scores), len(adequacy.tests))
    if adequacy.adequate:
        lines += _undecided(screening)
    return tuple(lines)


def off(row: TableRow, predicted: float) -> str:
    """In words, e.g. ``the model is 3.0 % (0.29 cSt) below the measured value, 4.2 times its noise``."""
    z = (predicted - row.measured) / row.noise
    side = "above" if predicted > row.measured else "below"
    return f"the model is {_how_much(row, predicted)} {side} the measured value, {abs(z):.1f} times its noise"


def _how_much(row: TableRow, predicted: float) -> str:
    """A deviation without its sign: ``3.0 % (0.29 cSt)``."""
    share = row.share(predicted)
    absolute = f"{abs(predicted - row.measured):.2g} {row.unit}"
    return f"{100 * abs(share):.1f} % ({absolute})" if abs(share) < 10.0 else absolute


def _ends(fit: FitResult, rows: Sequence[TableRow]) -> list[str]:
    """The two ends of the curve, where a slightly wrong law shows first."""
    over = curve_variable(fit.problem.measurements)
    if over is None or len(fit.problem.measurements.variables) > 1:
        return []
    points = [fit.problem.records[row.record].condition.get(over, math.nan) for row in rows]
    low, high = rows[int(np.nanargmin(points))], rows[int(np.nanargmax(points))]
    model = "the fitted model" if fit.solution is not None else "the model"
    sentences = [
        f"at {row.condition} {off(row, row.predicted).replace('the model', model)}" for row in (high, low)
    ]
    return [f"At the ends of the table: {sentences[0]}; {sentences[1]}"]


def end_left_out(linearisation: Linearisation, rows: Sequence[TableRow]) -> list[str]:
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


def _end_off(linearisation: Linearisation, rows: Sequence[TableRow], out: Sequence[int]) -> str:
    """The prediction of the rows at `out` by a fit to the others; `rows` in the order of the
    linearisation."""
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
    predicted = row.measured - float(off_by[worst]) * row.noise
    side = "more" if predicted > row.measured else "less"
    quantity = "" if len({one.quantity for one in rows}) == 1 else f" for {row.quantity}"
    return (
        f"Fitted without the {len(out)} values from {rows[out[0]].condition} to {rows[out[-1]].condition}, "
        f"the model predicts {_how_much(row, predicted)} {side} than measured{quantity} at {row.condition}, "
        f"{abs(float(off_by[worst])) / wide:.1f} standard deviations of noise and extrapolation combined "
        f"({chance_text(chance)})"
    )


def _held_out(rows: Sequence[TableRow]) -> list[str]:
    if not rows:
        return []
    worst = max(rows, key=lambda row: abs(row.z))
    return [f"Of the {len(rows)} values held out, at {worst.condition} {off(worst, worst.predicted)}"]


def _before(rows: Sequence[TableRow]) -> list[str]:
    """The effect of refitting the constants on the misfit that the file's values have."""
    if not shows_unfitted(rows):
        return []
    far = [row for row in rows if row.z_unfitted is not None and abs(row.z_unfitted) > _FAR]
    far.sort(key=lambda row: -abs(row.z_unfitted or 0.0))
    if not far:
        return []
    worst = far[0]
    assert worst.unfitted is not None  # noqa: S101 - it was chosen by it
    text = f"With the constants of its file, at {worst.condition} {off(worst, worst.unfitted)}"
    if abs(worst.z) < _NEAR:
        return [
            f"{text}. Fitted to this table it is {abs(worst.z):.1f} times the noise off there: that misfit "
            "is one of the constants, and no evidence against the law"
        ]
    if abs(worst.z) > _MOST * abs(worst.z_unfitted or 1.0):
        return [f"{text}, and refitting its constants does not remove that"]
    return []


def _levels(fit: FitResult) -> list[str]:
    """Sentences on the differences between a table's settings, if each has its own level."""
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
    offsets = ", ".join(
        f"{show(point, unit)} {100 * (value - mean):+.1f} %"
        for point, value in zip(problem.level.settings, parts, strict=True)
    )
    return [
        f"The rows of each {name} share an offset, as if it had been set differently from what was written "
        f"down, by so much relative to their mean: {offsets}. What is judged is what changes at one setting"
    ]


def _power(fit: FitResult, rows: Sequence[TableRow], effects: int, tests: int) -> list[str]:
    """Sentences on the numbers of values and constants, and on the smallest detectable effect."""
    known = fit.problem.model.fitted
    free = [u.name for u in fit.problem.shared if u.name in known and u.prior is None]
    if fit.solution is None or not free:
        return []
    levels = len(fit.problem.level.settings)
    dof = len(rows) - len(free) - levels
    many = f"{len(rows)} values for {len(free)} fitted constant{'' if len(free) == 1 else 's'}"
    if levels:
        many += f" and a level for each of {levels} settings"
    degrees = min((channel.degrees for channel in fit.problem.noise.channels if channel.degrees), default=0)
    if not degrees:
        return [f"{many}, and the noise is only guessed: no verdict is more certain than that guess"]
    needed = f"{significant_size(degrees, effects, tests):.1f} sigma"
    with_noise = f"{significant_size(math.inf, effects, tests):.1f} if the noise were known"
    which = "an effect" if effects == 1 else f"whatever the correlation of the {effects} effects, one"
    return [
        f"{many} leave {dof} degrees of freedom; the noise is itself known only to about "
        f"{100 / math.sqrt(2 * degrees):.0f} %: {which} is significant above {needed}, {with_noise}"
    ]


def _undecided(screening: Screening) -> list[str]:
    """Effects that would reduce the misfit, though not significantly."""
    near = near_chance(screening)
    if not near:
        return []
    named = ", ".join(f"{score.effect} ({score.z:.1f} sigma, {chance_text(score.p_value)})" for score in near)
    return [f"Effects that would improve the fit, but not significantly: {named}"]


def _quantities(rows: Sequence[TableRow]) -> str:
    return " and ".join(dict.fromkeys(row.quantity for row in rows))
