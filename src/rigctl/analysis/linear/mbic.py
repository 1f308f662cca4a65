"""The penalty for an effect: Schwarz's criterion, modified for a search through a library."""

from __future__ import annotations

import math

from rigctl.model.fit.fit import FitResult


def mbic(chi2: float, parameters: int, effects: int, samples: float, library: int) -> float:
    """``χ² + parameters·ln N_eff + 2·effects·ln K``; with `chi2` of zero, the penalty alone.

    The last term accounts for the choice among K effects.

    Parameters
    ----------
    chi2: sum of squared residuals in units of the noise.
    parameters: number of free parameters of the effects.
    effects: number of effects in the set.
    samples: N_eff, the effective number of independent readings.
    library: K, the number of effects that could have been chosen; counted as at least 2.

    Source: M. Bogdan, J. K. Ghosh, R. W. Doerge, Genetics 167 (2004) 989.
    """
    return chi2 + parameters * math.log(samples) + 2.0 * effects * math.log(max(library, 2))


def effective_samples(fit: FitResult) -> float:
    """Effective sample size: n/(1 + 2·Σρ_k) of each channel, ρ_k at lag k; at least one for each record.

    An effect that acts only between records pays the same penalty as one that acts within them: the penalty
    may be too large for it, but never too small.
    """
    problem = fit.problem
    total = 0.0
    for c, channel in enumerate(problem.noise.channels):
        count = sum(int(problem.ok[k][:, c].sum()) for k in fit.fitted)
        together = (1.0 - channel.white) * channel.correlation / (1.0 - channel.correlation)
        total += count / ((1.0 + 2.0 * together) * channel.together)
    return max(total, float(len(fit.fitted)), 2.0)
