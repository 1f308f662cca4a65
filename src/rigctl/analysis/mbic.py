"""The price of an effect: Schwarz's criterion, modified for a search through a library."""

from __future__ import annotations

import math


def mbic(chi2: float, parameters: int, effects: int, samples: float, library: int) -> float:
    """``χ² + parameters·ln N_eff + 2·effects·ln K``; with `chi2` of zero, the penalty alone.

    The last term pays for having chosen among K effects.

    Parameters
    ----------
    chi2: squared error in units of the noise.
    parameters: free parameters of the effects.
    effects: how many were chosen.
    samples: N_eff, the effective number of independent readings.
    library: K, how many could have been chosen; at least 2 is counted.

    Source: M. Bogdan, J. K. Ghosh, R. W. Doerge, Genetics 167 (2004) 989.
    """
    return chi2 + parameters * math.log(samples) + 2.0 * effects * math.log(max(library, 2))
