"""A multisine from its band: which multiples of 1/period it consists of, and how large each one is."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.frequency.multisine import low_crest_phases
from rigctl.steps.waveform.shapes import Multisine

#: most lines of a multisine, and its highest harmonic
_MOST_LINES, _HIGHEST = 2000, 10_000
#: rounding of a number of periods
_ROUNDING = 1e-6


def multisine(
    mean: float,
    band: tuple[float, float],
    period: float,
    lines: int | None = None,
    *,
    amplitude: float | None = None,
    rms: float | None = None,
    seed: int | None = None,
) -> Multisine:
    """One period of sines of equal amplitudes at multiples of 1/period, with phases that keep the peaks low.

    Parameters
    ----------
    band: lowest and highest frequency, Hz.
    lines: how many, in equal ratios; all multiples if None.
    amplitude, rms: the largest deviation from the mean, or the standard deviation about it; one of them.
    seed: another signal with the same lines for each number.

    Raises
    ------
    RigctlError
        the band holds no multiple, too many, or fewer than `lines`.
    """
    harmonics = _harmonics(*band, period, lines)
    phases = low_crest_phases(harmonics, seed)
    if rms is None:
        rms = (amplitude or 0.0) / phases.crest_factor
    return Multisine(
        mean,
        rms * math.sqrt(2.0 / len(harmonics)),
        tuple(order / period for order in harmonics),
        phases.values,
        phases.crest_factor,
        period,
    )


def _harmonics(low: float, high: float, period: float, lines: int | None) -> list[int]:
    """Return the multiples of ``1/period`` in a band, all or about `lines` of them in equal ratios.

    Raises
    ------
    RigctlError
        there are none, too many, or fewer than `lines`.
    """
    first, last = math.ceil(low * period - _ROUNDING), math.floor(high * period + _ROUNDING)
    if high < low or first > last:
        raise RigctlError(
            "the band of the multisine holds no multiple of 1/period",
            value=f"{low:g} to {high:g} Hz with a period of {period:g} s",
            expected="'to' above 'from', and a 'period' of several periods of 'from'",
        )
    count = last - first + 1 if lines is None else lines
    if count > _MOST_LINES or last > _HIGHEST:
        raise RigctlError(
            "too many lines between the frequencies of the multisine",
            value=f"{count} lines, up to {last} periods of the highest in a period",
            expected=f"at most {_MOST_LINES} lines and {_HIGHEST} periods: fewer 'lines', a shorter 'period'",
        )
    if lines is None:
        return list(range(first, last + 1))
    if not 1 <= lines <= last - first + 1:
        raise RigctlError(
            "the band of the multisine does not hold so many lines",
            value=str(lines),
            expected=f"1 to {last - first + 1} with a period of {period:g} s",
        )
    ratio = (last / first) ** (1.0 / max(lines - 1, 1))
    chosen: list[int] = []
    for index in range(lines):  # the next free one where two would be the same, leaving room for the rest
        order = max(round(first * ratio**index), chosen[-1] + 1 if chosen else first)
        chosen.append(min(order, last - (lines - 1 - index)))
    return chosen
