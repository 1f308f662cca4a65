"""The noise of the measurements, estimated without any model; and what a fitted model shows of it.

In: `Measurements`. Out: `DataNoise`, the noise of each channel and which readings count. Before any fit it is
learned from the readings alone (`noise_of`), since a missing effect would otherwise pass for noise. A fitted
model removes most of the motion: spikes (`with_spikes_off_model`) and the level dependence of the noise
(`with_noise_off_model`) then show that it had hidden. Only differences of residuals count, in which a missing
effect is smooth (decision 48). `standing` decides which of it may be believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.result_cache import cached
from rigctl.model.measured.clocks import clock_reach, clocks_of, far_from_ends
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.measured.table import column, curve_variable, curves, set_variable
from rigctl.noise import (
    ChannelNoise,
    ModelResiduals,
    NoiseModel,
    NoiseRecord,
    RowNoise,
    VarianceLaw,
    channel_statement,
    estimate_noise,
    find_edges,
    find_spikes_in_records,
    model_statement,
    recounted,
    row_noise,
    spikes_of,
    width_off_model,
)
from rigctl.rig.stated_noise import StatedNoise
from rigctl.units import show

#: an input that changes by more than this share of its range has been switched; one that is recorded sample
#: by sample changes by less
_LEAST_JUMP = 0.1
#: least rate of spikes, one in this many readings, that is typical of a channel; normal noise has one in 150
#: 000
_SPIKY = 1000
#: noise with a correlation above this may be a signal
_SLOW = 0.9
#: a model with an error below this share of the noise shows that the noise was overestimated
_BELOW = 0.9
#: sources whose estimate motion, or an effect that the model lacks, may have inflated
_OF_STRETCHES = ("quiet", "residuals")
#: noise with heavy tails exceeds that of its windows by at most this factor; smaller factors are not reported
_MORE, _MOST_BY_TAILS = 1.01, 1.3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DataNoise:
    """The noise of some measurements, and which of their values count.

    Attributes
    ----------
    model: of all channels.
    ok: (n, outputs) of each record: read, not a spike, and not on an edge that the sampling does not resolve.
    masked, edges: (records, outputs) number of samples that are spikes, and that lie on such edges; None if
        not determined.
    grown: (n, outputs) of each record, SI, the standard deviation of each reading by a law learned from a
        model's residuals, at that model's levels; None if the readings themselves suffice.
    """

    model: NoiseModel
    ok: tuple[NDArray[np.bool_], ...]
    masked: NDArray[np.intp] | None = None
    edges: NDArray[np.intp] | None = None
    grown: tuple[NDArray[np.float64], ...] | None = None

    def only(self, indices: Sequence[int]) -> DataNoise:
        """For these records alone: the noise as learned from all, with the samples left out in these."""
        chosen = list(indices)
        masked, edges = (None if one is None else one[chosen] for one in (self.masked, self.edges))
        model = recounted(
            self.model,
            [channel.masked for channel in self.model.channels] if masked is None else _sums(masked),
            [channel.edges for channel in self.model.channels] if edges is None else _sums(edges),
        )
        grown = None if self.grown is None else tuple(self.grown[index] for index in chosen)
        return DataNoise(model, tuple(self.ok[index] for index in chosen), masked, edges, grown)


def noise_of(measurements: Measurements) -> DataNoise:
    """Estimate the noise of `measurements`; spikes are masked and counted, never dropped silently."""
    # estimated once for the same samples, whatever their runs are called; readings near an end, which a clock
    # may have moved, are taken away after it
    records = [replace(record, run="", index=0, label="") for record in measurements.records]
    names = (measurements.outputs, measurements.units, measurements.inputs)
    reach = [clock_reach(measurements, record) for record in measurements.records]
    by_rig = (_known(measurements), set_variable(measurements), reach)
    noise = cached("noise", (names, records, by_rig), DataNoise, lambda: _noise_of(measurements))
    if not clocks_of(measurements):
        return noise
    inside = far_from_ends(measurements)
    return replace(noise, ok=tuple(good & mask for good, mask in zip(noise.ok, inside, strict=True)))


def _noise_of(measurements: Measurements) -> DataNoise:
    if measurements.table:
        return _of_rows(measurements)
    # spikes before the estimate, as one of them is as much as hundreds of readings in a sum of squares; edges
    # after it, as they are recognised by jumps far above the noise
    records = noise_records(measurements)
    spikes = spikes_of(records)
    ok = tuple(record.here & ~mask for record, mask in zip(measurements.records, spikes, strict=True))
    noise = estimate_noise(records, measurements.outputs, known=_known(measurements), spikes=spikes)
    masked = np.array([mask.sum(axis=0) for mask in spikes], dtype=np.intp)
    return without_edges(DataNoise(noise, ok, masked), measurements)


def noise_records(measurements: Measurements) -> list[NoiseRecord]:
    """The readings of every record as the noise is estimated from them."""
    return [
        NoiseRecord(
            record.times,
            np.where(record.here, record.values, np.nan),
            record.group,
            record.phase.astype(np.intp),
        )
        for record in measurements.records
    ]


def without_edges(noise: DataNoise, measurements: Measurements) -> DataNoise:
    """Leave out the samples on edges that the sampling does not resolve, and count them."""
    least = _LEAST_JUMP * _spans(measurements)
    masks = []
    for record, good in zip(measurements.records, noise.ok, strict=True):
        # only beside switches, as wide as their times are unknown: by the logger, by the actuator, by the
        # clock
        jumps = 1 + np.flatnonzero((np.abs(np.diff(record.inputs, axis=0)) > least).any(axis=1))
        values = np.where(good, record.values, np.nan)
        sigma = noise.model.sigma_at(values, record.times)
        half = record.switch_half[jumps] + 2.0 * record.jitter[jumps] + clock_reach(measurements, record)
        edges = find_edges(record.times, values, sigma, record.switch_times[jumps], half)
        masks.append(good & edges)
    counts = np.array([mask.sum(axis=0) for mask in masks], dtype=np.intp)
    model = recounted(noise.model, [channel.masked for channel in noise.model.channels], _sums(counts))
    ok = tuple(good & ~mask for good, mask in zip(noise.ok, masks, strict=True))
    return replace(noise, model=model, ok=ok, edges=counts)


def with_spikes_off_model(
    noise: DataNoise, measurements: Measurements, errors: Sequence[NDArray[np.float64]]
) -> DataNoise | None:
    """Leave out the spikes visible in a model's residuals; None if there are none.

    During motion a spike is hidden by the signal, and noise with heavy tails counts many times there. Only
    channels with a typical rate of spikes, one reading in `_SPIKY`, are examined: a misfit of the model over
    a few samples is not a spike. Deviations that most records share at the same point belong to the bench as
    well.

    Parameters
    ----------
    errors: (n, outputs) of each record, model less reading in standard deviations of the noise; NaN where no
        reading counts.
    """
    if measurements.table:
        return None
    spiky = _spiky(noise, measurements)
    if not spiky.any():
        return None
    known = np.array([channel.masked for channel in noise.model.channels])
    records = [
        NoiseRecord(record.times, np.where(good, error, np.nan), record.group, record.phase.astype(np.intp))
        for record, good, error in zip(measurements.records, noise.ok, errors, strict=True)
    ]
    spikes = [mask & spiky for mask in find_spikes_in_records(records, off_model=True)]
    counts = np.array([mask.sum(axis=0) for mask in spikes], dtype=np.intp)
    if not counts.any():
        return None
    edges = [channel.edges for channel in noise.model.channels]
    model = recounted(noise.model, [int(count) for count in known + counts.sum(axis=0)], edges)
    ok = tuple(good & ~mask for good, mask in zip(noise.ok, spikes, strict=True))
    return replace(noise, model=model, ok=ok, masked=None if noise.masked is None else noise.masked + counts)


def with_noise_off_model(
    noise: DataNoise, measurements: Measurements, outputs: Sequence[Floats]
) -> DataNoise | None:
    """With noise learned from a model's residuals, for channels where these tell more; None if for none.

    - *Motion mistaken for noise.* Periods that never come to rest, or move slowly, give noise estimates that
      are too large: a model's error is then below them, and nothing can be decided. Within windows of 40
      samples a model's residuals are noise and a smooth rest, which a trend removes, so that a missing effect
      does not inflate the estimate. Only a guess, or noise that is mostly as slow as a signal, is replaced,
      and only by a smaller one.
    - *Level dependence hidden by motion.* Where signals are fast, their readings do not show how the noise
      depends on the level; squared differences of a model's residuals do (`rigctl.noise.width_off_model`).
    - *Heavy tails.* If one reading in `_SPIKY` is a spike, the windows that agree with each other are the
      quieter ones. Differences of the residuals are not selected that way.

    Parameters
    ----------
    outputs: (n, outputs) of each record, SI, predicted by the model.
    """
    if measurements.table:
        return None
    records = measurements.records
    residuals = [
        ModelResiduals(
            np.where(good, predicted - record.values, np.nan), predicted, record.phase.astype(np.intp)
        )
        for record, good, predicted in zip(records, noise.ok, outputs, strict=True)
    ]
    previous = noise.grown or [
        noise.model.sigma_at(np.where(good, record.values, np.nan), record.times)
        for record, good in zip(records, noise.ok, strict=True)
    ]
    spiky = _spiky(noise, measurements)
    improved = []
    for index, channel in enumerate(noise.model.channels):
        # first whether motion was taken for noise, then whether what remains grows with the level, and only
        # if it does not, whether its tails were missed; each in the width of the one before
        one = _OneChannel(channel, index, records, residuals, [sigma[:, index] for sigma in previous])
        one = one.narrower() or one
        improved.append(one.growing() or (one.wider() if spiky[index] else None) or one)
    channels = [one.channel for one in improved]
    if all(new is old for new, old in zip(channels, noise.model.channels, strict=True)):
        return None
    model = replace(noise.model, channels=tuple(channels), statement=model_statement(channels))
    grown = tuple(np.stack([one.sigma[k] for one in improved], axis=1) for k in range(len(records)))
    return replace(noise, model=model, grown=grown if any(one.law for one in channels) else None)


@dataclass(frozen=True)
class _OneChannel:
    """A channel, a model's residuals of it, and (n) σ of its readings, SI, for each record."""

    channel: ChannelNoise
    index: int
    records: Sequence[MeasuredRecord]
    residuals: Sequence[ModelResiduals]
    sigma: Sequence[Floats]

    def narrower(self) -> _OneChannel | None:
        """With the noise from short windows, if motion of the readings was mistaken for noise."""
        old = self.channel
        doubtful = old.guessed or old.correlation > _SLOW
        # noise that the data do not show at all is not shown by a model's residuals either
        if (
            old.source not in _OF_STRETCHES
            or not doubtful
            or old.step
            or old.share
            or not self._error_below(_BELOW)
        ):
            return None
        width = width_off_model(self.residuals, self.index)
        shape = self.sigma if old.law else [np.ones(one.size) for one in self.sigma]
        if width is not None and width.law is not None:
            shape = self._by_law(width.law)
        # residuals divided by the shape of the noise: one number then describes it at all levels
        typical = self._typical(shape)
        shape = [one / typical for one in shape]
        records = [
            NoiseRecord(
                record.times,
                (one.errors[:, self.index] / wide)[:, None],
                record.group,
                record.phase.astype(np.intp),
            )
            for record, one, wide in zip(self.records, self.residuals, shape, strict=True)
        ]
        spikes = [np.zeros(record.values.shape, bool) for record in records]
        (new,) = estimate_noise(records, [old.name], spikes=spikes).channels
        if new.guessed or not new.sigma < _BELOW * old.sigma:
            return None
        law = old.law if width is None or width.law is None else width.law
        scaled = None if law is None else law.scaled(new.sigma / typical)
        channel = replace(new, source="residuals", masked=old.masked, edges=old.edges, law=scaled)
        return self._with(channel, [new.sigma * one for one in shape])

    def growing(self) -> _OneChannel | None:
        """With a law of the level that is more likely than the previous noise."""
        old = self.channel
        if old.share or not old.degrees:
            return None
        known = self.sigma if old.law else None
        width = width_off_model(
            self.residuals,
            self.index,
            correlation=old.correlation,
            white=old.white,
            step=old.step,
            known=known,
        )
        if width is None or width.law is None:
            return None
        sigma = self._by_law(width.law)
        channel = replace(
            old, sigma=self._typical(sigma), law=width.law, degrees=width.degrees, source="residuals"
        )
        return self._with(channel, sigma)

    def wider(self) -> _OneChannel | None:
        """With the standard deviation from differences, including tails, if windows showed a smaller one."""
        old = self.channel
        if old.share or old.law or old.step or not old.degrees:
            return None
        width = width_off_model(self.residuals, self.index, correlation=old.correlation, white=old.white)
        if width is None or not _MORE * old.sigma < width.sigma < _MOST_BY_TAILS * old.sigma:
            return None
        channel = replace(old, sigma=width.sigma, degrees=width.degrees, source="residuals")
        return self._with(channel, [np.full(one.size, width.sigma) for one in self.sigma])

    def _with(self, channel: ChannelNoise, sigma: Sequence[Floats]) -> _OneChannel:
        return replace(self, channel=channel.stated(channel_statement(channel, None)), sigma=sigma)

    def _error_below(self, share: float) -> bool:
        error = np.concatenate(
            [one.errors[:, self.index] / sigma for one, sigma in zip(self.residuals, self.sigma, strict=True)]
        )
        return bool(np.isfinite(error).any()) and float(np.sqrt(np.nanmean(error**2))) < share

    def _by_law(self, law: VarianceLaw) -> list[Floats]:
        return [law.sigma(one.levels[:, self.index], np.zeros(1)) for one in self.residuals]

    def _typical(self, sigma: Sequence[Floats]) -> float:
        """The root of the mean square over the readings that count."""
        good = [np.isfinite(one.errors[:, self.index]) for one in self.residuals]
        each = np.concatenate([one[mask] for one, mask in zip(sigma, good, strict=True)])
        return float(np.sqrt(np.mean(each**2)))


def _spiky(noise: DataNoise, measurements: Measurements) -> NDArray[np.bool_]:
    """(outputs) which channels have a typical rate of spikes, one reading in `_SPIKY`."""
    readings = sum(record.here.sum(axis=0) for record in measurements.records)
    masked = np.array([channel.masked for channel in noise.model.channels])
    return np.asarray((masked > 0) & (masked * _SPIKY >= readings))


def _spans(measurements: Measurements) -> NDArray[np.float64]:
    """(inputs) the range of each input over all records."""
    rows = np.concatenate([record.inputs for record in measurements.records])
    return np.asarray(np.ptp(rows, axis=0))


def _sums(counts: NDArray[np.intp]) -> list[int]:
    """(records, outputs) to a number for each output."""
    return [int(count) for count in counts.sum(axis=0)]


def stated_noise(measurements: Measurements) -> dict[str, StatedNoise | float]:
    """What the rig file states of the outputs' noise: its parts, or the deviation of one reading, SI."""
    rig = measurements.rig
    if rig is None:
        return {}
    channels = {name: rig.channels[name] for name in measurements.outputs if name in rig.channels}
    return {
        name: channel.noise if isinstance(channel.noise, StatedNoise) else channel.noise_level
        for name, channel in channels.items()
        if channel.noise_level
    }


def _known(measurements: Measurements) -> dict[str, float]:
    return {
        name: one.total if isinstance(one, StatedNoise) else one
        for name, one in stated_noise(measurements).items()
    }


def _of_rows(measurements: Measurements) -> DataNoise:
    """For a table: from neighbouring rows, or if there are too few, from the rig file or a guess."""
    # neighbouring rows at one setting differ by noise and by what the other conditions change, which is
    # smooth; a setting made by hand shifts all of its rows alike, and is no noise of a reading
    setting = set_variable(measurements)
    points, series = curves(measurements, but=setting)
    over = curve_variable(measurements, but=setting) or "row"
    known = _known(measurements)
    channels = []
    for index, (name, unit) in enumerate(zip(measurements.outputs, measurements.units, strict=True)):
        values = column(measurements, index)
        size = _typical(values)
        noise = row_noise(points, values, series)
        channels.append(
            _guessed(name, size, unit, known.get(name))
            if noise is None
            else _from_rows(name, size, unit, noise, over)
        )
    statement = "Noise of " + "; ".join(channel.statement for channel in channels)
    ok = tuple(record.here for record in measurements.records)
    return DataNoise(NoiseModel(tuple(channels), 1.0, statement), ok)


def _from_rows(name: str, size: float, unit: str, noise: RowNoise, over: str) -> ChannelNoise:
    sigma = noise.sigma * size if noise.relative else noise.sigma
    wide = f"{100 * noise.sigma:.2g} % of the value" if noise.relative else _interval(sigma, unit)
    sure = 100.0 / np.sqrt(2.0 * noise.degrees)
    return ChannelNoise(
        name,
        sigma,
        source="replicates" if 2 * noise.repeats > noise.differences else "differences",
        guessed=False,
        statement=f"{name}: {wide}, from {noise.differences} differences between neighbouring values over "
        f"{over}, without any model; itself known to about {sure:.0f} %",
        degrees=noise.degrees,
        share=noise.sigma if noise.relative else 0.0,
    )


#: assumed for a table without stated accuracy: half a per cent of the reading
_SHARE = 0.005


def _typical(values: NDArray[np.float64]) -> float:
    """A typical magnitude; if most values are 0, the largest, and 1 if all are."""
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
