"""The noise of every channel from the records themselves, or else from the rig file.

In: records of one campaign, as readings with times, without any model. Out: a `NoiseModel`. Everything that
is decided later is in units of this noise, so that it must not contain what a model lacks: only what no
motion of the bench can be counts, windows that show noise alone, differences between replicates, and
differences of rising order. How much of it counts is decided with a model
(`rigctl.model.measured.standing`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.channel_noise import ChannelData, learn_noise
from rigctl.noise.converter import find_step, stretch_bias
from rigctl.noise.floor import LEAST_ORDERS, Floor, even_pieces, white_floor
from rigctl.noise.noise_model import ChannelNoise, NoiseModel, Source
from rigctl.noise.pooling import Pooled
from rigctl.noise.record import NoiseRecord, rows_of
from rigctl.noise.spikes import find_spikes_on_scales
from rigctl.noise.statements import channel_statement, model_statement
from rigctl.noise.variance import smooth_course, variance_law

#: a sigma below this share of the values' magnitude is rounding, not noise
_ROUNDING = 1e-12
#: noise with a higher correlation than this in the quietest stretches may be a signal
_SLOW = 0.975
#: higher orders of the trend inside a window, tried if a lower one leaves what may be a signal
_HIGHER_ORDERS = (4, 6)
#: differences across switches hold more than noise if those within periods are less than this share of them
_LESS = 0.8
#: sigma assumed if nothing is known, as a share of the values' magnitude
_ASSUMED = 0.01


def estimate_noise(
    records: Sequence[NoiseRecord],
    names: Sequence[str],
    *,
    known: Mapping[str, float] | None = None,
    spikes: Sequence[NDArray[np.bool_]] | None = None,
) -> NoiseModel:
    """The noise of every channel.

    Of each channel two things are estimated. Its white *floor*, from differences of rising order, which holds
    whatever the bench does (`rigctl.noise.floor`). And the whole noise with its slow part, as far as the
    records show it: from stretches that show noise alone (under a quadratic trend), combined with differences
    between replicates if the records move too much, by restricted maximum likelihood (`pool`); else the floor
    alone; the number in the rig file; a guess. No model of the bench is used: whether a quiet stretch was at
    rest is decided later, with a model (`rigctl.model.measured.standing`).

    Parameters
    ----------
    records: of one campaign; those with equal `condition` are replicates.
    names: of the channels, in the order of the columns of `values`.
    known: sigma (SI) from the rig file, used if the data do not determine it.
    spikes: for each record, (n, channels), the samples to leave out; determined here by default.

    Returns
    -------
    the noise of all channels; `guessed` marks those that the data do not determine.

    Raises
    ------
    ValueError
        no records, or records whose channels are not those named.
    """
    if not records or any(record.values.shape[1] != len(names) for record in records):
        raise ValueError(f"need records with {len(names)} channels each")
    # Spikes first: a single one would widen σ of its window, and its differences.
    masks = list(spikes) if spikes is not None else spikes_of(records)
    ok = [np.isfinite(record.values) & ~mask for record, mask in zip(records, masks, strict=True)]
    spacing = usual_spacing(records)
    channels = tuple(
        _channel_noise(
            records, ok, i, name, spacing, (known or {}).get(name), sum(int(m[:, i].sum()) for m in masks)
        )
        for i, name in enumerate(names)
    )
    return NoiseModel(channels, spacing, model_statement(channels))


def spikes_of(records: Sequence[NoiseRecord]) -> list[NDArray[np.bool_]]:
    """The spikes of every record, (n, channels), relative to the local noise if that varies.

    If the noise is larger during motion, much of it would be mistaken for spikes on the scale of the noise at
    rest.
    """
    masks, nearby = find_spikes_on_scales(records, (False, True))
    if not records:
        return masks
    ok = [np.isfinite(record.values) & ~mask for record, mask in zip(records, nearby, strict=True)]
    spacing = usual_spacing(records)
    for channel in range(records[0].values.shape[1]):
        if sum(int(mask[:, channel].sum()) for mask in masks) == sum(
            int(m[:, channel].sum()) for m in nearby
        ):
            continue
        step = find_step(
            [record.values[good[:, channel], channel] for record, good in zip(records, ok, strict=True)]
        )
        if variance_law(records, ok, channel, spacing, step=step) is not None:
            for mask, other in zip(masks, nearby, strict=True):
                mask[:, channel] = other[:, channel]
    return masks


def usual_spacing(records: Sequence[NoiseRecord]) -> float:
    """Median time between neighbouring samples, s; 1 when no record has two."""
    gaps = np.concatenate([np.diff(record.times) for record in records])
    return float(np.median(gaps)) if gaps.size else 1.0


def _channel_noise(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    name: str,
    spacing: float,
    known: float | None,
    masked: int,
) -> ChannelNoise:
    # A channel of another device than most rows is estimated in its own rows; its correlation is converted
    # back to the common spacing at the end.
    between_rows = spacing
    records, ok, spacing = rows_of(records, ok, channel, spacing)
    values = [record.values[good[:, channel], channel] for record, good in zip(records, ok, strict=True)]
    step = find_step(values)
    size = max((float(np.max(np.abs(each))) for each in values if each.size), default=0.0)
    # The white floor always, from differences; the whole noise where windows show it; else what is left: the
    # floor, the rig file's number, a guess.
    floor = floor_of(records, ok, channel, spacing, coarse=bool(step))
    if floor is not None and floor.sigma <= max(_ROUNDING * size, step / float(np.sqrt(12.0))):
        floor = replace(floor, sigma=step / float(np.sqrt(12.0))) if step else None
    pooled = _learnt(ChannelData(records, ok, channel, spacing, step))
    if pooled is not None and pooled.fit.sigma > _ROUNDING * size:
        source: Source = "replicates" if pooled.replicates > pooled.quiet else "quiet"
        fit = pooled.fit
        sigma, bias = _with_steps(fit.sigma, step)
        noise = ChannelNoise(
            name,
            sigma,
            fit.correlation,
            step,
            source,
            guessed=_may_be_signal(pooled),
            masked=masked,
            white=fit.white,
            bias=bias,
            degrees=fit.degrees,
        )
    else:
        noise = _without_windows(floor, name, step, known, masked, size)
    # A law of level and rate on top, and σ then that of a typical reading.
    noise = _with_law(noise, records, ok, channel, spacing)
    if floor is not None:
        noise = replace(noise, floor=floor.sigma, plateau=floor.measured)
    if spacing != between_rows:
        noise = replace(noise, correlation=noise.correlation ** (between_rows / spacing))
    return noise.stated(channel_statement(noise, known))


def _learnt(data: ChannelData) -> Pooled | None:
    """The noise from windows under the lowest order of trend that leaves nothing as slow as a signal.

    A signal that turns within a window is not fitted by a parabola, and the rest is slow. A trend of higher
    order fits it, and removes too little of slow noise to hide that: the likelihood accounts for the trend
    (REML). If every order leaves something slow, it may be noise, and the lowest order is kept.
    """
    pooled = learn_noise(data)
    if pooled is None or not _may_be_signal(pooled):
        return pooled
    for order in _HIGHER_ORDERS:
        candidate = learn_noise(replace(data, order=order))
        if candidate is not None and not _may_be_signal(candidate) and candidate.fit.sigma < pooled.fit.sigma:
            return candidate
    return pooled


def _may_be_signal(pooled: Pooled) -> bool:
    """Whether the quiet stretches mostly show something so slow that it could be a signal."""
    return pooled.replicates <= pooled.quiet and pooled.fit.correlation > _SLOW and pooled.fit.white < 0.5


def _with_law(
    noise: ChannelNoise,
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
) -> ChannelNoise:
    """With the dependence of the noise on level and rate, if the data show one."""
    if noise.guessed:
        return noise
    law = variance_law(
        records,
        ok,
        channel,
        spacing,
        correlation=noise.correlation,
        white=noise.white,
        step=noise.step,
    )
    if law is None:
        return noise
    each = [
        law.sigma(*smooth_course(record.times, np.where(good[:, channel], record.values[:, channel], np.nan)))
        for record, good in zip(records, ok, strict=True)
        if good[:, channel].any()
    ]
    typical = float(np.sqrt(np.mean(np.concatenate(each) ** 2)))
    degrees = min(noise.degrees, law.degrees) if noise.degrees else law.degrees
    return replace(noise, sigma=typical, law=law, degrees=degrees)


def _with_steps(sigma: float, step: float) -> tuple[float, float]:
    """Sigma, at least the converter's own error, and the part of it that quiet stretches have in common."""
    before = float(np.sqrt(max(0.0, sigma**2 - step**2 / 12.0)))
    return float(np.hypot(before, step / np.sqrt(12.0))) if step else sigma, stretch_bias(step, before)


def floor_of(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
    *,
    coarse: bool = False,
) -> Floor | None:
    """The white floor of one channel over all records; None if there are too few readings.

    A difference across a switch holds what the bench answers to it. Where commands change every few samples,
    that is nearly every difference, and the answers look as white as noise: they are left out. Where the
    periods between switches are too short for a plateau, differences across switches are taken, unless those
    within periods are clearly smaller.
    """
    within = white_floor(list(_pieces(records, ok, channel, spacing, cut=True)), coarse=coarse)
    if within is not None and within.measured:
        return within
    across = white_floor(list(_pieces(records, ok, channel, spacing, cut=False)), coarse=coarse)
    if within is None or len(within.orders) < LEAST_ORDERS or across is None:
        return across
    return within if within.sigma < _LESS * across.sigma else across


def _pieces(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
    *,
    cut: bool,
) -> Iterator[NDArray[np.float64]]:
    """Stretches without a gap, and if `cut` without a switch."""
    for record, good in zip(records, ok, strict=True):
        values = np.where(good[:, channel], record.values[:, channel], np.nan)
        yield from even_pieces(record.times, values, spacing, record.phase if cut else None)


def _without_windows(
    floor: Floor | None, name: str, step: float, known: float | None, masked: int, size: float
) -> ChannelNoise:
    if floor is not None:
        sigma, bias = _with_steps(floor.sigma, step)
        return ChannelNoise(
            name, sigma, 0.0, step, "floor", guessed=False, masked=masked, bias=bias, degrees=floor.degrees
        )
    least = step / float(np.sqrt(12.0))
    if known is not None:
        return ChannelNoise(name, max(known, least), 0.0, step, "rig", guessed=True, masked=masked)
    guess = least or _ASSUMED * size or 1.0
    return ChannelNoise(name, guess, 0.0, step, "assumed", guessed=True, masked=masked)
