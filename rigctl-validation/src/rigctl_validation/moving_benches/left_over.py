"""What the best fit of a twin leaves of an effect that it hides, computed independently of the tool."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from rigctl_validation.amplitude import search_amplitude
from rigctl_validation.benches.bench import Floats
from rigctl_validation.moving_benches.campaign import MovingCampaign

#: fits of one amplitude evaluate the bench at most this many times for each unknown
_EVALUATIONS = 30


def left_over(campaign: MovingCampaign, amplitude: float) -> dict[str, float]:
    """By channel, the RMS that least squares leaves of noise-free readings, in sigmas of the white noise.

    The unknowns are the drawn values and the initial values of the states that a channel reads.
    """
    fit = _Fit(campaign, amplitude)
    unknowns = len(campaign.twin.drawn) + len(campaign.twin.free)
    start = np.concatenate([np.ones(len(campaign.twin.drawn)), np.zeros(len(campaign.twin.free))])
    done = least_squares(fit.residuals, start, method="lm", max_nfev=_EVALUATIONS * unknowns, ftol=1e-4)
    shares = done.fun.reshape(len(campaign.twin.bench.noise), -1)
    return {name: float(np.sqrt(np.mean(shares[k] ** 2))) for k, name in enumerate(campaign.twin.bench.noise)}


def amplitude_leaving(campaign: MovingCampaign, wanted: float) -> tuple[float, float]:
    """The amplitude leaving `wanted` sigmas in the channel in which it leaves most; and what it leaves."""
    hidden = campaign.hidden
    if hidden is None:
        return 0.0, 0.0
    tried: list[tuple[float, float]] = []

    def size(amplitude: float) -> float:
        with np.errstate(all="ignore"):
            try:
                result = max(left_over(campaign, amplitude).values())
            except ValueError:  # the bench diverges: residuals are not finite
                result = np.inf
        tried.append((amplitude, result))
        return result

    return search_amplitude(size, wanted, hidden.typical, hidden.largest, tried)


class _Fit:
    """Residuals of the bench with what it hides and other values of the bench without, in sigmas."""

    def __init__(self, campaign: MovingCampaign, amplitude: float) -> None:
        self._campaign = campaign
        self._target = campaign.readings(amplitude)

    @cached_property
    def _moves(self) -> Floats:
        """The change of each free initial value that a unit of its unknown makes: sizes of the states."""
        start = np.abs(np.array(self._campaign.twin.start + (self._campaign.twin.released or ())))
        scale = float(start.max(initial=0.0)) or 1.0
        return np.array([0.01 * scale for _ in self._campaign.twin.free])

    def residuals(self, unknowns: Floats) -> Floats:
        campaign, count = self._campaign, len(self._campaign.twin.drawn)
        groups = zip(campaign.twin.free, unknowns[count:] * self._moves, strict=True)
        moved = {index: float(change) for group, change in groups for index in group}
        model = campaign.readings(0.0, campaign.drawn * unknowns[:count], moved)
        noise = campaign.twin.bench.noise
        return np.concatenate([(self._target[name] - model[name]) / noise[name] for name in noise])
