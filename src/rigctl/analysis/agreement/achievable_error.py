"""What error would a free model reach on these data? A cross-validated regression of the residuals.

To a fitted model f a free correction is added, linear in β:

    y ≈ f(t) + Φ(t)·β

The features Φ are made of the inputs up to the sample before, and of the model's own predictions: each as it
is, low-pass filtered with four time constants, squared, multiplied by the others, and as a smooth sign of its
change. They imitate lags, dead times, saturations, couplings and friction without knowing any of them. An
input of the same sample is not among them: a controller computes it from that reading, noise and all.
β is found by ridge
regression in whitened rows, in which noise as it was estimated is independent; ten parts of the data are left
out in turn and predicted. Where the error there falls, the model lacks something that the inputs explain,
whether or not any effect of the library does. Where it does not, no more was found, which is no proof.

Source: T. Hastie, R. Tibshirani, J. Friedman, *The Elements of Statistical Learning* (2009), §3.4 and §7.10;
for filter banks of low order, B. Wahlberg, IEEE Trans. Autom. Control 36 (1991) 551-562.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: parts of the data that are left out in turn, and how few rows are not divided
_FOLDS, _FEWEST = 10, 300
#: with as many records, whole ones are left out; of fewer, stretches of each
_RECORDS = 20
#: a record of so few samples has no course
_SHORTEST = 3
#: low-pass filters of each signal, with time constants from two samples to a third of the record
_FILTERS = 4
#: signals beyond which products are not formed
_MOST_MULTIPLIED = 8
#: ridge penalties that are tried, as shares of the mean square of a column
_PENALTIES = (1e-6, 1e-4, 1e-2, 1.0)
#: a fall of the squared error counts if chance gives it this rarely over all channels, and is this large
_LEVEL, _LEAST = 1e-3, 0.05
#: the same where the slow part of the noise is not known, which neighbouring stretches predict too
_LEAST_BESIDE_SLOW_NOISE = 0.5
_TINY = 1e-30
#: readings beyond which the regression sees only every so many, and beyond which there is none
_MANY, _MOST = 50_000, 200_000
#: features are whitened in pieces of as many columns, which keeps long records within memory
_COLUMNS = 8


@dataclass(frozen=True)
class AchievableError:
    """Of one channel, with and without a free correction, on data that its fit left out.

    Attributes
    ----------
    channel, unit: with its display unit.
    model: root mean square error of the model, SI.
    free: of the model with the free correction, on the parts left out, SI; the model's if that is smaller.
    noise: standard deviation of a reading, SI.
    share: of the whitened squares, what the correction predicts; at least 0.
    p_value: the probability that chance predicts as much, from the scatter over the blocks.
    channels: how many were tried.
    least: the share from which it counts.
    """

    channel: str
    unit: str
    model: float
    free: float
    noise: float
    share: float
    p_value: float
    channels: int
    least: float = _LEAST

    @property
    def beats(self) -> bool:
        """Whether the correction predicts more than chance does: the model lacks something."""
        return self.share > self.least and self.p_value * self.channels < _LEVEL

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in the channel's unit."""
        unit = parse_unit(self.unit)
        factor = 1.0 if unit.offset else unit.factor  # a difference of temperatures is in kelvin
        return {
            "channel": self.channel,
            "model": self.model / factor,
            "free": self.free / factor,
            "noise": self.noise / factor,
            "unit": "K" if unit.offset else self.unit,
            "share": self.share,
            "p_value": self.p_value,
            "beats": self.beats,
        }


def achievable_errors(fit: FitResult) -> tuple[AchievableError, ...]:
    """Of each channel with enough readings in the fitted records; none for single values, or for hundreds of
    thousands of rows."""
    measurements, problem = fit.problem.measurements, fit.problem
    used = [k for k in fit.fitted if not problem.records[k].row and problem.records[k].times.size > _SHORTEST]
    if measurements.table or sum(problem.records[k].times.size for k in used) > _MOST:
        return ()
    # Only over time: a table or a row has no course from which features could be made. A channel of few
    # readings is left out, since ten parts of it would each decide on a handful.
    counts = [
        sum(int(problem.ok[k][:, channel].sum()) for k in used)
        for channel in range(len(measurements.outputs))
    ]
    enough = [channel for channel, count in enumerate(counts) if count >= _FEWEST]
    if not enough:
        return ()
    features = _features(fit, used)
    # one after the other: those of long records do not fit into memory for all channels at once
    return tuple(
        _achievable(fit, channel, _rows(fit, used, features, channel, counts[channel]), len(enough))
        for channel in enough
    )


@dataclass(frozen=True)
class _Rows:
    """The readings of one channel in all fitted records.

    Attributes
    ----------
    residual, white: (rows) f − y in SI and whitened.
    features, white_features: (rows, p) likewise.
    fold: (rows) the part that each row belongs to.
    """

    residual: Floats
    white: Floats
    features: Floats
    white_features: Floats
    fold: NDArray[np.intp]


def _achievable(fit: FitResult, channel: int, rows: _Rows, channels: int) -> AchievableError:
    # Squares of whitened rows of each part, as the model leaves them and with the correction fitted to the
    # other parts. Their logarithmic ratios are the ten observations of a t test.
    left_out, correction = _cross_validated(rows)
    squares = np.array(
        [
            (np.sum(rows.white[rows.fold == k] ** 2), np.sum(left_out[rows.fold == k] ** 2))
            for k in range(_FOLDS)
        ]
    )
    total, left = squares.sum(axis=0).tolist()
    # by how much the error of each part falls, as a logarithm: parts with larger errors weigh no more
    falls = np.log(np.maximum(squares[:, 0], _TINY) / np.maximum(squares[:, 1], _TINY))
    spread = float(falls.std(ddof=1)) / math.sqrt(_FOLDS)
    measurements = fit.problem.measurements
    name = measurements.outputs[channel]
    model = math.sqrt(float(np.mean(rows.residual**2)))
    free = math.sqrt(float(np.mean((rows.residual - correction) ** 2)))
    return AchievableError(
        channel=name,
        unit=measurements.units[channel],
        model=model,
        free=min(model, free),
        noise=fit.errors[name].noise,
        share=max(0.0, 1.0 - left / total) if total > 0.0 else 0.0,
        p_value=_t_tail(float(falls.mean()) / spread) if spread > 0.0 else 1.0,
        channels=channels,
        least=_LEAST_BESIDE_SLOW_NOISE if fit.problem.noise.channels[channel].own_scale else _LEAST,
    )


def _t_tail(t: float) -> float:
    """P(T > t) of Student's t over the folds."""
    from scipy.special import stdtr

    return float(stdtr(_FOLDS - 1, -t))


def _cross_validated(rows: _Rows) -> tuple[Floats, Floats]:
    """(rows) the whitened residuals, less the correction, of each part left out, and the correction in SI;
    with the penalty that leaves the least.

    Every fold shares the sums over all rows, less its own: no regression reads the data again.
    """
    parts = [rows.fold == k for k in range(_FOLDS)]
    # β = (ΦᵀΦ + λI)⁻¹Φᵀr over the other parts: sums over all rows less those of the part left out.
    grams = np.array([rows.white_features[part].T @ rows.white_features[part] for part in parts])
    moments = np.array([rows.white_features[part].T @ rows.white[part] for part in parts])
    gram, moment = grams.sum(axis=0), moments.sum(axis=0)
    scale = float(np.trace(gram)) / len(gram)
    best, found = math.inf, (rows.white, np.zeros(rows.white.size))
    for penalty in _PENALTIES:
        left, correction = rows.white.copy(), np.zeros(rows.white.size)
        ridge = penalty * scale * np.eye(len(gram))
        for part, own, its in zip(parts, grams, moments, strict=True):
            size = np.linalg.solve(gram - own + ridge, moment - its)
            left[part] -= rows.white_features[part] @ size
            correction[part] = rows.features[part] @ size
        if (total := float(left @ left)) < best:
            best, found = total, (left, correction)
    return found


def _rows(fit: FitResult, used: Sequence[int], features: Sequence[Floats], channel: int, count: int) -> _Rows:
    """Those of one channel, whitened as its noise is; of very many every so many."""
    problem, parts = fit.problem, []
    every = -(-count // _MANY)
    for place, (index, of_record) in enumerate(zip(used, features, strict=True)):
        record, ok, whitener = problem.records[index], problem.ok[index], problem.whiteners[index]
        # W·Φ of this channel alone: the whitener of a record takes all channels, so the features are put into
        # the column of the channel, and zeros into the others.
        error = np.where(ok, fit.outputs[index] - np.where(ok, record.values, 0.0), 0.0)
        here = np.flatnonzero(whitener.rows[:, 1] == channel)[::every]
        samples = whitener.rows[here, 0]
        white = np.empty((samples.size, of_record.shape[1]))
        for first in range(0, of_record.shape[1], _COLUMNS):
            piece = of_record[:, first : first + _COLUMNS]
            alone = np.zeros((*error.shape, piece.shape[1]))
            alone[:, channel] = piece
            white[:, first : first + _COLUMNS] = whitener(alone)[here]
        # Whole records where there are enough of them, else a tenth of each, another one in every record, so
        # that a part holds every phase of the records.
        if len(used) >= _RECORDS:
            fold = np.full(samples.size, place % _FOLDS)
        else:
            fold = (place + samples * _FOLDS // len(error)) % _FOLDS
        parts.append((error[samples, channel], whitener(error)[here], of_record[samples], white, fold))
    return _Rows(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _features(fit: FitResult, used: Sequence[int]) -> list[Floats]:
    """(n, p) Φ of each record, each column with a spread of 1 over all of them."""
    records = [fit.problem.records[k] for k in used]
    signals = []
    for index, record in zip(used, records, strict=True):
        courses = [record.input_course(k) for k in range(len(fit.problem.measurements.inputs))]
        inputs = np.column_stack([*courses, np.empty((record.times.size, 0))])
        # Inputs of the sample before, the model's own outputs of the same one.
        before = np.vstack([inputs[:1], inputs[:-1]])
        signals.append(np.column_stack([before, np.nan_to_num(fit.outputs[index])]))
    scaled = _scaled(signals)
    every = [_of_signals(record.times, each) for record, each in zip(records, scaled, strict=True)]
    return [np.column_stack([np.ones(len(each)), each]) for each in _scaled(every)]


def _scaled(columns: Sequence[Floats]) -> list[Floats]:
    """Each column about its mean, in its standard deviation; constant ones are left out."""
    together = np.concatenate(columns)
    middle, spread = together.mean(axis=0), together.std(axis=0)
    moving = spread > 1e-9 * (1.0 + np.abs(middle))
    return [(each[:, moving] - middle[moving]) / spread[moving] for each in columns]


def _of_signals(times: Floats, signals: Floats) -> Floats:
    """(n, p) what is made of (n, m) signals of a record."""
    duration = float(times[-1] - times[0])
    step = duration / (times.size - 1)
    constants = np.geomspace(2.0 * step, max(duration / 3.0, 4.0 * step), _FILTERS)
    slow = [_low_passed(times, signals, float(constant), step) for constant in constants]
    # What the signal does faster than the shortest filter, and a smooth sign of it: dry friction changes with
    # the sign of a speed.
    change = signals - slow[0]
    size = np.sqrt(np.mean(change**2, axis=0))
    sign = np.tanh(change / np.where(size > 0.0, size, 1.0))
    pairs = combinations(range(signals.shape[1] if signals.shape[1] <= _MOST_MULTIPLIED else 0), 2)
    products = [signals[:, one] * signals[:, other] for one, other in pairs]
    return np.column_stack([signals, *slow, signals**2, slow[1] ** 2, sign, *products])


def _low_passed(times: Floats, signals: Floats, constant: float, step: float) -> Floats:
    """Each signal behind a first-order lag, at rest at its first value.

    On an even grid of as many points, which holds the last value, and back from the last point of the grid:
    wherever samples are irregular, nothing of a later one is in the value of an earlier one.
    """
    from scipy.signal import lfilter

    grid = times[0] + step * np.arange(times.size)
    held = np.maximum(np.searchsorted(times, grid, side="right") - 1, 0)
    last = np.maximum(np.searchsorted(grid, times, side="left") - 1, 0)
    pole = math.exp(-step / constant)
    even = signals[held]
    lagged, _ = lfilter([1.0 - pole], [1.0, -pole], even, axis=0, zi=pole * even[:1])
    return np.asarray(lagged[last])
