"""The bench's equations written a second time, as plain numbers with hard corners.

An oracle: it shares nothing with the package, so that a mistake there cannot hide here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]


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

    def rates(self, y: Vector, command: float) -> Vector:
        """The derivatives of (T degC, u, ps, pA, pB, x, v)."""
        T, u, ps, pA, pB, x, v = y
        A_A = math.pi / 4 * 0.05**2
        A_B = math.pi / 4 * (0.05**2 - 0.025**2)
        rho = 870.0 * (1 - 7e-4 * (T - 15.0))

        def orifice(opening: float, dp: float, throttled: bool) -> float:
            edge = self.A_e * opening
            area = self.A_t * edge / math.hypot(self.A_t, edge) if throttled else edge
            return self.Cd * area * math.copysign(math.sqrt(2 * abs(dp) / rho), dp)

        into, out = self.throttle in ("meter_in", "both"), self.throttle in ("meter_out", "both")
        up, down = max(u, 0.0), max(-u, 0.0)
        q_pa, q_bt = orifice(up, ps - pA, into), orifice(up, pB, out)
        q_pb, q_at = orifice(down, ps - pB, into), orifice(down, pA, out)
        relief = max(0.0, self.Q_pump + (ps - self.p_set) / self.R)
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
                self.beta / self.V_line * (self.Q_pump - q_pa - q_pb - relief),
                self.beta / (self.V0 + A_A * x) * (q_pa - q_at - A_A * v),
                self.beta / (self.V0 + A_B * (self.L - x)) * (A_B * v - q_bt + q_pb),
                v,
                (A_A * pA - A_B * pB - self.b * v + stop) / self.m,
            ]
        )

    def stroke(self, celsius: float, open_for: float = 1.05, after: float = 1.0, rtol: float = 1e-8) -> float:
        """How far one timed extension moves the piston, in m."""
        y = np.array([celsius, 0.0, self.p_set, 0.0, 0.9 * self.p_set, 0.0, 0.0])
        atol = np.array([1e-6, 1e-8, 1.0, 1.0, 1.0, 1e-9, 1e-8])
        for command, duration in ((1.0, open_for), (0.0, after)):
            done = solve_ivp(
                lambda t, y, c=command: self.rates(y, c),
                (0.0, duration),
                y,
                method="Radau",
                rtol=rtol,
                atol=atol,
            )
            assert done.success, done.message
            y = done.y[:, -1]
        return float(y[5])
