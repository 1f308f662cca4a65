"""The penalty for an effect: Schwarz's criterion, modified for a search through a library."""

from __future__ import annotations

import math


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
