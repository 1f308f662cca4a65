"""The size λ of a bench's hidden effect in its data, computed independently of the tool.

λ = ‖(I − P_J)·(y_with − y_without)/σ‖ of the noise-free channels, in sigmas: what remains of the hidden
effect after a fit of the bench as its family describes it. The columns of J are the derivatives of the
readings with respect to the values that a model of it fits, to the delay of the commands and, if the optional
input is not in the file, to its level in each record. All are computed with the bench's own generator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl_validation.benches.bench import BenchCampaign, Floats, Nudge, SmallBench, Trace

#: relative change for a finite difference: far above the integrator's error, but small
_SHARE = 1e-3


def size_of(campaign: BenchCampaign) -> float:
    """λ of the campaign's hidden effect; 0 if it has none."""
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
    """All readings divided by their noise, record after record."""
    return np.concatenate(
        [trace.columns[name] / sigma for trace in traces for name, sigma in bench.noise.items()]
    )


def _by_record(moved: Floats, sizes: Sequence[int]) -> list[Floats]:
    """The derivative with respect to each record's own level: one column per record."""
    ends = np.cumsum(sizes)
    columns = []
    for end, count in zip(ends, sizes, strict=True):
        column = np.zeros_like(moved)
        column[end - count : end] = moved[end - count : end]
        columns.append(column)
    return columns


def _rest(difference: Floats, columns: Sequence[Floats]) -> Floats:
    """The residual of the difference after least squares on the columns."""
    scaled = [column / np.linalg.norm(column) for column in columns if np.linalg.norm(column) > 0.0]
    if not scaled:
        return difference
    basis = np.column_stack(scaled)
    return np.asarray(difference - basis @ np.linalg.lstsq(basis, difference, rcond=1e-10)[0])
