"""A PID controller in parallel form, updated sample by sample.

With the error ``e = r − y`` between the set-point ``r`` and the reading ``y``::

    v = u_ff + P + I + D
    P = K_p·e
    dI/dt = K_i·e + (u − v)/T_t                    (back-calculation)
    T_f·dD/dt + D = −K_d·dy/dt                     (derivative on measurement: no derivative kick)
    u = v, bounded by the output's limits and its rate of change

After Åström and Hägglund, *Advanced PID Control* (ISA, 2006), chapters 3 and 13: the integral is discretised
with forward differences, the derivative with backward ones, each over the time that has actually elapsed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum


class AntiWindup(Enum):
    """Method of anti-windup."""

    BACK_CALCULATION = "back_calculation"  #: the integral is corrected with the tracking time constant T_t
    CLAMPING = "clamping"  #: the integral is held while it would drive the output further into saturation


@dataclass(frozen=True, slots=True)
class Gains:
    """The controller's parameters; SI of actuator and channel."""

    proportional: float  #: K_p
    integral: float  #: K_i, per s
    derivative: float  #: K_d, times s
    filter_time: float  #: T_f, s; needed with K_d
    tracking_time: float  #: T_t, s; needed for back-calculation with K_i
    anti_windup: AntiWindup


@dataclass(frozen=True, slots=True)
class Bounds:
    """The limits of the output."""

    low: float
    high: float
    rate: float  #: largest rate of change, per s; may be infinite

    def apply(self, value: float, before: float, span: float) -> float:
        """Return the value, limited to the range and to what can be reached from `before` within `span` s."""
        reach = self.rate * span if math.isfinite(self.rate) else math.inf
        near = min(max(value, before - reach), before + reach)
        return min(max(near, self.low), self.high)


class Pid:
    """A PID controller and its state.

    Parameters
    ----------
    gains: the parameters.
    bounds: the limits of the output.
    output: the command at the start, SI.
    bumpless: whether the integral is initialised so that the output continues from `output`.
    """

    def __init__(self, gains: Gains, bounds: Bounds, output: float, *, bumpless: bool) -> None:
        self._gains = gains
        self._bounds = bounds
        self._bumpless = bumpless and gains.integral != 0.0
        self._integral = 0.0
        self._derivative = 0.0
        self._reading: float | None = None
        self._time = 0.0
        self.output = output
        self.saturated = False  #: the newest output was saturated

    def update(self, time: float, reading: float, setpoint: float, feed_forward: float) -> float:
        """Return the output after a reading, SI.

        Parameters
        ----------
        time: of the reading, s, later than that of the previous one.
        """
        gains, error = self._gains, setpoint - reading
        proportional = gains.proportional * error
        # The first update: no time has passed, so that nothing is integrated or differentiated. Bumpless, the
        # integral is what remains of the present output once the other terms are subtracted.
        if self._reading is None:
            span = 0.0
            if self._bumpless:
                self._keep(self.output - proportional - feed_forward)
        else:
            span = time - self._time
            self._differentiate(reading, span)
        self._reading, self._time = reading, time
        wanted = feed_forward + proportional + self._integral + self._derivative
        if math.isnan(wanted):  # infinite terms of opposite sign: the output is undefined, and is held
            self.saturated = True
            return self.output
        # The unlimited output is kept beside the limited one: their difference is what anti-windup works on.
        bounded = self._bounds.apply(wanted, self.output, span)
        self.saturated = not math.isclose(bounded, wanted, rel_tol=1e-9, abs_tol=1e-12)
        self.output = bounded
        self._integrate(error, wanted, span)
        return bounded

    def _differentiate(self, reading: float, span: float) -> None:
        """Update the filtered derivative by a backward difference."""
        gains = self._gains
        if gains.derivative == 0.0 or self._reading is None:
            return
        total = gains.filter_time + span
        self._derivative = (
            gains.filter_time * self._derivative - gains.derivative * (reading - self._reading)
        ) / total

    def _integrate(self, error: float, wanted: float, span: float) -> None:
        """Update the integral by a forward difference, for the next output."""
        gains, excess = self._gains, self.output - wanted
        rise = gains.integral * error * span
        if gains.anti_windup is AntiWindup.CLAMPING:
            if not self.saturated or rise * excess > 0.0:
                self._keep(self._integral + rise)
            return
        found = self._integral + rise
        if self.saturated and gains.integral != 0.0:
            found += excess * min(span / gains.tracking_time, 1.0)
        self._keep(found)

    def _keep(self, integral: float) -> None:
        """Set the integral, unless the value is not finite: the integral could never recover from that."""
        if math.isfinite(integral):
            self._integral = integral
