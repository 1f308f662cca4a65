"""The noise of every channel: its standard deviation, its correlation, and the source of both.

`ChannelNoise` is a plain description, SI: what the estimates (`estimate`, `residual_noise`) write and what
whitening, tests and designs read. It keeps where a number comes from and how well it is known, because a
verdict can be no more certain than the noise that it rests on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.variance import VarianceLaw, smooth_course

#: sources of a channel's noise, best first
Source = Literal["replicates", "quiet", "residuals", "rig", "differences", "floor", "assumed"]
#: how much is known of a channel's noise: all of it from something independent of the model, all of it
#: because the user says so, its white part alone, or nothing
Standing = Literal["measured", "stated", "floor", "guess"]


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel: a first-order autoregression plus white noise.

    The covariance of samples at times t and t′ is
    ``sigma²·((1 − white)·correlation^(|t − t′|/spacing) + white·[t = t′])``;
    with ``white = 0`` it is a plain AR(1), with ``correlation = 0`` plain white noise.

    Parameters
    ----------
    name: the channel.
    sigma: SI, standard deviation of one sample, converter steps included.
    correlation: ρ, of the autoregressive part, between samples one `NoiseModel.spacing` apart; 0 ≤ ρ < 1.
    step: SI, the converter step found in the data; 0 when there is none.
    source: from which sigma was learned.
    guessed: the data do not determine it; sigma is the rig file's number or an assumption.
    masked: number of samples identified as spikes and left out.
    statement: one sentence that summarises these attributes.
    white: share of the variance that is white, 0…1.
    bias: SI, the part of sigma that all samples of a quiet stretch share because the converter's steps are
        coarse compared with the noise (see `converter.stretch_bias`): it does not average out there. A moving
        signal has no such part.
    degrees: of freedom of sigma: a whitened sum of squares over n rows, divided by n, is distributed like
        F(n, degrees), not χ²(n)/n; 0 if guessed.
    edges: number of samples left out on edges at a switch that the sampling does not resolve
        (`edges.find_edges`).
    share: if not 0, the standard deviation of a value is this share of its magnitude, and sigma is that of a
        typical one.
    law: how the standard deviation depends on the channel's level and rate; sigma is then the root of the
        mean square over the readings.
    floor: SI, the white part, from differences of rising order (`rigctl.noise.floor`); 0 if not determined.
    plateau: the floor is measured; False if it is only an upper bound of the white part.
    together: if only the floor is known (source ``floor``), the number of neighbouring residuals that count
        as one: sigma² is then their mean square times this, see `rigctl.model.measured.standing`.
    allowed: SI, if only the floor is measured, the standard deviation of one reading that the rig file
        states: errors up to this are noise, whatever their colour; 0 if nothing is stated, or the data
        contradict it.
    over: s, the time over which the slow part of a stated noise changes; 0 if that is not stated.
    remark: what contradicts a number that the rig file states, in words; "" if nothing does.
    unusable: a stated number is so far from the data that no verdict can rest on either.
    """

    name: str
    sigma: float
    correlation: float = 0.0
    step: float = 0.0
    source: Source = "assumed"
    guessed: bool = True
    masked: int = 0
    statement: str = ""
    white: float = 0.0
    bias: float = 0.0
    degrees: int = 0
    edges: int = 0
    share: float = 0.0
    law: VarianceLaw | None = None
    floor: float = 0.0
    plateau: bool = False
    together: float = 1.0
    allowed: float = 0.0
    over: float = 0.0
    remark: str = ""
    unusable: bool = False

    def __post_init__(self) -> None:
        if not (self.sigma > 0.0 and np.isfinite(self.sigma)):
            raise ValueError(f"sigma of {self.name} must be positive, got {self.sigma}")
        if not 0.0 <= self.correlation < 1.0:
            raise ValueError(f"correlation of {self.name} must lie in [0, 1), got {self.correlation}")
        if not 0.0 <= self.white <= 1.0:
            raise ValueError(f"white share of {self.name} must lie in [0, 1], got {self.white}")

    @property
    def standing(self) -> Standing:
        """What is known of this noise."""
        if self.source == "floor":
            return "stated" if self.allowed else "floor"
        if self.source == "rig":
            return "stated"
        return "guess" if self.guessed else "measured"

    @property
    def own_scale(self) -> bool:
        """Whether only the floor is measured: what a model leaves is then the scale of its errors."""
        return self.source == "floor"

    @property
    def level(self) -> float:
        """SI, the standard deviation to compare an error with: the floor where only that is known."""
        return self.floor if self.source == "floor" and self.floor else self.sigma

    def stated(self, statement: str) -> ChannelNoise:
        """This noise with another statement."""
        return replace(self, statement=statement)

    def sigma_at(
        self, values: NDArray[np.float64], times: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Standard deviation (SI) of each value; that of a typical one if a value is 0 or missing.

        Noise with a `law` needs the whole time series of a record and its `times`.
        """
        if self.law is not None and times is not None:
            return self.law.sigma(*smooth_course(times, values))
        scaled = self.share * np.abs(values)
        return np.where(scaled > 0.0, scaled, self.sigma)

    def covariance(self, times: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
        """Covariance matrix (n, n) of the samples at `times` (s); SI². `bias` is not part of it."""
        apart = np.abs(times[:, None] - times[None, :]) / spacing
        coloured = (1.0 - self.white) * np.where(apart == 0.0, 1.0, self.correlation**apart)
        return np.asarray(self.sigma**2 * (coloured + self.white * (apart == 0.0)))


@dataclass(frozen=True)
class NoiseModel:
    """Noise of all channels, in the order of the columns of the measurements.

    Parameters
    ----------
    channels: one for each channel.
    spacing: s, the usual time between neighbouring samples, to which every `correlation` refers.
    statement: one sentence for a reader: the sources of the numbers, and what was guessed.
    """

    channels: tuple[ChannelNoise, ...]
    spacing: float
    statement: str = ""

    def __post_init__(self) -> None:
        if not (self.spacing > 0.0 and np.isfinite(self.spacing)):
            raise ValueError(f"spacing must be positive, got {self.spacing}")

    @property
    def names(self) -> tuple[str, ...]:
        """The channels' names, in order."""
        return tuple(channel.name for channel in self.channels)

    @property
    def own_scale(self) -> frozenset[str]:
        """The channels of which only the floor is known; see `ChannelNoise.own_scale`."""
        return frozenset(channel.name for channel in self.channels if channel.own_scale)

    @property
    def sigma(self) -> NDArray[np.float64]:
        """(channels) SI, standard deviation of one sample of each channel."""
        return np.array([channel.sigma for channel in self.channels])

    def sigma_at(
        self, values: NDArray[np.float64], times: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """(n, channels) SI, standard deviation of each value (n, channels)."""
        columns = [channel.sigma_at(values[:, i], times) for i, channel in enumerate(self.channels)]
        return np.stack(columns, axis=1) if columns else np.empty(values.shape)

    @property
    def guessed(self) -> tuple[str, ...]:
        """The channels whose noise the data do not determine."""
        return tuple(channel.name for channel in self.channels if channel.guessed)

    def channel(self, name: str) -> ChannelNoise:
        """The noise of one channel; KeyError if there is none with that name."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(name)

    def draw(self, times: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Noise (n, channels) with exactly this covariance at `times` (s); reproducible from the generator's
        state.

        Each channel is ``sigma·(√(1 − white)·a + √white·w)`` with w white and a the stationary recursion
        ``a_i = r_i·a_(i−1) + √(1 − r_i²)·v_i``, ``r_i = correlation^(Δt_i/spacing)``.
        """
        size, count = times.size, len(self.channels)
        drive, white = rng.standard_normal((2, size, count))
        rho = np.array([channel.correlation for channel in self.channels])
        share = np.array([channel.white for channel in self.channels])
        correlations = rho ** (np.diff(times)[:, None] / self.spacing)
        coloured = drive.copy()
        fresh = np.sqrt(1.0 - correlations**2)
        for i in range(1, size):
            coloured[i] = correlations[i - 1] * coloured[i - 1] + fresh[i - 1] * drive[i]
        return np.asarray(self.sigma * (np.sqrt(1.0 - share) * coloured + np.sqrt(share) * white))
