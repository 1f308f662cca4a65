"""What the measurements say of their own noise, without any model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.kept import kept
from rigctl.model.measured.record import Measurements
from rigctl.model.measured.table import column, curve_variable, curves, set_variable
from rigctl.noise import (
    ChannelNoise,
    NoiseModel,
    NoiseRecord,
    RowNoise,
    channel_statement,
    estimate_noise,
    find_edges,
    find_spikes_in_records,
    model_statement,
    recounted,
    row_noise,
    spikes_of,
)
from rigctl.units import show

#: an input that changes by more than this share of its range has been switched; one that is written down
#: sample by sample changes by less
_LEAST_JUMP = 0.1
#: a channel with one spike in so many readings has a habit of them; normal noise has one in 150 000
_SPIKY = 1000
#: noise with a correlation above this may be a signal
_SLOW = 0.9
#: a model whose error is less than this share of the noise shows that the noise is not what it was taken for
_BELOW = 0.9


@dataclass(frozen=True)
class DataNoise:
    """The noise of some measurements, and which of their values count.

    Attributes
    ----------
    model: of all channels.
    ok: (n, outputs) of each record: read, no spike, and on no edge that the sampling does not resolve.
    masked, edges: (records, outputs) how many samples are spikes, and lie on such edges; None where that was
        not looked for.
    """

    model: NoiseModel
    ok: tuple[NDArray[np.bool_], ...]
    masked: NDArray[np.intp] | None = None
    edges: NDArray[np.intp] | None = None

    def only(self, places: Sequence[int]) -> DataNoise:
        """Of these records alone: the noise as learned from all, what was left out counted in these."""
        chosen = list(places)
        masked, edges = (None if one is None else one[chosen] for one in (self.masked, self.edges))
        model = recounted(
            self.model,
            [channel.masked for channel in self.model.channels] if masked is None else _sums(masked),
            [channel.edges for channel in self.model.channels] if edges is None else _sums(edges),
        )
        return DataNoise(model, tuple(self.ok[place] for place in chosen), masked, edges)


def noise_of(measurements: Measurements) -> DataNoise:
    """Estimate the noise of `measurements`; spikes are masked and counted, never dropped silently."""
    records = [replace(record, run="", index=0, label="") for record in measurements.records]
    names = (measurements.outputs, measurements.units, measurements.inputs)
    by_rig = (_known(measurements), set_variable(measurements))
    return kept("noise", (names, records, by_rig), DataNoise, lambda: _noise_of(measurements))


def _noise_of(measurements: Measurements) -> DataNoise:
    if measurements.table:
        return _of_rows(measurements)
    records = [
        NoiseRecord(
            record.times,
            np.where(record.here, record.values, np.nan),
            record.group,
            record.phase.astype(np.intp),
        )
        for record in measurements.records
    ]
    spikes = spikes_of(records)
    ok = tuple(record.here & ~mask for record, mask in zip(measurements.records, spikes, strict=True))
    noise = estimate_noise(records, measurements.outputs, known=_known(measurements), spikes=spikes)
    masked = np.array([mask.sum(axis=0) for mask in spikes], dtype=np.intp)
    return without_edges(DataNoise(noise, ok, masked), measurements)


def without_edges(noise: DataNoise, measurements: Measurements) -> DataNoise:
    """Leave out the samples on edges that the sampling does not resolve, and count them."""
    least = _LEAST_JUMP * _spans(measurements)
    found = []
    for record, good in zip(measurements.records, noise.ok, strict=True):
        jumps = 1 + np.flatnonzero((np.abs(np.diff(record.inputs, axis=0)) > least).any(axis=1))
        values = np.where(good, record.values, np.nan)
        sigma = noise.model.sigma_at(values, record.times)
        edges = find_edges(record.times, values, sigma, record.switch_times[jumps], record.switch_half[jumps])
        found.append(good & edges)
    counts = np.array([mask.sum(axis=0) for mask in found], dtype=np.intp)
    model = recounted(noise.model, [channel.masked for channel in noise.model.channels], _sums(counts))
    ok = tuple(good & ~mask for good, mask in zip(noise.ok, found, strict=True))
    return replace(noise, model=model, ok=ok, edges=counts)


def with_spikes_off_model(
    noise: DataNoise, measurements: Measurements, errors: Sequence[NDArray[np.float64]]
) -> DataNoise | None:
    """Leave out the spikes that show once what a model explains is taken off; None where there are none.

    In motion a spike is hidden by the signal, and noise with heavy tails counts there many times over. Only
    channels are looked at that have spikes by their own word, one reading in `_SPIKY`: what a model lacks for
    a few samples is no spike. What most records share at the same place is the bench's as well.

    Parameters
    ----------
    errors: (n, outputs) of each record, model less reading in standard deviations of the noise; NaN where no
        reading counts.
    """
    readings = sum(record.here.sum(axis=0) for record in measurements.records)
    known = np.array([channel.masked for channel in noise.model.channels])
    spiky = (known > 0) & (known * _SPIKY >= readings)
    if measurements.table or not spiky.any():
        return None
    records = [
        NoiseRecord(record.times, np.where(good, error, np.nan), record.group, record.phase.astype(np.intp))
        for record, good, error in zip(measurements.records, noise.ok, errors, strict=True)
    ]
    spikes = [mask & spiky for mask in find_spikes_in_records(records)]
    counts = np.array([mask.sum(axis=0) for mask in spikes], dtype=np.intp)
    if not counts.any():
        return None
    edges = [channel.edges for channel in noise.model.channels]
    model = recounted(noise.model, [int(count) for count in known + counts.sum(axis=0)], edges)
    ok = tuple(good & ~mask for good, mask in zip(noise.ok, spikes, strict=True))
    return replace(noise, model=model, ok=ok, masked=None if noise.masked is None else noise.masked + counts)


def with_motion_off(
    noise: DataNoise, measurements: Measurements, residuals: Sequence[NDArray[np.float64]]
) -> DataNoise | None:
    """With noise learned from what a model leaves, of channels whose motion passed for noise; None if none.

    Stretches that never rest, or move slowly, show noise that is too wide: a model's error is then smaller
    than it, and nothing can be told. Within windows of 40 samples a model's residuals are noise and a smooth
    rest, which their trend takes out, so that an effect that is missing does not widen what is learned. Only
    a guess, or noise that is mostly as slow as a signal, is replaced, and only by a narrower one.

    Parameters
    ----------
    residuals: (n, outputs) of each record, model less reading, SI; NaN where no reading counts.
    """
    if measurements.table:
        return None
    channels = noise.model.channels
    errors = [np.concatenate([one[:, c] for one in residuals]) for c in range(len(channels))]
    doubtful = [
        channel.source == "quiet"  # what the data do not show at all, a model's residuals do not either
        and (channel.guessed or channel.correlation > _SLOW)
        and not (channel.step or channel.law or channel.share)
        and bool(np.isfinite(error).any())
        and float(np.sqrt(np.nanmean(error**2))) < _BELOW * channel.sigma
        for channel, error in zip(channels, errors, strict=True)
    ]
    if not any(doubtful):
        return None
    records = [
        NoiseRecord(record.times, error, record.group, record.phase.astype(np.intp))
        for record, error in zip(measurements.records, residuals, strict=True)
    ]
    spikes = [np.zeros(error.shape, bool) for error in residuals]
    learned = estimate_noise(records, measurements.outputs, spikes=spikes).channels
    replaced = [
        _of_residuals(old, new) if doubt and not new.guessed and new.sigma < _BELOW * old.sigma else old
        for doubt, old, new in zip(doubtful, channels, learned, strict=True)
    ]
    if all(new is old for new, old in zip(replaced, channels, strict=True)):
        return None
    model = replace(noise.model, channels=tuple(replaced), statement=model_statement(replaced))
    return replace(noise, model=model)


def _of_residuals(old: ChannelNoise, new: ChannelNoise) -> ChannelNoise:
    found = replace(new, source="residuals", masked=old.masked, edges=old.edges, law=None)
    return found.stated(channel_statement(found, None))


def _spans(measurements: Measurements) -> NDArray[np.float64]:
    """(inputs) how far each input goes over all records."""
    rows = np.concatenate([record.inputs for record in measurements.records])
    return np.asarray(np.ptp(rows, axis=0))


def _sums(counts: NDArray[np.intp]) -> list[int]:
    """(records, outputs) to a number for each output."""
    return [int(count) for count in counts.sum(axis=0)]


def _known(measurements: Measurements) -> dict[str, float]:
    rig = measurements.rig
    if rig is None:
        return {}
    channels = {name: rig.channels[name] for name in measurements.outputs if name in rig.channels}
    return {name: float(channel.noise) for name, channel in channels.items() if channel.noise}


def _of_rows(measurements: Measurements) -> DataNoise:
    """Of a table: from its neighbouring rows, or where they are too few, from the rig file or a guess."""
    setting = set_variable(measurements)
    points, series = curves(measurements, but=setting)
    over = curve_variable(measurements, but=setting) or "row"
    known = _known(measurements)
    channels = []
    for place, (name, unit) in enumerate(zip(measurements.outputs, measurements.units, strict=True)):
        values = column(measurements, place)
        size = _typical(values)
        found = row_noise(points, values, series)
        channels.append(
            _guessed(name, size, unit, known.get(name))
            if found is None
            else _from_rows(name, size, unit, found, over)
        )
    statement = "Noise of " + "; ".join(channel.statement for channel in channels)
    ok = tuple(record.here for record in measurements.records)
    return DataNoise(NoiseModel(tuple(channels), 1.0, statement), ok)


def _from_rows(name: str, size: float, unit: str, found: RowNoise, over: str) -> ChannelNoise:
    sigma = found.sigma * size if found.relative else found.sigma
    wide = f"{100 * found.sigma:.2g} % of the value" if found.relative else _interval(sigma, unit)
    sure = 100.0 / np.sqrt(2.0 * found.degrees)
    return ChannelNoise(
        name,
        sigma,
        source="replicates" if 2 * found.repeats > found.differences else "differences",
        guessed=False,
        statement=f"{name}: {wide}, from {found.differences} differences between neighbouring values over "
        f"{over}, without any model; itself known to about {sure:.0f} %",
        degrees=found.degrees,
        share=found.sigma if found.relative else 0.0,
    )


#: of a table without any word of its accuracy: half a per cent of what was read
_SHARE = 0.005


def _typical(values: NDArray[np.float64]) -> float:
    """The size of a typical value; where most of them are 0, the largest, and 1 where all are."""
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max(initial=0.0))
    return (float(np.median(sizes)) or largest) if largest else 1.0


def _guessed(name: str, size: float, unit: str, known: float | None) -> ChannelNoise:
    sigma = max(_SHARE * size, known or 0.0)
    from_rig = known is not None and known >= sigma
    why = "what the rig file says" if from_rig else f"{100 * _SHARE:g} % of a typical value"
    return ChannelNoise(
        name,
        sigma,
        source="rig" if from_rig else "assumed",
        guessed=True,
        statement=f"{name}: only guessed, {_interval(sigma, unit)} ({why}): too few rows to read it from",
    )


def _interval(sigma: float, unit: str) -> str:
    return show(sigma, unit, difference=True, digits=2)
