"""Sensors of the bench: their errors, coloured noise, and quantisation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench import equations
from rigctl_validation.bench.parameters import Sensors
from rigctl_validation.bench.record import Trace

#: state measured by each channel
CHANNELS = {
    "oil_temperature": equations.T_PROBE,
    "supply_pressure": equations.P_PROBE,
    "position": equations.X,
    "pressure_a": equations.PA,
    "pressure_b": equations.PB,
}


@dataclass(frozen=True)
class Noise:
    """Noise of every channel: SI standard deviation, first-order correlation, converter step (0: none)."""

    sigma: dict[str, float] = field(
        default_factory=lambda: {
            "oil_temperature": 0.1,
            "supply_pressure": 8e3,
            "position": 1e-4,
            "pressure_a": 1e4,
            "pressure_b": 1e4,
        }
    )
    correlation: float = 0.0
    step: dict[str, float] = field(default_factory=dict)


#: the published bench: ten bits over 300 mm and over 125 bar, quarter degrees
TEN_BITS = {
    "oil_temperature": 0.25,
    "supply_pressure": 125e5 / 1023,
    "position": 0.300 / 1023,
    "pressure_a": 125e5 / 1023,
    "pressure_b": 125e5 / 1023,
}


def true_channels(trace: Trace, sensors: Sensors) -> dict[str, NDArray[np.float64]]:
    """Each channel's reading before noise: with errors of gain, offset, drift and play."""
    shown = {name: trace.states[:, state].copy() for name, state in CHANNELS.items()}
    oil = trace.states[:, equations.T_OIL]
    warm = equations.above_20_celsius(oil[0], sensors.position_drift_fade)
    moved = play(shown["position"], sensors.position_backlash)
    gain = 1.0 + sensors.position_gain * (1.0 + sensors.position_bow * moved) + sensors.position_drift * warm
    shown["position"] = gain * moved + sensors.position_offset
    shown["position"] += sensors.dented_scale * np.exp(-(((moved - 0.06) / 0.015) ** 2))
    shown["position"] += sensors.root_scale * np.sqrt(np.maximum(moved, 0.0) / 0.1)
    soft = sensors.soft_transducer * (shown["supply_pressure"] / 3e6) ** 2
    shown["supply_pressure"] = soft + (1.0 + sensors.pressure_gain) * shown["supply_pressure"]
    warmer = oil - equations.DRIFT_ORIGIN
    shown["supply_pressure"] += sensors.pressure_offset * (1.0 + sensors.pressure_offset_warming * warmer)
    shown["oil_temperature"] += sensors.thermocouple_offset
    return shown


def play(position: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """A play operator: the sensor follows only after the slack of `width` has been taken up.

    A record starts after a retract, so that the slack has been taken up on that side.
    """
    if width == 0.0:
        return position
    followed = np.empty_like(position)
    at = position[0] + width / 2
    for i, x in enumerate(position):
        at = min(max(at, x - width / 2), x + width / 2)
        followed[i] = at
    return followed


def coloured(rng: np.random.Generator, size: int, sigma: float, correlation: float) -> NDArray[np.float64]:
    """Stationary first-order autoregression: e_t = ρ·e_(t−1) + √(1 − ρ²)·σ·w_t."""
    white = rng.standard_normal(size) * sigma
    if correlation == 0.0:
        return white
    from scipy.signal import lfilter

    drive = white * np.sqrt(1.0 - correlation**2)
    drive[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -correlation], drive))


class Correlated:
    """Correlated noise and quantisation one reading at a time, for a bench that is read live."""

    def __init__(self, rng: np.random.Generator, noise: Noise) -> None:
        self._rng = rng
        self._noise = noise
        self._last: dict[str, float] | None = None

    def added(self, shown: dict[str, float]) -> dict[str, float]:
        """The readings with the noise of this sample."""
        rho, last = self._noise.correlation, self._last
        drawn = {name: self._noise.sigma[name] * float(self._rng.standard_normal()) for name in shown}
        if last is not None:
            fresh = math.sqrt(1.0 - rho * rho)
            drawn = {name: rho * last[name] + fresh * value for name, value in drawn.items()}
        self._last = drawn
        return {name: self._converted(name, value + drawn[name]) for name, value in shown.items()}

    def _converted(self, name: str, value: float) -> float:
        step = self._noise.step.get(name, 0.0)
        return round(value / step) * step if step else value


def measure(
    trace: Trace, sensors: Sensors, noise: Noise, rng: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """The channels as recorded."""
    return {name: noisy(name, truth, noise, rng) for name, truth in true_channels(trace, sensors).items()}


def noisy(
    name: str, truth: NDArray[np.float64], noise: Noise, rng: np.random.Generator
) -> NDArray[np.float64]:
    """A channel's readings with noise, converted."""
    value = truth + coloured(rng, truth.size, noise.sigma[name], noise.correlation)
    step = noise.step.get(name, 0.0)
    return np.round(value / step) * step if step else value
