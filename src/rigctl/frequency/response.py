r"""Frequency response with coherence, from several spectra of input and output.

Segments are the whole periods of a periodic record, or overlapping windows of any record. With U the inputs
and Y an output of each segment, and everything conditioned on the other inputs O that move (``|O``), H1 is

    G = S_uy|O / S_uu|O,    gamma^2 = |S_uy|O|^2 / (S_uu|O S_yy|O).

With d = n - i, n independent segments and i inputs, the true response lies with 95 % within the circle

    |G - G0|^2 <= F_0.95(2, 2d) (1 - gamma^2) S_yy|O / (d S_uu|O).

A command that holds also has frequencies beyond half the sampling rate r, and samples of the output show the
answer to them at the line f, too. What belongs to the input there is found as the response C of the images
U(f - r) and U(f + r) to U(f): where the command changes with the samples, C = f/(r - f) and f/(r + f).

Reference: J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., 2010, sections 7.3 and 9.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import fdtrc
from scipy.stats import f as f_distribution

from rigctl.frequency.periods import Complex, Lines, Periods, find_periods, period_lines
from rigctl.frequency.signals import FINE, Floats, Signals, stretches

#: probability of the circle, and share of unrelated lines below the least coherence
_LEVEL, _UNRELATED = 0.95, 0.99
#: a line with less than this share of the strongest one's power is not excited, nor one of which other inputs
#: leave less than the second share
_EXCITED, _LEFT = 1e-5, 0.05
#: independent averages that the default resolution gives, and longest segment by default, in samples
_AVERAGES, _LONGEST = 16, 2048
#: shortest segment, in samples
SHORTEST: Final = 16
#: amplitude of the images up to which a line is right within 3 %, of a flat response and of one that falls;
#: amplitude of the answer to them; share of the highest frequency above which lines tell how large it is
_IMAGE, _FOLDED, _TOP = 0.1, 0.03, 0.75
#: amplitudes of an input below this share of its strongest are rounding
_ROUNDING: Final = 1e-6
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
    inputs: number of inputs.
    images: (f) part of the input at a sampling rate below or above that goes with the line's, per amplitude.
    interval: between two samples, s.
    resolution: distance between two lines, Hz; of periods, 1/period.
    left_out: number of weaker lines that are not estimated.
    periods: for periodic records, of each; empty for windows.
    """

    frequencies: Floats
    excited: np.ndarray[tuple[int], np.dtype[np.bool_]]
    input_rms: Floats
    responses: tuple[Response, ...]
    segments: int
    averages: float
    inputs: int
    images: Floats
    interval: float
    resolution: float
    left_out: int = 0
    periods: tuple[Periods, ...] = ()

    @cached_property
    def least_coherence(self) -> float:
        """The coherence that an output without any relation to the input stays below in 99 % of lines."""
        degrees = self.averages - self.inputs
        if degrees <= 0.0:
            return 1.0
        limit = float(f_distribution.ppf(_UNRELATED, 2.0, 2.0 * degrees))
        return limit / (limit + degrees)

    def folded(self, response: Response) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """(f) lines at which the samples may show more of the answer to other frequencies than 3 %.

        Beyond half the sampling rate the output is taken to answer no more than at the highest excited lines.
        """
        at = self.frequencies[self.excited]
        if not at.size:
            return np.zeros_like(self.excited)
        size = np.nan_to_num(np.abs(response.gain))
        beyond = float(np.median(size[self.excited & (self.frequencies >= _TOP * at[-1])]))
        return np.asarray(self.excited & (self.images > _IMAGE) & (self.images * beyond > _FOLDED * size))


def estimate(
    signals: Sequence[Signals], resolution: float | None = None, like: Spectrum | None = None
) -> Spectrum | None:
    """The response of every output to the first input, from all records together.

    Periodic records are divided into their periods if all have the same one, and no resolution is given;
    others into Hann windows that overlap by half, without their straight line.

    Parameters
    ----------
    signals: with equal numbers of inputs and outputs, and similar sampling intervals.
    resolution: distance between lines, Hz; by default as fine as 16 averages allow, with at most 2048 samples
        in a segment.
    like: an earlier one of the same inputs and resolution: it has the periods, which take most of the time.

    Returns
    -------
    None if no record is long enough.
    """
    if resolution is None:
        periods = [find_periods(one) for one in signals] if like is None else list(like.periods)
        known = [one for one in periods if one is not None]
        if len(known) == len(signals) and _same(known):
            lines = period_lines(signals, known)
            if lines.inputs.shape[0] > 1 and lines.frequencies.size:
                apart = float(np.median([one.interval for one in signals]))
                count = float(lines.inputs.shape[0])
                return _spectrum(lines, count, apart, 1.0 / known[0].length, tuple(known))
    windows = _windows(signals, resolution)
    if windows is None:
        return None
    return _spectrum(*windows)


def _same(periods: Sequence[Periods]) -> bool:
    lengths = [one.length for one in periods]
    return max(lengths) - min(lengths) < 1e-3 * max(lengths)


def _windows(
    signals: Sequence[Signals], resolution: float | None
) -> tuple[Lines, float, float, float] | None:
    """Spectra of windows, the number of independent ones, the sampling interval, s, and the distance between
    lines, Hz."""
    interval = float(np.median([one.interval for one in signals]))
    parts = [part for one in signals for part in stretches(one, interval)]
    total = sum(part.times.size for part in parts)
    if resolution is not None:
        size = round(1.0 / (resolution * interval))
    else:
        size = min(2 * total // (_AVERAGES + 1), _LONGEST)
        # a window of many short records is no longer than most of them
        size = min(size, int(np.median([part.times.size for part in parts]))) if parts else 0
    size = max(size, SHORTEST)
    inputs, outputs, averages = [], [], 0.0
    for part in parts:
        count = max((part.times.size - size) // (size - size // 2) + 1, 0)
        begins = [k * (size - size // 2) for k in range(count)]
        inputs += [[_of_input(one[begin : begin + size]) for one in part.inputs] for begin in begins]
        outputs += [_transform(part.outputs[begin : begin + size]) for begin in begins]
        averages += count / (1.0 + 2.0 * _OVERLAP * (1.0 - 1.0 / count)) if count else 0.0
    if len(inputs) < 2:
        return None
    frequencies = np.asarray(np.fft.rfftfreq(size, interval), dtype=np.float64)
    last = frequencies.size - (size % 2 == 0)  # half the sampling rate has no phase
    kept = slice(min(_BESIDE_ZERO, last - 1), last)
    every = np.array(inputs)  # windows, inputs, lines and images
    spectra = np.moveaxis(every[:, :, :, kept], 1, -1)
    lines = Lines(
        frequencies[kept], spectra[:, 0], np.stack(outputs)[:, kept], np.moveaxis(spectra[:, 1:, :, 0], 1, -1)
    )
    return lines, averages, interval, float(frequencies[1])


def _transform(values: Floats, late: float = 0.0) -> Complex:
    """(lines, columns) amplitudes of a window of samples, less their straight line; of samples that are
    `late`, in their intervals."""
    count = values.shape[0]
    time = np.linspace(-1.0, 1.0, count)
    slope = (time @ values) / (time @ time)
    left = values - values.mean(axis=0) - np.outer(time, slope)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(count) + late) / count)
    return np.asarray(2.0 * np.fft.rfft(left * window[:, None], axis=0) / window.sum())


def _of_input(values: Floats) -> Complex:
    """(3, lines) amplitudes of an input (n, parts) in a window, also a sampling rate above and below."""
    size, parts = values.shape
    found = np.zeros((3, size // 2 + 1), dtype=np.complex128)
    lines = np.arange(size // 2 + 1)
    if parts < FINE:
        found[0] = _transform(values)[:, 0]
        return found
    fine = _transform(values.reshape(-1, 1), 0.5)[:, 0]
    periods = np.arange(fine.size) / (size * parts)  # in one part
    # the parts' middles are late, and their means are smaller than the command
    fine *= np.exp(-1j * np.pi * periods) / np.sinc(periods)
    found[:] = fine[lines], fine[size + lines], fine[size - lines].conj()
    return found


def _spectrum(
    lines: Lines, averages: float, interval: float, step: float, periods: tuple[Periods, ...] = ()
) -> Spectrum:
    """H1 of every output to the first input, conditioned on the others."""
    strongest = np.abs(lines.inputs).max(axis=(0, 1))
    every = np.where(np.abs(lines.inputs) < _ROUNDING * strongest, 0.0, lines.inputs)
    u, o = every[:, :, 0], every[:, :, 1:]
    y = np.concatenate([lines.outputs, lines.images], axis=2)
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
    outputs = lines.outputs.shape[2]
    images = np.max([np.nan_to_num(np.abs(one.gain)) for one in responses[outputs:]], axis=0)
    return Spectrum(
        lines.frequencies,
        excited,
        np.sqrt(0.5 * s_uu / count),
        responses[:outputs],
        count,
        averages,
        inputs,
        images,
        interval,
        step,
        lines.left_out,
        periods,
    )


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
