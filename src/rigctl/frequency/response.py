r"""Frequency response with coherence, from several spectra of input and output.

Segments are the whole periods of a periodic record, or overlapping windows of any record. With U the inputs
and Y an output of each segment, and everything conditioned on the other inputs O that move (``|O``), H1 is

    G = S_uy|O / S_uu|O,    gamma^2 = |S_uy|O|^2 / (S_uu|O S_yy|O).

With d = n - i, n independent segments and i inputs, the true response lies with 95 % within the circle

    |G - G0|^2 <= F_0.95(2, 2d) (1 - gamma^2) S_yy|O / (d S_uu|O).

Reference: J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., 2010, sections 7.3 and 9.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.signal import get_window
from scipy.special import fdtrc
from scipy.stats import f as f_distribution

from rigctl.frequency.periods import Complex, Lines, Periods, find_periods, period_lines
from rigctl.frequency.signals import Floats, Signals, held_gain, stretches

#: probability of the circle, and share of unrelated lines below the least coherence
_LEVEL, _UNRELATED = 0.95, 0.99
#: a line with less than this share of the strongest one's power is not excited, nor one of which other inputs
#: leave less than the second share
_EXCITED, _LEFT = 1e-5, 0.05
#: independent averages that the default resolution gives, and longest segment by default, in samples
_AVERAGES, _LONGEST = 16, 2048
#: shortest segment, in samples
_SHORTEST: Final = 16
#: lines next to zero that a window spreads the mean over
_BESIDE_ZERO: Final = 2
#: correlation of the power of neighbouring Hann windows that overlap by half
_OVERLAP: Final = 1.0 / 36.0


@dataclass(frozen=True)
class Response:
    """The response of one output at each line.

    Attributes
    ----------
    gain: (f) complex, SI of the output per SI of the input.
    coherence: (f) 0 to 1; of several inputs, the partial one.
    radius: (f) of the 95 % circle around the gain; infinite where there is one segment.
    p_value: (f) probability of such a gain if the output does not follow the input at all.
    """

    gain: Complex
    coherence: Floats
    radius: Floats
    p_value: Floats


@dataclass(frozen=True)
class Spectrum:
    """What records show at each line.

    Attributes
    ----------
    frequencies: (f) Hz, increasing.
    excited: (f) whether the input has enough power there, of its own.
    input_rms: (f) root mean square of the input at the line, SI.
    responses: of each output.
    segments, averages: their number, and the number of independent ones that they are worth.
    resolution: distance between two lines, Hz; of periods, 1/period.
    periods: for periodic records, of each; empty for windows.
    """

    frequencies: Floats
    excited: np.ndarray[tuple[int], np.dtype[np.bool_]]
    input_rms: Floats
    responses: tuple[Response, ...]
    segments: int
    averages: float
    resolution: float
    periods: tuple[Periods, ...] = ()

    @cached_property
    def least_coherence(self) -> float:
        """The coherence that an output without any relation to the input stays below in 99 % of lines."""
        degrees = self.averages - 1.0
        if degrees <= 0.0:
            return 1.0
        limit = float(f_distribution.ppf(_UNRELATED, 2.0, 2.0 * degrees))
        return limit / (limit + degrees)


def estimate(signals: Sequence[Signals], resolution: float | None = None) -> Spectrum | None:
    """The response of every output to the first input, from all records together.

    Periodic records are divided into their periods if all have the same one, and no resolution is given;
    others into Hann windows that overlap by half, without their straight line.

    Parameters
    ----------
    signals: with equal numbers of inputs and outputs, and similar sampling intervals.
    resolution: distance between lines, Hz; by default as fine as 16 averages allow, with at most 2048 samples
        in a segment.

    Returns
    -------
    None if no record is long enough.
    """
    if resolution is None:
        periods = [find_periods(one) for one in signals]
        known = [one for one in periods if one is not None]
        if len(known) == len(signals) and _same(known):
            lines = period_lines(signals, known)
            if lines.inputs.shape[0] > 1 and lines.frequencies.size:
                return _spectrum(lines, float(lines.inputs.shape[0]), 1.0 / known[0].length, tuple(known))
    windows = _windows(signals, resolution)
    if windows is None:
        return None
    lines, averages, step = windows
    return _spectrum(lines, averages, step)


def _same(periods: Sequence[Periods]) -> bool:
    lengths = [one.length for one in periods]
    return max(lengths) - min(lengths) < 1e-3 * max(lengths)


def _windows(signals: Sequence[Signals], resolution: float | None) -> tuple[Lines, float, float] | None:
    """The spectra of windows, the number of independent ones, and the distance between lines, Hz."""
    interval = float(np.median([one.interval for one in signals]))
    parts = [part for one in signals for part in stretches(one, interval)]
    total = sum(part.times.size for part in parts)
    if resolution is not None:
        size = round(1.0 / (resolution * interval))
    else:
        size = min(2 * total // (_AVERAGES + 1), _LONGEST)
        # a window of many short records is no longer than most of them
        size = min(size, int(np.median([part.times.size for part in parts]))) if parts else 0
    size = max(size, _SHORTEST)
    window = get_window("hann", size)
    inputs, outputs, averages = [], [], 0.0
    for part in parts:
        count = max((part.times.size - size) // (size - size // 2) + 1, 0)
        begins = [k * (size - size // 2) for k in range(count)]
        inputs += [_transform(part.inputs[begin : begin + size], window) for begin in begins]
        outputs += [_transform(part.outputs[begin : begin + size], window) for begin in begins]
        averages += count / (1.0 + 2.0 * _OVERLAP * (1.0 - 1.0 / count)) if count else 0.0
    if len(inputs) < 2:
        return None
    frequencies = np.asarray(np.fft.rfftfreq(size, interval), dtype=np.float64)
    last = frequencies.size - (size % 2 == 0)  # half the sampling rate has no phase
    kept = slice(min(_BESIDE_ZERO, last - 1), last)
    gains = [held_gain(signals, k, frequencies[kept]) for k in range(len(signals[0].inputs))]
    lines = Lines(
        frequencies[kept],
        np.stack(inputs)[:, kept] / np.stack(gains, axis=-1),
        np.stack(outputs)[:, kept],
    )
    return lines, averages, float(frequencies[1])


def _transform(values: Floats, window: Floats) -> Complex:
    """(lines, columns) amplitudes of a window of samples, less their straight line."""
    count = values.shape[0]
    time = np.linspace(-1.0, 1.0, count)
    slope = (time @ values) / (time @ time)
    left = values - values.mean(axis=0) - np.outer(time, slope)
    return np.asarray(2.0 * np.fft.rfft(left * window[:, None], axis=0) / window.sum())


def _spectrum(lines: Lines, averages: float, step: float, periods: tuple[Periods, ...] = ()) -> Spectrum:
    """H1 of every output to the first input, conditioned on the others."""
    u, o, y = lines.inputs[:, :, 0], lines.inputs[:, :, 1:], lines.outputs
    count = y.shape[0]
    s_uu = np.einsum("sf,sf->f", u.conj(), u).real
    s_uy = np.einsum("sf,sfm->fm", u.conj(), y)
    s_yy = np.einsum("sfm,sfm->fm", y.conj(), y).real
    own = s_uu
    if o.shape[2]:
        s_oo = np.einsum("sfi,sfj->fij", o.conj(), o)
        inverse = np.linalg.pinv(s_oo, rcond=1e-9, hermitian=True)
        s_ou, s_oy = np.einsum("sfi,sf->fi", o.conj(), u), np.einsum("sfi,sfm->fim", o.conj(), y)
        by_u, by_y = np.einsum("fij,fj->fi", inverse, s_ou), np.einsum("fij,fjm->fim", inverse, s_oy)
        own = s_uu - np.einsum("fi,fi->f", s_ou.conj(), by_u).real
        s_uy = s_uy - np.einsum("fi,fim->fm", s_ou.conj(), by_y)
        s_yy = s_yy - np.einsum("fim,fim->fm", s_oy.conj(), by_y).real
    excited = (own > _EXCITED * own.max()) & (own > _LEFT * s_uu)
    inputs = lines.inputs.shape[2]
    responses = tuple(
        _response(np.where(excited, own, np.inf), s_uy[:, k], s_yy[:, k], averages - inputs)
        for k in range(y.shape[2])
    )
    rms = np.sqrt(0.5 * s_uu / count)
    return Spectrum(lines.frequencies, excited, rms, responses, count, averages, step, periods)


def _response(s_uu: Floats, s_uy: Complex, s_yy: Floats, degrees: float) -> Response:
    """H1 with its coherence, circle and significance; where `s_uu` is infinite nothing is known."""
    explained = np.abs(s_uy) ** 2 / s_uu
    rest = np.maximum(s_yy - explained, 1e-15 * s_yy)
    known = np.isfinite(s_uu)
    gain = np.where(known, s_uy / np.where(known, s_uu, 1.0), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        coherence = np.where(known, explained / (explained + rest), np.nan)
        if degrees <= 0.0:
            return Response(gain, coherence, np.full(s_uu.size, np.inf), np.ones(s_uu.size))
        limit = float(f_distribution.ppf(_LEVEL, 2.0, 2.0 * degrees))
        radius = np.where(known, np.sqrt(limit * rest / (degrees * s_uu)), np.inf)
        p_value = np.where(known, fdtrc(2.0, 2.0 * degrees, degrees * explained / rest), 1.0)
    return Response(gain, coherence, radius, np.nan_to_num(p_value, nan=1.0))
