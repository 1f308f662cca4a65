"""Fixed-step Runge–Kutta integration of the moving twins, with dry friction that sticks and slides exactly.

Between two samples a command is held and a measured input is a straight line. With dry friction the motion
between two reversals is smooth, so each reversal is located inside its step and the step is divided there.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rigctl_validation.bench.compiled import compiled
from rigctl_validation.moving_benches.equations import dry_friction, follow, rates

#: a velocity below which the state is at rest
_STILL = 1e-12
#: divisions of a step at reversals, and halvings to locate each
_DIVISIONS, _HALVINGS = 4, 40


@njit
def _slope(code, y, at, p, a, brake, sense, f):
    rates(code, y, at, p, a, f)
    if brake > 0.0:
        f[1] = 0.0 if sense == 0.0 else f[1] - sense * brake


@njit
def _step(code, y, w, change, begin, share, dt, p, a, brake, sense):
    """One classical Runge–Kutta step over the share of a sampling period `dt` that starts at `begin`."""
    k, point, at, ended = np.zeros(y.size), y.copy(), w.copy(), y.copy()
    for stage in range(
        4
    ):  # one call of the equations in a loop: four would take four times as long to compile
        part = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        for j in range(y.size):
            point[j] = y[j] + part * share * dt * k[j]
        for j in range(w.size):
            at[j] = w[j] + change[j] * (begin + part * share)
        _slope(code, point, at, p, a, brake, sense, k)
        weight = share * dt / (6.0 if stage in (0, 3) else 3.0)
        for j in range(y.size):
            ended[j] += weight * k[j]
    return ended


@njit
def _sense(code, y, at, p, a, brake):
    """The sign of the motion that begins here: +1, −1, or 0 while it sticks."""
    if abs(y[1]) > _STILL:
        return 1.0 if y[1] > 0.0 else -1.0
    f = y.copy()
    rates(code, y, at, p, a, f)
    if abs(f[1]) <= brake:
        return 0.0
    return 1.0 if f[1] > 0.0 else -1.0


@njit
def _advance(
    code,
    y,
    w,
    change,
    begin,
    share,
    dt,
    p,
    a,
    brake,
):
    """The states after a part of a sampling period, divided where a sliding state comes to rest."""
    left = share
    for _ in range(_DIVISIONS):
        sense = _sense(code, y, w + change * begin, p, a, brake) if brake > 0.0 else 0.0
        if sense == 0.0 and brake > 0.0:
            y[1] = 0.0
        low, high, trial = 0.0, left, left
        for halving in range(_HALVINGS):
            ended = _step(code, y, w, change, begin, trial, dt, p, a, brake, sense)
            slides = sense == 0.0 or ended[1] * sense >= 0.0
            if slides and halving == 0:
                return ended
            if slides:
                low = trial
            else:
                high = trial
            trial = 0.5 * (low + high)
        y = ended
        y[1] = 0.0
        begin += trial
        left -= trial
    return y


def integrate(code, start, inputs, held, p, a, dt, steps):
    """(samples, states) of a bench.

    Parameters
    ----------
    inputs: (samples, inputs); those with `held` 1 keep each value until the next sample, the others are
        straight lines between samples.
    dt, steps: the sampling period, s, and the integration steps in each.
    """
    states = np.empty((inputs.shape[0], start.size))
    y = start.copy()
    states[0] = y
    brake = dry_friction(code, p, a)
    for i in range(inputs.shape[0] - 1):
        change = (inputs[i + 1] - inputs[i]) * (1.0 - held)
        for k in range(steps):
            y = _advance(code, y, inputs[i], change, k / steps, 1.0 / steps, dt, p, a, brake)
            follow(code, y, a, dt / steps)
        states[i + 1] = y
    return states


#: `integrate` as machine code
states_of = compiled(integrate)
