"""The systematic error of a model: its error without the noise, channel by channel.

A root mean square error that falls from 0.158 mm to 0.127 mm seems a small change; if the noise is 0.127 mm,
the whole systematic error is gone. The error is therefore measured by its significance over all readings: S =
√X standard deviations, where X is the excess of the whitened squares over those of noise. For two models on
the same data the difference of X is that of their whitened squares, whatever noise is assumed.

Where only the floor of a channel's noise is known, what a model leaves is its own scale, in which X is nearly
zero for every model. Its error is then compared with that floor, or with the noise that the rig file states,
and is within the noise only if the tests of adequacy accept it there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rigctl.analysis.decision_levels import ALPHA
from rigctl.answers.numbers import number, symbol
from rigctl.units import parse_unit, significant

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import ModelComparison
    from rigctl.analysis.diagnosis_result import Diagnosis
    from rigctl.model.fit.errors import ChannelError
    from rigctl.model.fit.fit import FitResult
    from rigctl.model.measured.record import Measurements
    from rigctl.noise import ChannelNoise

#: standard deviations of a sum of squares under chance up to which it is not distinguished from noise
_CHANCE = 1.96
#: S up to which a channel's error is not distinguished from noise: the effect of some more parameters on
#: noise
_FLOOR = 3.0
#: RMS error up to which one that is not tested for its colour is not distinguished from a white floor
_AT_FLOOR = 1.2


@dataclass(frozen=True)
class ChannelFall:
    """The systematic error of one channel, for a model and its successors.

    Attributes
    ----------
    title, unit: of the channel, as it is shown.
    noise: standard deviation of one reading, in `unit`.
    sizes: S of each model, in sigmas of all readings together, or with `own` its error in units of `noise`; 0
        if not distinguished from noise.
    amounts: root mean square of the systematic error of each model, in `unit`, or with `own` of its whole
        error; 0 where noise hides it.
    difference: by how much X of the first exceeds that of the last, whatever the noise.
    guessed: whether the noise is only a guess, and so the systematic error too.
    own: what `noise` is where only the floor is known: ``white noise``, or ``stated noise``; else "".
    """

    channel: str
    title: str
    unit: str
    noise: float
    sizes: tuple[float, ...]
    amounts: tuple[float, ...]
    difference: float
    guessed: bool
    own: str = ""

    @property
    def changed(self) -> bool:
        """Whether the last model's differs from the first's by more than chance."""
        return abs(self.difference) > _FLOOR**2

    @property
    def hidden_fall(self) -> bool:
        """Whether an error that is within the noise before and after falls all the same."""
        return not self.own and self.within(0) and self.within(-1) and self.difference > 0.0

    def within(self, index: int) -> bool:
        """Whether the error of that model is within the noise."""
        return self.sizes[index] == 0.0

    def sigmas(self, index: int) -> str:
        """With `own` ``4.2 times its white noise``, or that it is within the noise."""
        return (
            "within the noise"
            if self.within(index)
            else f"{significant(self.sizes[index], 2)} times its {self.own}"
        )

    def beside_noise(self, index: int) -> str:
        """With `own` and beyond the noise: ``0.092 V, 4.2 times its white noise of 0.022 V``."""
        return f"{self.amount(index)}, {self.sigmas(index)} of {self.noise_text}"

    @property
    def noise_text(self) -> str:
        """The noise of one reading with its unit."""
        return f"{_two(self.noise)} {self.unit}".strip()

    def amount(self, index: int) -> str:
        """The error in the channel's unit: ``0.10 mm``; "" if it is within the noise."""
        amount = self.amounts[index]
        return f"{_two(amount)} {self.unit}".strip() if not self.within(index) and amount > 0.0 else ""


def _two(value: float) -> str:
    if 1e-4 < abs(value) < 10.0:
        return f"{value:#.2g}"
    return f"{value:.0f}" if 10.0 <= abs(value) < 1e4 else number(value, 2)


def falls(fits: Sequence[FitResult], remaining: Sequence[Mapping[str, float]]) -> tuple[ChannelFall, ...]:
    """By channel, for models on the same data; ordered by the error of the first model.

    Each size is that of its model alone: a comparison and a diagnosis state the same one.

    Parameters
    ----------
    remaining: S of each model, or its error in units of the floor, for the channels where it exceeds the
        noise; see `left_of`.
    """
    problem = fits[0].problem
    measurements = problem.measurements
    known = {channel.name: channel for channel in problem.noise.channels}
    result = []
    for name, shown in zip(measurements.outputs, measurements.units, strict=True):
        if any(name not in fit.errors for fit in fits):
            continue
        unit = parse_unit(shown)
        errors = [fit.errors[name] for fit in fits]
        if known[name].own_scale:
            result.append(_against_floor(measurements, shown, known[name], errors, remaining))
            continue
        first, last = errors[0], errors[-1]
        sizes = [size if size > _FLOOR else 0.0 for size in (left.get(name, 0.0) for left in remaining)]
        shares = [_amplitude(error, size) for error, size in zip(errors, sizes, strict=True)]
        result.append(
            ChannelFall(
                channel=name,
                title=measurements.titles.get(name, name),
                unit="K" if unit.offset else symbol(shown),
                noise=errors[0].noise / unit.factor,
                sizes=tuple(sizes),
                amounts=tuple(
                    share * error.noise / unit.factor for share, error in zip(shares, errors, strict=True)
                ),
                difference=first.count * (first.chi2_reduced - last.chi2_reduced),
                guessed=known[name].guessed,
            )
        )
    return tuple(sorted(result, key=lambda one: -max(one.sizes)))


def _against_floor(
    measurements: Measurements,
    shown: str,
    noise: ChannelNoise,
    errors: Sequence[ChannelError],
    remaining: Sequence[Mapping[str, float]],
) -> ChannelFall:
    """One channel of which only the floor is known; two models differ by ``(Σe₁²/Σe₂² − 1)·n/τ``, in units of
    what the better one leaves."""
    unit = parse_unit(shown)
    sizes = tuple(left.get(noise.name, 0.0) for left in remaining)
    squares = [one.rmse**2 for one in errors]
    # (Σe₁² − Σe₂²)/(Σe²_better/n)·1/τ, with τ readings for one independent one: without a noise level the
    # better model's own residuals are the scale, as in an F test.
    better = min(squares[0], squares[-1]) or 1.0
    return ChannelFall(
        channel=noise.name,
        title=measurements.titles.get(noise.name, noise.name),
        unit="K" if unit.offset else symbol(shown),
        noise=_level(noise) / unit.factor,
        sizes=sizes,
        amounts=tuple(
            one.rmse / unit.factor if size else 0.0 for one, size in zip(errors, sizes, strict=True)
        ),
        difference=(squares[0] - squares[-1]) / better * errors[0].count / noise.together,
        guessed=False,
        own="stated noise" if noise.allowed else "white noise",
    )


def _level(noise: ChannelNoise) -> float:
    """SI, what an error is compared with where only the floor is known."""
    return noise.allowed or noise.level


def _amplitude(error: ChannelError, size: float) -> float:
    """RMS of the systematic error in units of the noise; at least the value that S implies."""
    if size <= 0.0:
        return 0.0
    return max(math.sqrt(max(error.nrmse**2 - 1.0, 0.0)), size / math.sqrt(max(error.count, 1)))


def left_of(model: ModelComparison) -> dict[str, float]:
    """S of a model by channel, for those whose error exceeds chance; none for a model that agrees.

    X is the excess over chance of the residuals' means over the phases of the records, or of all whitened
    squares if that is larger: an error that changes its sign within a phase has no mean there. Where only the
    floor is known, the error in units of it, unless it is shown to be noise.
    """
    if model.adequate:
        return {}
    unproven = errors_beside_floor(model.fit, model.adequacy.unproven)
    beyond = {one.label for one in model.where if one.by == "channel" and one.p_value < ALPHA}
    # X = max(Σz² − number of z, n·(χ²_red − 1)), z the normalised means of one channel's residuals over the
    # phases of the records. The first sees a mean shift that is far below the noise of one reading; the
    # second an oscillation whose mean in a phase is 0.
    columns: dict[str, list[int]] = {}
    for column, label in enumerate(model.linearisation.regions.labels):
        columns.setdefault(label[1], []).append(column)
    own = model.fit.problem.noise.own_scale
    sizes = {}
    for name, indices in columns.items():
        if name in own:
            continue
        z = model.cells.z[:, indices]
        present = z[np.isfinite(z)]
        error = model.fit.errors[name]
        total = error.count * (error.chi2_reduced - 1.0)
        excess = max(float(np.sum(present**2)) - present.size, total)
        if name in beyond and excess > 0.0:
            sizes[name] = math.sqrt(excess)
    return sizes | unproven


def errors_beside_floor(fit: FitResult, names: Sequence[str]) -> dict[str, float]:
    """RMS error in units of the floor, or of the stated noise, for channels of which no more is known."""
    return {
        channel.name: fit.errors[channel.name].rmse / _level(channel)
        for channel in fit.problem.noise.channels
        if channel.own_scale and channel.name in names and channel.name in fit.errors
    }


def left_of_fit(fit: FitResult) -> dict[str, float]:
    """Systematic error of a fit by channel: the excess of its whitened squares over noise, or of its error
    over the floor where only that is known."""
    own = fit.problem.noise.own_scale
    sizes = {name: size for name, size in errors_beside_floor(fit, tuple(own)).items() if size > _AT_FLOOR}
    for name, error in fit.errors.items():
        if name in own:
            continue
        excess = error.count * (error.chi2_reduced - 1.0)
        if excess > _CHANCE * math.sqrt(2.0 * error.count):
            sizes[name] = math.sqrt(excess)
    return sizes


def lefts_of_diagnosis(diagnosis: Diagnosis) -> list[dict[str, float]]:
    """S of the model, and with effects found that with them: the remainder of the diagnosis, divided by
    channel like its squares."""
    before = left_of(diagnosis.before)
    if not diagnosis.best.candidates:
        return [before]
    fit = diagnosis.best.fit
    unproven = errors_beside_floor(fit, diagnosis.unproven_after)
    if diagnosis.remainder is None:
        return [before, unproven]
    # The remainder has one size for all channels. Its squares are divided among them like the excess of their
    # whitened squares: S_c = S·√(X_c/ΣX).
    errors = {name: one for name, one in fit.errors.items() if name not in fit.problem.noise.own_scale}
    parts = {name: max(one.count * (one.chi2_reduced - 1.0), 0.0) for name, one in errors.items()}
    total = sum(parts.values())
    after = {
        name: diagnosis.remainder.size * math.sqrt(part / total) for name, part in parts.items() if part > 0.0
    }
    return [before, after | unproven]
