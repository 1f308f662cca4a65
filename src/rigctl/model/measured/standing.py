"""What is known of each channel's noise once a model has been fitted: decided here and nowhere else.

A bench that never rests shows only a part of its noise, and three facts have different standings:

1. The white *floor* is always measurable, as long as there are some dozens of readings
   (`rigctl.noise.floor`). It is a lower bound of the noise.
2. A slow part (drift, 1/f, correlation) counts only where something independent of the model's error shows
   it: stretches in which nothing moves, replicates, or a statement in the rig file. Windows in which it
   moves do not: the motion that a trend leaves in them looks like slow noise, and a noise that holds the
   signal agrees with any model.
3. Any model with few parameters that leaves an error is an upper bound: an assumed noise larger than what is
   left is refuted.

The order is therefore: what rest or replicates show; what the user states; the floor alone. Where only the
floor is known, what a model leaves is its own scale (`with_what_is_left`): differences between models are
then judged in units of what the better one leaves, with as many independent readings as that has correlation
times. It needs no noise level, and claims none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.model.measured.noise import DataNoise, noise_records, stated_noise
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import (
    ChannelNoise,
    NoiseRecord,
    channel_statement,
    correlation_time,
    even_pieces,
    model_statement,
    portmanteau,
)
from rigctl.noise.channel_noise import ChannelData, learn_noise
from rigctl.noise.pooling import Pooled, pool
from rigctl.noise.record import rows_of
from rigctl.noise.windows import LENGTH, TREND_ORDER, contrasts, cut_windows, window_pieces
from rigctl.rig.stated_noise import StatedNoise
from rigctl.units import show, significant

Floats = NDArray[np.float64]

#: ratio of the noise of quiet windows to the floor beyond which it may be the signal
_DOUBTFUL = 3.0
#: a noise counts as shown if the independent estimate is at least this share of it
_SHOWN = 0.8
#: a stated number larger than the noise at rest by a factor up to this may include slower noise
_MOST_SLOW = 10.0
#: a model's prediction at rest departs from a trend by less than this share of the floor
_STILL = 0.3
#: an input at rest departs from a trend by less than this share of its range
_STEADY = 0.05
#: share of a channel's variance that a model must explain before its predictions say where the bench rests
_FOLLOWS = 0.5
#: windows whose neighbouring readings are correlated by less hold no signal
_WHITE = 0.1
#: least length of a rest that shows slow noise, as a share of its record
_LONG_REST = 0.1
#: a channel that varies by less than this many times its floor rests all the time
_MOVES = 3.0
#: a window in which a channel varies by less than this share of its overall deviation is at rest in any case
_FLAT = 0.03
#: a stated noise is contradicted by a floor larger by this factor, ...
_ABOVE = 1.4
#: ... and by a model whose error is less than this share of it
_BELOW = 0.5
#: a statement off by more than this factor is a wrong unit
_UNUSABLE = 100.0
#: largest share of the independent readings that counts as spent on unknowns
_MOST_SPENT = 0.6
#: residuals count as white if the portmanteau test does not reject at this level
WHITE = 0.01


def with_standing(
    noise: DataNoise, measurements: Measurements, outputs: Sequence[Floats]
) -> DataNoise | None:
    """The noise as far as it is known beside a model's predictions; None if nothing changes.

    Parameters
    ----------
    outputs: (n, outputs) of each record, SI, predicted by the model.
    """
    if measurements.table:
        return None
    stated = stated_noise(measurements)
    evidence = _Evidence(noise, measurements, outputs)
    channels = [
        evidence.standing(index, channel, stated.get(channel.name))
        for index, channel in enumerate(noise.model.channels)
    ]
    return _with_channels(noise, channels)


def without_doubtful_slow_noise(noise: DataNoise) -> DataNoise | None:
    """The noise for a first fit: the floor, where windows show much more, which may be the signal; else None.

    With the correlation of a slow signal a fit follows differences of neighbouring readings alone, and may
    end anywhere.
    """
    channels = [
        _floor_only(channel)
        if channel.source == "quiet" and channel.floor and channel.sigma > _DOUBTFUL * channel.floor
        else channel
        for channel in noise.model.channels
    ]
    return _with_channels(noise, channels)


def white_noise(noise: DataNoise, names: Sequence[str]) -> DataNoise:
    """These channels with the same standard deviation, and no correlation: the weights of least squares."""
    channels = [
        replace(channel, correlation=0.0, white=0.0) if channel.name in names else channel
        for channel in noise.model.channels
    ]
    return _with_channels(noise, channels) or noise


def floor_alone(noise: DataNoise, names: Sequence[str], because: str) -> DataNoise | None:
    """With the floor alone for these channels, whose assumed noise was refuted; None if nothing changes."""
    channels = [
        _floor_only(channel, because) if channel.name in names else channel
        for channel in noise.model.channels
    ]
    return _with_channels(noise, channels)


def at_floor(noise: DataNoise) -> DataNoise:
    """The noise as it is before any model is fitted: the floor, or what the rig file states, is the scale."""
    channels = [
        replace(channel, sigma=channel.allowed or channel.floor, together=1.0)
        if channel.own_scale
        else channel
        for channel in noise.model.channels
    ]
    return replace(noise, model=replace(noise.model, channels=tuple(channels)))


def with_what_is_left(
    noise: DataNoise,
    measurements: Measurements,
    outputs: Sequence[Floats],
    fitted: Sequence[int],
    *,
    unknowns: int = 0,
    independent: bool = False,
) -> DataNoise | None:
    """With what a model leaves as the scale of the channels of which only the floor is known.

    ``sigma² = τ·Σe²/(n − p·τ)``, τ the correlation time of the residuals e, p the number of unknowns that
    were fitted: n readings are worth n/τ, of which p are spent. A difference of χ² between two models is then
    ``(Σe₁²/Σe₂² − 1)·(n/τ − p)`` in units of the better one. None if nothing changes by more than a tenth of
    a per cent. With `independent` every reading counts, τ = 1.

    Parameters
    ----------
    unknowns: p.
    """
    channels = []
    for index, channel in enumerate(noise.model.channels):
        if not channel.own_scale:
            channels.append(channel)
            continue
        pieces = residual_pieces(noise, measurements, outputs, index, fitted)
        if not pieces:
            channels.append(channel)
            continue
        # n readings are worth n/τ, of which p are spent on unknowns; a fit with nearly as many unknowns would
        # otherwise leave an infinite scale
        rms = float(np.sqrt(np.mean(np.concatenate(pieces) ** 2)))
        together = 1.0 if independent or portmanteau(pieces) > WHITE else correlation_time(pieces)
        count = sum(piece.size for piece in pieces) / together
        spent = 1.0 - min(unknowns / count, _MOST_SPENT)
        sigma = rms * math.sqrt(together / spent) or channel.sigma
        channels.append(replace(channel, sigma=sigma, together=together))
    return _with_channels(noise, channels)


def residual_pieces(
    noise: DataNoise,
    measurements: Measurements,
    outputs: Sequence[Floats],
    channel: int,
    chosen: Sequence[int],
) -> list[Floats]:
    """A model's errors (SI) of one channel in evenly sampled pieces of the records `chosen`."""
    return [
        piece
        for k in chosen
        for piece in even_pieces(
            measurements.records[k].times,
            np.where(
                noise.ok[k][:, channel],
                outputs[k][:, channel] - measurements.records[k].values[:, channel],
                np.nan,
            ),
            noise.model.spacing,
        )
    ]


def _per_row(pooled: Pooled, share: float) -> Pooled:
    """The noise with its correlation over this share of the time between the readings of its channel."""
    return replace(pooled, fit=replace(pooled.fit, correlation=pooled.fit.correlation**share))


def _with_channels(noise: DataNoise, channels: Sequence[ChannelNoise]) -> DataNoise | None:
    if all(_same(new, old) for new, old in zip(channels, noise.model.channels, strict=True)):
        return None
    model = replace(noise.model, channels=tuple(channels), statement=model_statement(channels))
    grown = noise.grown if any(channel.law for channel in channels) else None
    return replace(noise, model=model, grown=grown)


def _same(new: ChannelNoise, old: ChannelNoise) -> bool:
    if abs(new.sigma / old.sigma - 1.0) > 1e-3:
        return False
    return new is old or replace(new, sigma=old.sigma, together=old.together) == old


def _floor_only(old: ChannelNoise, remark: str = "") -> ChannelNoise:
    """The noise of which only the white floor is known; unchanged without one."""
    if not old.floor:
        return old
    new = ChannelNoise(
        old.name,
        old.floor,
        step=old.step,
        source="floor",
        guessed=False,
        masked=old.masked,
        edges=old.edges,
        floor=old.floor,
        plateau=old.plateau,
        remark=remark,
    )
    return new.stated(channel_statement(new, None))


class _Evidence:
    """What shows the noise of each channel independently of a model's error.

    Parameters
    ----------
    noise: as estimated without a model.
    outputs: (n, outputs) of each record, predicted by the model.
    """

    def __init__(self, noise: DataNoise, measurements: Measurements, outputs: Sequence[Floats]) -> None:
        self.noise, self.measurements, self.outputs = noise, measurements, outputs
        self.records: list[NoiseRecord] = noise_records(measurements)
        self.steady = _steady_windows(measurements)

    def standing(self, index: int, channel: ChannelNoise, stated: StatedNoise | float | None) -> ChannelNoise:
        """One channel's noise by the best of what is known of it."""
        # 1. decided after an earlier fit
        if channel.allowed or channel.remark or channel.source == "differences":  # already decided
            return channel
        # 2. a bench that is at rest in every record has no motion to be told from noise
        if channel.own_scale and self._at_rest_throughout(index, channel):
            new = replace(channel, source="differences")
            return new.stated(channel_statement(new, None))
        # 3. what rest or replicates show; a stated number beside it only where it may hold slower noise
        shown = self._shown(index, channel)
        if stated is not None and (shown is None or _slower_than_rest(stated, shown)):
            by_statement = self._stated(index, channel, stated)
            if shown is None or by_statement.allowed:
                return by_statement
        if shown is not None:
            unit = self.measurements.units[index]
            return shown if stated is None else _beside(shown, _total(stated), unit)
        # 4. nothing independent shows more than the floor
        return channel if channel.own_scale else _floor_only(channel)

    def _shown(self, index: int, channel: ChannelNoise) -> ChannelNoise | None:
        """The noise that rest or replicates show; None if neither does."""
        found = [one for one in (self._at_rest(index, channel), self._between(index, channel)) if one]
        if not found or channel.source == "floor":
            return None
        # the first estimate, from the quietest windows, is confirmed
        if any(one.fit.sigma >= _SHOWN * channel.sigma for one in found):
            return replace(channel, guessed=False)
        # it was larger than rest or replicates show, so that it held motion: theirs, by the one with more
        # readings behind it, and at least the rounding of a converter, uniform over a step
        best = max(found, key=lambda one: one.fit.degrees)
        if not best.fit.sigma > 0.0:
            return None
        new = replace(
            channel,
            sigma=max(best.fit.sigma, channel.step / math.sqrt(12.0)),
            correlation=best.fit.correlation,
            white=best.fit.white,
            degrees=best.fit.degrees,
            source="replicates" if best.replicates > best.quiet else "quiet",
            guessed=False,
            law=None,
        )
        return new.stated(channel_statement(new, None))

    def _at_rest_throughout(self, index: int, channel: ChannelNoise) -> bool:
        """Whether nothing moves within any record: a few readings at each of many operating points.

        They are too few for windows; and what differs between them is all the noise that there is.
        """
        for record, good in zip(self.measurements.records, self.noise.ok, strict=True):
            values = record.values[good[:, index], index]
            if values.size > LENGTH or (record.along and not _constant_inputs(record)):
                return False
            if values.size and float(np.std(values)) > _MOVES * channel.floor:
                return False
        return True

    def _at_rest(self, index: int, channel: ChannelNoise) -> Pooled | None:
        """The noise of the windows in which nothing moves."""
        # windows that show white noise hold no signal, whatever the model says of them
        white = channel.correlation * (1.0 - channel.white) < _WHITE
        # windows in which inputs and model rest; one run of them has to be as long as slow noise takes to
        # show
        masks = [self._rest(k, index, channel.floor, white=white) for k in range(len(self.records))]
        long = [max(LENGTH, _LONG_REST * mask.shape[0]) for mask in masks]
        if not any(_longest(mask[:, index]) >= least for mask, least in zip(masks, long, strict=True)):
            return None  # too short a rest to show anything as slow as the record
        used = [mask & good for mask, good in zip(masks, self.noise.ok, strict=True)]
        between_rows = self.noise.model.spacing
        # a channel that most rows lack is learned on its own rows, and its correlation converted to that over
        # one row of the records
        records, used_rows, spacing = rows_of(self.records, used, index, between_rows)
        pooled = learn_noise(ChannelData(records, used_rows, index, spacing, channel.step))
        return pooled and _per_row(pooled, between_rows / spacing)

    def _between(self, index: int, channel: ChannelNoise) -> Pooled | None:
        """The noise of the differences between replicates."""
        between_rows = self.noise.model.spacing
        records, ok, spacing = rows_of(self.records, self.noise.ok, index, between_rows)
        groups, cells = cut_windows(records, ok, index, spacing)
        pooled = pool(contrasts(groups), [], len(cells))
        return pooled and _per_row(pooled, between_rows / spacing)

    def _rest(self, k: int, index: int, floor: float, *, white: bool) -> NDArray[np.bool_]:
        """(n, outputs) the samples of a record in windows in which nothing moves, spikes included."""
        record, predicted = self.measurements.records[k], self.outputs[k][:, index]
        good = self.noise.ok[k]
        values = np.where(good[:, index], record.values[:, index], np.nan)
        follows, spread = self._follows(index)
        mask = np.zeros(good.shape, bool)
        # its inputs rest in this window. Either its readings do too, or the model says that it rests: the
        # readings cannot say so where the noise is large
        for first, last in self.steady[k]:
            window = values[first:last]
            if not np.isfinite(window).any():
                continue
            flat = white or float(np.nanstd(window)) <= _FLAT * spread or spread <= _MOVES * floor
            still = follows and _off_trend(predicted[first:last]) <= _STILL * floor
            if flat or still:
                mask[first:last, index] = True
        return mask

    def _follows(self, index: int) -> tuple[bool, float]:
        """Whether the model explains a channel well enough to say where it rests; its standard deviation."""
        good = [ok[:, index] for ok in self.noise.ok]
        pairs = list(zip(self.measurements.records, self.outputs, good, strict=True))
        values = np.concatenate([record.values[ok, index] for record, _, ok in pairs])
        errors = np.concatenate([out[ok, index] - record.values[ok, index] for record, out, ok in pairs])
        if not values.size:
            return False, 0.0
        spread = float(np.std(values))
        return float(np.mean(errors**2)) <= (1.0 - _FOLLOWS) * spread**2, spread

    def _stated(self, index: int, channel: ChannelNoise, stated: StatedNoise | float) -> ChannelNoise:
        """The floor, and the noise that the rig file states, unless the data contradict it."""
        # a statement is contradicted from above by what a model leaves, and from below by the floor
        pieces = residual_pieces(self.noise, self.measurements, self.outputs, index, range(len(self.records)))
        total = _total(stated)
        over = stated.over or 0.0 if isinstance(stated, StatedNoise) else 0.0
        white = total if not isinstance(stated, StatedNoise) else float(stated.white or total)
        left = float(np.sqrt(np.mean(np.concatenate(pieces) ** 2))) if pieces else math.inf
        remark, factor = "", 1.0
        if left < _BELOW * total:
            factor = total / left if left else math.inf
            remark = (
                f"the rig file states {self._shown_as(index, total)}, {_times(factor)} the "
                f"{self._shown_as(index, left)} that the model leaves, which contradicts it"
            )
        elif channel.plateau and channel.floor > _ABOVE * white:
            factor = channel.floor / white if white else math.inf
            remark = (
                f"its white noise of {self._shown_as(index, channel.floor)} alone is {_times(factor)} the "
                f"{self._shown_as(index, white)} that the rig file states"
            )
        new = _floor_only(channel, remark)
        if not new.own_scale:  # nothing is measured: the statement is all that is known, as it was taken
            return channel
        if remark:
            return replace(new, unusable=factor > _UNUSABLE)
        new = replace(new, allowed=total, over=over)
        return new.stated(channel_statement(new, None))

    def _shown_as(self, index: int, size: float) -> str:
        """A size (SI) in the unit of a channel."""
        return show(size, self.measurements.units[index], difference=True, digits=2)


def _total(stated: StatedNoise | float) -> float:
    """SI, the standard deviation of one reading by a statement."""
    return stated.total if isinstance(stated, StatedNoise) else stated


def _slower_than_rest(stated: StatedNoise | float, shown: ChannelNoise) -> bool:
    """Whether a statement may hold noise that changes too slowly for windows at rest to show it."""
    if isinstance(stated, StatedNoise) and stated.slow is not None:
        return True
    return 1.0 < _SHOWN * _total(stated) / shown.sigma < _MOST_SLOW


def _beside(shown: ChannelNoise, total: float, unit: str) -> ChannelNoise:
    """A noise that the data show, beside a stated one: with neither, if the two are as far apart as units."""
    factor = max(shown.sigma / total, total / shown.sigma)
    if factor <= _UNUSABLE:
        return shown
    more = "more" if total > shown.sigma else "less"
    numbers = [show(one, unit, difference=True, digits=2) for one in (total, shown.sigma)]
    remark = (
        f"the rig file states {numbers[0]}, {_times(factor)} {more} than the {numbers[1]} that the "
        "readings at rest show"
    )
    new = replace(shown, remark=remark, unusable=True)
    return new.stated(channel_statement(new, None))


def _times(factor: float) -> str:
    return f"{significant(factor, 2)} times"


def _steady_windows(measurements: Measurements) -> list[list[tuple[int, int]]]:
    """Of each record, (first, one past the last) of the windows in which all inputs are at rest."""
    spans = _course_spans(measurements)
    windows = []
    for record in measurements.records:
        courses = [(record.input_course(index), spans[index]) for index in record.along]
        windows.append(
            [
                (first, last)
                for first, last in window_pieces(record.phase.astype(np.intp))
                if all(_constant(course[first:last], _STEADY * span) for course, span in courses)
                and _no_switch(record, first, last)
            ]
        )
    return windows


def _no_switch(record: MeasuredRecord, first: int, last: int) -> bool:
    """Whether no command changes inside a window: a record without a switch is divided otherwise."""
    begin, end = record.times[first], record.times[last - 1]
    inside = (record.switch_times > begin) & (record.switch_times < end)
    return not any(
        not np.array_equal(record.inputs[k], record.inputs[k - 1]) for k in np.flatnonzero(inside) if k
    )


def _course_spans(measurements: Measurements) -> dict[int, float]:
    """The range of each input that changes continuously, over all records."""
    courses: dict[int, list[Floats]] = {}
    for record in measurements.records:
        for index in record.along:
            courses.setdefault(index, []).append(record.input_course(index))
    return {index: float(np.ptp(np.concatenate(each))) for index, each in courses.items()}


def _constant_inputs(record: MeasuredRecord) -> bool:
    """Whether the inputs that may change continuously hardly do in a record."""
    return all(
        float(np.ptp(course)) <= _STEADY * max(float(np.max(np.abs(course))), 1e-300)
        for course in map(record.input_course, record.along)
    )


def _longest(mask: NDArray[np.bool_]) -> int:
    """The length of the longest run of True values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _constant(course: Floats, most: float) -> bool:
    """Whether a measured input neither moves along its trend nor departs from it by more than `most`, SI.

    Its noise is not motion, so that the range of the trend counts, and the mean square about it.
    """
    trend, departures = _divided(course)
    return float(np.ptp(trend)) <= most and _rms(departures) <= most


def _off_trend(values: Floats) -> float:
    """Root mean square of values about the polynomial that a window's trend is."""
    return _rms(_divided(values)[1])


def _divided(values: Floats) -> tuple[Floats, Floats]:
    """A window's trend, a polynomial, and the departures from it; both 0 if too few readings are there."""
    good = np.isfinite(values)
    if good.sum() <= TREND_ORDER + 1:
        return np.zeros(1), np.zeros(1)
    # orthogonal over the readings that are there, not over the window
    x = np.linspace(-1.0, 1.0, values.size)[good]
    basis = np.linalg.qr(np.polynomial.legendre.legvander(x, TREND_ORDER))[0]
    trend = basis @ (basis.T @ values[good])
    return trend, values[good] - trend


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
