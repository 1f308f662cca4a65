"""Noise with memory, added to white noise: correlated, 1/f, or a drift."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

import numpy as np
from scipy.signal import lfilter

from rigctl_validation.benches.bench import Floats

Colour: TypeAlias = Literal["white", "heavy", "ar", "1/f", "drift"]
COLOURS: Final[tuple[Colour, ...]] = ("white", "ar", "1/f", "drift", "heavy")
#: correlations of neighbouring samples
CORRELATIONS = (0.5, 0.8, 0.95, 0.99)
#: standard deviation of the slow part, in that of the white one
_LEAST_SLOW, _MOST_SLOW = 0.5, 2.0
#: degrees of freedom of heavy tails: outliers of ten sigma are frequent
_TAILS = 3.0


def slow_share(colour: Colour, rng: np.random.Generator) -> float:
    """Standard deviation of the slow part, in that of the white one; 0 if there is none."""
    return 0.0 if colour in ("white", "heavy") else float(rng.uniform(_LEAST_SLOW, _MOST_SLOW))


def noise_series(colour: Colour, samples: int, slow: float, rng: np.random.Generator) -> Floats:
    """Noise whose white part has the standard deviation 1, and its slow part `slow`."""
    if colour == "heavy":
        return np.asarray(rng.standard_t(_TAILS, samples) / np.sqrt(_TAILS))
    white = rng.standard_normal(samples)
    if not slow:
        return np.asarray(white)
    if colour == "ar":
        correlation = float(rng.choice(CORRELATIONS))
        innovations = rng.standard_normal(samples + 1000) * np.sqrt(1.0 - correlation**2)
        part = lfilter([1.0], [1.0, -correlation], innovations)[1000:]  # without its beginning: stationary
    elif colour == "1/f":
        frequencies = np.fft.rfftfreq(samples)
        frequencies[0] = frequencies[1]
        spectrum = np.fft.rfft(rng.standard_normal(samples)) / np.sqrt(frequencies)
        part = _scaled(np.fft.irfft(spectrum, samples))
    else:
        part = _scaled(np.cumsum(rng.standard_normal(samples)))
    return np.asarray(white + slow * part)


def _scaled(series: Floats) -> Floats:
    series = series - series.mean()
    return np.asarray(series / series.std())
