"""The constants of Vogel's law in closed form from three measured points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.errors import RigctlError
from rigctl.physics.oil.viscosity import vogel


@dataclass(frozen=True)
class VogelConstants:
    """The constants of ``mu0 = a * exp(b / (T - c))``: a in Pa*s, b and c in K."""

    a: float
    b: float
    c: float

    def viscosity(self, temperature: float) -> float:
        """The dynamic viscosity in Pa*s at `temperature` in K.

        Raises
        ------
        RigctlError
            the temperature is not above c, where the law has its pole.
        """
        if not temperature > self.c:
            raise RigctlError(
                "Vogel's law has no value at this temperature",
                value=f"{temperature:g} K",
                expected=f"more than c = {self.c:.4g} K",
            )
        return float(vogel(temperature, self.a, self.b, self.c))


def vogel_from_points(points: Sequence[tuple[float, float]]) -> VogelConstants:
    """Solve Vogel's law exactly for three points (T in K, mu in Pa*s).

    With the points in order of temperature, ``L_ij = ln(mu_i / mu_j)`` and
    ``r = L_12 * (T3 - T2) / (L_23 * (T2 - T1))``:
    ``c = (r*T1 - T3) / (r - 1)``, ``b = L_12 * (T1 - c) * (T2 - c) / (T2 - T1)``,
    ``a = mu_1 / exp(b / (T1 - c))``.

    Raises
    ------
    RigctlError
        there are not three points, two have the same temperature, a viscosity is not positive or does not
        decrease with temperature, or the curvature of the points has the wrong sign for Vogel's law.
    """
    if len(points) != 3:
        raise RigctlError(
            "Vogel's law has three constants", value=f"{len(points)} points", expected="three points"
        )
    (t1, mu1), (t2, mu2), (t3, mu3) = sorted(points)
    if not t1 < t2 < t3:
        raise RigctlError("two points have the same temperature", expected="three different temperatures")
    if not mu1 > mu2 > mu3 > 0.0:
        raise RigctlError(
            "viscosity must be positive and fall as temperature rises",
            value=", ".join(f"{mu:g} Pa*s at {t:g} K" for t, mu in ((t1, mu1), (t2, mu2), (t3, mu3))),
        )
    fall_12, fall_23 = math.log(mu1 / mu2), math.log(mu2 / mu3)
    ratio = fall_12 * (t3 - t2) / (fall_23 * (t2 - t1))
    # ratio is (T3 - c) / (T1 - c), which exceeds 1 for any law with its pole below the points
    if not ratio > 1.0 + 1e-9:
        raise RigctlError(
            "no Vogel law passes through these three points",
            hint="the logarithm of viscosity must fall ever more slowly as temperature rises",
        )
    c = (ratio * t1 - t3) / (ratio - 1.0)
    b = fall_12 * (t1 - c) * (t2 - c) / (t2 - t1)
    return VogelConstants(mu1 / math.exp(b / (t1 - c)), b, c)
