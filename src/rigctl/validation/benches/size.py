"""How large what a bench hides is in its data, whatever the tool thinks of it.

λ = ‖(I − P_J)·(y_with − y_without)/σ‖ of the channels without noise: what a fit of the bench as its
family has it leaves of the hidden effect, in sigmas. The columns of J are the slopes of what the bench
shows by the values that a model of it fits, by the moment at which commands act, and by the level of the
optional input in each record where that is not in the file. All of it comes from the bench's own
generator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.validation.benches.bench import BenchCampaign, Floats, Nudge, SmallBench, Trace

#: change of a value for its slope: far above the integrator's error, small enough to be a slope
_SHARE = 1e-3


def size_of(campaign: BenchCampaign) -> float:
    """λ of what the campaign hides; 0 where it hides nothing."""
    bench = campaign.bench
    plain = replace(campaign, amplitude=0.0, noise="none")
    traces, drawn = plain.drawn()
    base = _stacked(bench, traces)
    difference = _stacked(bench, replace(campaign, noise="none").drawn()[0]) - base
    nudges = [Nudge(part=part, share=_SHARE) for part in range(drawn)]
    if bench.time_constant:
        nudges.append(Nudge(late=_SHARE * plain.period))
    columns = [_stacked(bench, plain.drawn(nudge)[0]) - base for nudge in nudges]
    if not campaign.recorded:
        moved = _stacked(bench, plain.drawn(Nudge(optional=_SHARE * bench.spread))[0]) - base
        columns += _by_record(moved, [trace.time.size * len(bench.noise) for trace in traces])
    return float(np.linalg.norm(_rest(difference, columns)))


def _stacked(bench: SmallBench, traces: Sequence[Trace]) -> Floats:
    """Every reading over its noise, record after record."""
    return np.concatenate(
        [trace.columns[name] / sigma for trace in traces for name, sigma in bench.noise.items()]
    )


def _by_record(moved: Floats, sizes: Sequence[int]) -> list[Floats]:
    """A column for each record, zero in all others."""
    ends = np.cumsum(sizes)
    found = []
    for end, count in zip(ends, sizes, strict=True):
        column = np.zeros_like(moved)
        column[end - count : end] = moved[end - count : end]
        found.append(column)
    return found


def _rest(difference: Floats, columns: Sequence[Floats]) -> Floats:
    """What no combination of the columns makes up for."""
    scaled = [column / np.linalg.norm(column) for column in columns if np.linalg.norm(column) > 0.0]
    if not scaled:
        return difference
    basis = np.column_stack(scaled)
    return np.asarray(difference - basis @ np.linalg.lstsq(basis, difference, rcond=1e-10)[0])
