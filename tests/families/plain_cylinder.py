"""An independent implementation of the bench's equations, in plain numbers with hard corners.

A reference for tests: it shares no code with the package, so that both cannot have the same mistake.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]

#: contributions of a hidden effect: flows in m^3/s (``ab`` from A to B, ``pt`` from P to tank),
#: ``friction`` and ``load`` in N, ``mass`` in kg, ``area`` and ``setting`` as factors
Extra = Callable[[Vector, float], dict[str, float]]


def nothing(y: Vector, mu: float) -> dict[str, float]:
    """No hidden effect."""
    return {}


@dataclass(frozen=True)
class PlainCylinder:
    """The published bench, meter-in; pressures gauge in Pa, temperatures in degC."""

    p_set: float = 20e5
    heater: float = 0.0
    ambient: float = 22.0
    A_t: float = 3.3e-6
    A_e: float = 28e-6
    Cd: float = 0.62
    m: float = 12.0
    b: float = 120.0
    V0: float = 60e-6
    V_line: float = 400e-6
    tau: float = 0.025
    beta: float = 1.4e9
    R: float = 2e8
    Q_pump: float = 14e-3 / 60
    eta: float = 0.9
    UA: float = 12.0
    throttle: str = "meter_in"
    L: float = 0.25
    extra: Extra = nothing
    #: compliance in 1/Pa that a hidden effect adds at a pressure
    soft: Callable[[float], float] = lambda p: 0.0
    #: m by which a seal bends before it slides; if not 0, its bending is an eighth state
    presliding: float = 0.0

    def rates(self, y: Vector, command: float) -> Vector:
        """The derivatives of (T degC, u, ps, pA, pB, x, v), and of the seal's bending where it bends."""
        T, u, ps, pA, pB, x, v = y[:7]
        A_A = math.pi / 4 * 0.05**2
        A_B = math.pi / 4 * (0.05**2 - 0.025**2)
        rho = 870.0 * (1 - 7e-4 * (T - 15.0))
        mu = 3.1083e-5 * math.exp(1132.5833 / (T + 273.15 - 147.4466))
        more = dict.fromkeys(("ab", "at", "bt", "bo", "pa", "pb", "pt", "friction", "load", "mass", "R"), 0.0)
        more |= {"area": 1.0, "setting": 1.0} | self.extra(y, mu)

        def orifice(opening: float, dp: float, throttled: bool) -> float:
            edge = self.A_e * opening
            throttle = self.A_t * more["area"]
            area = throttle * edge / math.hypot(throttle, edge) if throttled else edge
            return self.Cd * area * math.copysign(math.sqrt(2 * abs(dp) / rho), dp)

        into, out = self.throttle in ("meter_in", "both"), self.throttle in ("meter_out", "both")
        up, down = max(u, 0.0), max(-u, 0.0)
        q_pa, q_bt = orifice(up, ps - pA, into), orifice(up, pB, out)
        q_pb, q_at = orifice(down, ps - pB, into), orifice(down, pA, out)
        relief = max(0.0, self.Q_pump + (ps - self.p_set * more["setting"]) / (self.R + more["R"]))
        stiff = [1.0 / (1.0 / self.beta + self.soft(p)) for p in (ps, pA, pB)]
        stop = 0.0
        if x < 0:
            stop = -2e8 * x - 1e5 * v
        if x > self.L:
            stop = -2e8 * (x - self.L) - 1e5 * v
        heat = self.heater + ps * self.Q_pump / self.eta - self.UA * (T - self.ambient)
        return np.array(
            [
                heat / (rho * 0.08 * 1900.0),
                (command - u) / self.tau,
                stiff[0]
                / self.V_line
                * (self.Q_pump - q_pa - q_pb - relief - more["pa"] - more["pb"] - more["pt"]),
                stiff[1]
                / (self.V0 + A_A * x)
                * (q_pa - q_at - A_A * v + more["pa"] - more["at"] - more["ab"]),
                stiff[2]
                / (self.V0 + A_B * (self.L - x))
                * (A_B * v - q_bt + q_pb + more["ab"] + more["pb"] - more["bt"] - more["bo"]),
                v,
                (A_A * pA - A_B * pB - self.b * v + stop - more["friction"] - more["load"])
                / (self.m + more["mass"]),
                *((v - abs(v) * bent) / self.presliding for bent in y[7:]),
            ]
        )

    def record(
        self,
        celsius: float,
        commands: Sequence[tuple[float, float]],
        times: Vector,
        *,
        start_at: float | None = None,
        method: str = "Radau",
        rtol: float = 1e-8,
    ) -> Vector:
        """The states (sample, state) at `times`; pB starts trapped at 0.9 of the setting.

        `commands` are (duration, valve) one after the other. The record starts retracted, with pA at tank; or
        with the piston at rest at `start_at`, where pA holds pB.
        """
        balance = 0.0 if start_at is None else 0.75 * 0.9 * self.p_set
        y = np.array([celsius, 0.0, self.p_set, balance, 0.9 * self.p_set, start_at or 0.0, 0.0])
        atol = rtol * np.array([10.0, 0.1, 1e7, 1e7, 1e7, 1e-2, 0.1])
        if self.presliding:  # after a retraction
            y, atol = np.append(y, -1.0), np.append(atol, rtol)
        start, parts = 0.0, []
        for number, (duration, command) in enumerate(commands):
            end = start + duration
            last = number == len(commands) - 1
            inside = times[(times >= start) & (times < end - 1e-12)] if not last else times[times >= start]
            done = solve_ivp(
                lambda t, y, c=command: self.rates(y, c),
                (start, max(end, times[-1]) if last else end),
                y,
                method=method,
                rtol=rtol,
                atol=atol,
                dense_output=True,
            )
            assert done.success, done.message
            if inside.size:
                parts.append(done.sol(inside).T)
            y, start = done.y[:, -1], end
        return np.concatenate(parts)

    def stroke(self, celsius: float, open_for: float = 1.05, after: float = 1.0) -> float:
        """The stroke of one timed extension, m."""
        end = np.array([open_for + after])
        return float(self.record(celsius, [(open_for, 1.0), (after, 0.0)], end)[0, 5])
