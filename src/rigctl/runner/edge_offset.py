"""How far the clock of a channel is behind, from edges whose times are known.

A reading that says t was taken at t + τ. An edge at T lies between two readings, the last before it that says
a and the first after it that says b: ``a + τ < T ≤ b + τ``. Each edge so gives an interval of τ, as wide as
the period of the readings and the uncertainty of T together. τ is the mean of their middles. Its uncertainty
is Student's for that mean, and no less than half of what all the intervals have in common: were the edges
always at the same place between two readings, their scatter would be zero and say nothing.
Source: JCGM 100:2008 (GUM), 4.2 and 4.3.7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ExitCode, RigctlError
from rigctl.units import show

Floats = NDArray[np.float64]

#: the share of a hold up to which an offset can be told
REACH = 0.25
#: a response is larger than this many standard deviations of the readings
_LEAST_RESPONSE = 8.0
#: a reading of which the step is so far from either end is on its way
_ON_ITS_WAY = 0.1
#: the least number of edges, and the least share of them, that are seen clearly
_FEWEST, _LEAST_SHARE = 6, 0.5


@dataclass(frozen=True)
class Edge:
    """A switch of the output, s by the clock of the commands.

    Attributes
    ----------
    earliest, latest: the interval that contains it.
    rising: from the safe state, not back to it.
    """

    earliest: float
    latest: float
    rising: bool

    @property
    def time(self) -> float:
        """The middle of the interval."""
        return 0.5 * (self.earliest + self.latest)


@dataclass(frozen=True)
class Offset:
    """How far a clock is behind, s: its readings were taken later than they say; negative if it is ahead.

    Attributes
    ----------
    uncertainty: 95 %.
    edges: from how many.
    """

    behind: float
    uncertainty: float
    edges: int


def offset_of(channel: str, times: Floats, values: Floats, edges: Sequence[Edge], hold: float) -> Offset:
    """The offset of the clock that dates a channel.

    Parameters
    ----------
    times, values: its readings, in order of time.
    edges: in order, at least `hold` apart, alternately rising and falling.

    Raises
    ------
    RigctlError
        it does not respond, responds gradually, or its clock is off too far to be told.
    """
    off = f", or its clock is off by more than {show(REACH * hold, 's')}"
    shares = _shares(times, values, edges, hold)
    if shares is None:
        raise _unmeasured(f"{channel} does not respond to the output{off}", "a channel wired to the output")
    seen = [_interval(times, shares, edge, hold) for edge in edges]
    found = [one for one in seen if one is not None]
    if len(found) < max(_FEWEST, _LEAST_SHARE * len(edges)):
        raise _unmeasured(
            f"{channel} shows {len(found)} of {len(edges)} edges clearly{off}", "one jump for each edge"
        )
    # One reading on its way may be an average over the edge; more of them are a response that takes time.
    if np.mean([_on_its_way(times, shares, edge, hold) for edge in edges]) > 1.0:
        raise _unmeasured(
            f"{channel} responds gradually, and how late its readings are cannot be told from that",
            "a channel that sees the output at once",
        )
    offset = _mean(np.array(found))
    if abs(offset.behind) + offset.uncertainty > REACH * hold:
        raise _unmeasured(f"{channel}: its clock is off by about {show(offset.behind, 's', digits=2)}",
                          f"less than a quarter of 'hold', {show(REACH * hold, 's')}")  # fmt: skip
    return offset


def _unmeasured(what: str, expected: str) -> RigctlError:
    return RigctlError(what, expected=expected, hint="No offset was measured", exit_code=ExitCode.FAILED)


def _shares(times: Floats, values: Floats, edges: Sequence[Edge], hold: float) -> Floats | None:
    """Each reading as a share of the response: 0 in the safe state, 1 at the setting; None without one.

    The levels are those of the middle of each hold, which an offset within reach does not take over an edge.
    """
    levels, scatter = [], 0.0
    for rising in (False, True):
        inside = np.zeros(times.size, dtype=bool)
        for edge in edges:
            if edge.rising is rising:
                inside |= np.abs(times - edge.time - 0.5 * hold) <= (0.5 - REACH) * hold
        if not inside.any():
            return None
        level = float(np.median(values[inside]))
        scatter = max(scatter, 1.4826 * float(np.median(np.abs(values[inside] - level))))
        levels.append(level)
    step = levels[1] - levels[0]
    if abs(step) <= _LEAST_RESPONSE * scatter or step == 0.0:
        return None
    return np.asarray((values - levels[0]) / step)


def _near(times: Floats, shares: Floats, edge: Edge, hold: float) -> tuple[Floats, Floats]:
    """The readings within half a hold of an edge, as shares of its change."""
    near = np.abs(times - edge.time) <= 0.5 * hold
    return times[near], shares[near] if edge.rising else 1.0 - shares[near]


def _interval(times: Floats, shares: Floats, edge: Edge, hold: float) -> tuple[float, float] | None:
    """The interval of τ that one edge gives; None if it is not exactly one jump."""
    at, share = _near(times, shares, edge, hold)
    after = share >= 0.5
    first = int(np.argmax(after)) if after.any() else 0
    # Not seen at all, or more than one jump near this edge: a bouncing contact says nothing about the clock.
    if first == 0 or not after[first:].all():
        return None
    return edge.earliest - float(at[first]), edge.latest - float(at[first - 1])


def _on_its_way(times: Floats, shares: Floats, edge: Edge, hold: float) -> int:
    """The number of readings that are at neither end of a change."""
    _, share = _near(times, shares, edge, hold)
    return int(((share > _ON_ITS_WAY) & (share < 1.0 - _ON_ITS_WAY)).sum())


def _mean(intervals: Floats) -> Offset:
    """The mean of the middles of intervals (n, 2) of τ."""
    from scipy.stats import t

    count = len(intervals)
    middles, widths = intervals.mean(axis=1), intervals[:, 1] - intervals[:, 0]
    # a place that is equally likely within the interval has this standard deviation
    std = max(float(middles.std(ddof=1)), float(widths.mean()) / math.sqrt(12.0))
    common = float(intervals[:, 1].min() - intervals[:, 0].max())
    spread = float(t.ppf(0.975, count - 1)) * std / math.sqrt(count)
    return Offset(float(middles.mean()), max(spread, 0.5 * common), count)
