"""The upper tail of χ², the p-value of a sum of squares."""

from __future__ import annotations


def chi2_tail(statistic: float, dof: int, known: int = 0) -> float:
    """Probability that χ² with `dof` degrees of freedom is at least `statistic`.

    If the noise has only `known` degrees of freedom, that of ``dof·F(dof, known)``.
    """
    from scipy.special import fdtrc, gammaincc

    if known:
        return float(fdtrc(dof, known, max(statistic, 0.0) / dof))
    return float(gammaincc(0.5 * dof, 0.5 * max(statistic, 0.0)))
