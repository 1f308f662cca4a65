"""Integration for the small benches: smooth stretches by SciPy, with dry friction that sticks and slides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats: TypeAlias = NDArray[np.float64]
#: derivatives of the states at a time
Rates: TypeAlias = Callable[[float, Floats], Sequence[float]]

_RTOL, _ATOL = 1e-9, 1e-12
#: a velocity below which the state is at rest
_STILL = 1e-9


def steps(instants: Sequence[float], values: Sequence[float]) -> Callable[[float], float]:
    """A command that is 0 until the first instant and holds each value from its instant on."""
    edges, held = np.asarray(instants), np.concatenate([[0.0], values])
    return lambda time: float(held[np.searchsorted(edges, time, side="right")])


def sampled(signal: Callable[[float], float], time: Floats) -> Floats:
    """A signal as a logger samples it."""
    return np.array([signal(float(t)) for t in time])


def integrate(rates: Rates, start: Sequence[float], time: Floats, breaks: Sequence[float]) -> Floats:
    """(samples, states) of a system that is smooth between the breaks."""
    return with_dry_friction(rates, start, time, breaks)


def with_dry_friction(
    rates: Rates,
    start: Sequence[float],
    time: Floats,
    breaks: Sequence[float],
    *,
    velocity: int = 0,
    friction: float = 0.0,
) -> Floats:
    """(samples, states) of a system whose state `velocity` is braked by dry friction.

    Coulomb friction: ``dv/dt = a − f·sign(v)`` while it slides; at rest it stays until ``|a| > f``.
    Transitions are located as events, so nothing is smoothed.

    Parameters
    ----------
    rates: of all states, without the friction.
    friction: the deceleration by friction, in the unit of `velocity` per second.
    """
    states = np.empty((time.size, len(start)))
    states[0] = start
    state, now = np.asarray(start, dtype=float), float(time[0])
    for end in [*sorted(b for b in breaks if time[0] < b < time[-1]), float(time[-1])]:
        while now < end:
            now, state = _stretch(rates, now, state, end, time, states, velocity, friction)
    return states


def _stretch(
    rates: Rates,
    now: float,
    state: Floats,
    end: float,
    time: Floats,
    states: Floats,
    velocity: int,
    friction: float,
) -> tuple[float, Floats]:
    """Integrate until the end, or until sticking or sliding ends; returns the time and the states there."""
    # a command that changes at `now` has its new value just after it
    after = now + 1e-9 * (end - now)
    sense = _sense(rates, after, state, velocity, friction) if friction else 0.0
    sticks = bool(friction) and sense == 0.0

    def moved(t: float, y: Floats) -> Floats:
        derivatives = np.array(rates(min(max(t, after), end - 1e-9 * (end - now)), y), dtype=float)
        if sticks:
            derivatives[velocity] = 0.0
        elif friction:
            derivatives[velocity] -= sense * friction
        return derivatives

    def edge(t: float, y: Floats) -> float:
        return abs(float(rates(max(t, after), y)[velocity])) - friction if sticks else float(y[velocity])

    edge.__dict__.update(terminal=True, direction=1.0 if sticks else -sense)
    if sticks:
        state[velocity] = 0.0
    done = solve_ivp(
        moved,
        (now, end),
        state,
        method="RK45" if friction else "LSODA",
        rtol=_RTOL,
        atol=_ATOL,
        events=[edge] if friction else None,
        t_eval=None,
        dense_output=True,
    )
    assert done.sol is not None  # noqa: S101 - dense output was asked for
    last = float(done.t[-1])
    inside = (time > now) & (time <= last)
    if inside.any():
        states[inside] = done.sol(time[inside]).T
    ended = np.array(done.y[:, -1])
    if friction and last < end:
        ended[velocity] = 0.0
    return (end if end - last < 1e-12 * max(end, 1.0) else last), ended


def _sense(rates: Rates, now: float, state: Floats, velocity: int, friction: float) -> float:
    """The sign of the motion that begins here: +1, −1, or 0 while it sticks."""
    speed = float(state[velocity])
    if abs(speed) > _STILL:
        return float(np.sign(speed))
    push = float(rates(now, state)[velocity])
    return 0.0 if abs(push) <= friction * (1.0 - 1e-9) else float(np.sign(push))
