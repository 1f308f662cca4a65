"""The equations of the moving twins, SI except where a unit is given, as machine code.

``y`` are the states, ``w`` the inputs in the units of their columns, ``p`` the drawn values of the bench,
``a`` the amplitudes of what it hides. Dry friction is not part of a rate: the integration treats sticking and
sliding.
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

_LITRES_PER_MINUTE = 1e-3 / 60.0
_DEGREES = math.pi / 180.0
_GRAVITY = 9.80665
_HEAT = 4180.0
#: height of the first tank's overflow pipe, m
_RIM = 0.20
_AMBIENT = 1.013e5
_CAPACITY = 2.0 * 3600.0

#: number of each bench in the compiled functions
CODES: Final = {
    name: code
    for code, name in enumerate(
        ("motor", "tanks", "spring", "pendulum", "chain", "exchanger", "chamber", "battery", "belt")
    )
}


@njit
def motor(y, w, p, a, f):
    """``L·di/dt = u − R·i − k·w``, ``J·dw/dt = k·i − d·w − load``."""
    f[0] = (w[0] - p[0] * y[0] - p[2] * y[1]) / p[1]
    f[1] = (p[2] * y[0] - p[4] * y[1] - w[1]) / p[3]


@njit
def tanks(y, w, p, a, f):
    """Torricelli's outflows; the first tank overflows by ``amplitude·((h1 − rim)/10 mm)^1.5``."""
    between = p[0] * math.sqrt(2.0 * _GRAVITY * max(y[0], 0.0))
    out = p[1] * math.sqrt(2.0 * _GRAVITY * max(y[1], 0.0))
    over = a[0] * _LITRES_PER_MINUTE * (max(y[0] - _RIM, 0.0) / 0.010) ** 1.5
    f[0] = (w[0] * _LITRES_PER_MINUTE - between - over) / 0.020
    f[1] = (between + w[1] * _LITRES_PER_MINUTE - out) / 0.020


@njit
def spring(y, w, p, a, f):
    """``m·dv/dt = k·(u − x) − c·v + push − k3·x³``."""
    f[0] = y[1]
    f[1] = (p[0] * (1e-3 * w[0] - y[0]) - p[1] * y[1] + w[1] - a[1] * y[0] ** 3) / 1.5


@njit
def pendulum(y, w, p, a, f):
    """``J·dw/dt = torque − m·g·l·sin(angle − tilt) − d·w − drag·w·|w|``."""
    back = 0.5 * _GRAVITY * 0.6 * math.sin(y[0] - _DEGREES * w[1])
    f[0] = y[1]
    f[1] = (w[0] - back - p[1] * y[1] - a[0] * y[1] * abs(y[1])) / p[0]


@njit
def chain(y, w, p, a, f):
    """Three lumps of 120 J/K; the middle loses ``amplitude·(T2 − room)``."""
    one, two = p[0] * (y[0] - y[1]), p[1] * (y[1] - y[2])
    f[0] = (w[0] - one) / 120.0
    f[1] = (one - two - a[0] * (y[1] - w[1])) / 120.0
    f[2] = (two - p[2] * (y[2] - w[1])) / 120.0


@njit
def exchanger(y, w, p, a, f):
    """``M·c·dT/dt = m·c·(T_in − T) ∓ UA·(T_hot − T_cold)``; the probe: ``dT_p/dt = (T_hot − T_p)/lag``."""
    through = p[0] * (y[0] - y[1]) / _HEAT
    f[0] = w[0] / 60.0 * (w[1] - y[0]) - through
    f[1] = 4.0 / 60.0 * (w[2] - y[1]) + through
    f[2] = (y[0] - y[2]) / a[0] if a[0] > 0.0 else 0.0


@njit
def chamber(y, w, p, a, f):
    """``V·dp/dt = k_f·fill·(p_s² − p²) − k_e·empty·(p² − p_a²) − leak·(p − p_a)``."""
    inward = p[0] * w[0] * ((1e5 * w[2]) ** 2 - y[0] ** 2)
    outward = p[1] * w[1] * (y[0] ** 2 - _AMBIENT**2)
    f[0] = (inward - outward - a[0] * _LITRES_PER_MINUTE * (y[0] - _AMBIENT)) / 1e-3


@njit
def battery(y, w, p, a, f):
    """``dq/dt = −(i + i_self)/Q``, ``C1·dv1/dt = i − v1/R1``."""
    f[0] = -(w[0] + a[0]) / _CAPACITY
    f[1] = (w[0] - y[1] / p[1]) / p[2]


@njit
def belt(y, w, p, a, f):
    """``dw/dt = (w_set − w)/T``, ``dphi/dt = w``, ``dx/dt = r·(1 + e·(warmth − 25 degC))·w`` in mm."""
    f[0] = y[1]
    f[1] = (w[0] - y[1]) / p[0]
    f[2] = p[1] * (1.0 + 1e-3 * (w[1] - 25.0)) * y[1]
    f[3] = 0.0


@njit
def rates(code, y, w, p, a, f):
    """The derivatives `f` of the states of a bench, without dry friction."""
    if code == 0:
        motor(y, w, p, a, f)
    elif code == 1:
        tanks(y, w, p, a, f)
    elif code == 2:
        spring(y, w, p, a, f)
    elif code == 3:
        pendulum(y, w, p, a, f)
    elif code == 4:
        chain(y, w, p, a, f)
    elif code == 5:
        exchanger(y, w, p, a, f)
    elif code == 6:
        chamber(y, w, p, a, f)
    elif code == 7:
        battery(y, w, p, a, f)
    else:
        belt(y, w, p, a, f)


@njit
def dry_friction(code, p, a):
    """Deceleration of state 1 by dry friction, in its unit per second; 0 without."""
    if code == 0:
        return a[0] / p[3]
    if code == 2:
        return a[0] / 1.5
    if code == 3:
        return a[1] / p[0]
    return 0.0


@njit
def follow(code, y, a, h):
    """What follows the states without a rate: a probe too quick for the step `h`, a carriage behind slack."""
    if code == 5 and a[0] < h:
        y[2] = y[0]
    elif code == 8:
        y[3] = min(max(y[3], y[2] - a[0]), y[2])
