"""A closed loop on a bench's own controller: its settings, its state and its timing statistics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """A PID controller in parallel form, with the equations of `rigctl.steps.control.pid`; SI throughout."""

    actuator: str  #: the commanded output
    channel: str  #: the controlled channel
    to: float  #: the set-point
    ramp: float  #: rate of the set-point from the first reading, per s; infinite: a step change
    gain: float  #: K_p
    integral: float  #: K_i, per s
    derivative: float  #: K_d, times s
    filter_time: float  #: T_f, s
    tracking_time: float  #: T_t, s; infinite without an integral
    clamping: bool  #: anti-windup by clamping instead of back-calculation
    low: float  #: lower limit of the output
    high: float  #: upper limit of the output
    rate: float  #: limit of the output's rate of change, per s; infinite without a limit
    bumpless: bool  #: whether the integral is initialised so that the output continues from its present value
    period: float  #: s
    ahead: float = 0.0  #: feed-forward at the start


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """Timing statistics of a loop, measured by the controller itself; times in s.

    *Jitter* is the deviation of the time between two outputs from the loop's period; *latency* is the time
    from the scheduled time of an update until its output was set.
    """

    updates: int
    late: int  #: updates skipped because the previous one was still being computed
    missed: int  #: updates at which the output was held because the reading was impossible
    saturated: int  #: updates whose output was saturated
    jitter: tuple[float, float, float]  #: median, 99th percentile and maximum; likewise the latency
    latency: tuple[float, float, float]

    def values(self) -> Iterator[tuple[str, float, str]]:
        """Yield the values to be recorded: name, SI value, unit for display."""
        if self.updates > 1:
            yield "jitter_p50", self.jitter[0], "ms"
            yield "jitter_p99", self.jitter[1], "ms"
            yield "jitter_max", self.jitter[2], "ms"
        if self.updates:
            yield "latency_p99", self.latency[1], "ms"
            yield "saturated", self.saturated / self.updates, "%"


@dataclass(frozen=True, slots=True)
class LoopState:
    """The state of a loop: whether it is running, and its latest timing statistics."""

    running: bool
    figures: LoopFigures | None
