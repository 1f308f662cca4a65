"""Statements about the noise, in plain sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigctl.noise.noise_model import ChannelNoise, NoiseModel
from rigctl.units import significant
from rigctl.wording import number_of

_FROM = {
    "replicates": "differences between replicates and quiet stretches",
    "quiet": "quiet stretches of the records",
    "residuals": "the model's residuals within short windows",
    "differences": "differences between neighbouring readings, which cannot show correlation",
    "floor": "differences of rising order, which show its white part alone",
    "rig": "the rig file: the data do not determine it",
    "assumed": "nothing but a guess: neither the data nor the rig file determines it",
}


def channel_statement(noise: ChannelNoise, known: float | None) -> str:
    """One sentence: source of sigma, correlation, converter, spikes, and the value in the rig file."""
    parts = [f"sigma from {_FROM[noise.source]}"]
    if noise.correlation >= 0.05:
        rest = f", {noise.white:.0%} of the variance white" if noise.white else ""
        parts.append(f"neighbouring samples correlated by {noise.correlation:.2f}{rest}")
    if noise.law is not None:
        parts.append(_growth(noise))
    if noise.guessed and noise.source == "quiet":
        parts.append("a guess: even the quietest stretches move as slowly as a signal does")
    if noise.step > 0.5 * noise.sigma:
        parts.append(f"converter steps of {noise.step / noise.sigma:.1f} sigma")
    if noise.allowed:
        parts.append(f"errors {_allowed(noise)}")
    if noise.remark:
        parts.append(noise.remark)
    if noise.masked:
        parts.append(_spikes(noise.masked))
    if known is not None and not noise.guessed and not 1 / 3 < noise.sigma / known < 3:
        times = noise.sigma / known
        parts.append(
            f"the rig file says {times:.1f} times less"
            if times > 1
            else f"the rig file says {1 / times:.1f} times more"
        )
    return f"{noise.name}: " + "; ".join(parts)


def model_statement(channels: Sequence[ChannelNoise]) -> str:
    """One sentence for all channels: the sources of the numbers, and which of them are guesses."""
    learned = [channel for channel in channels if not channel.guessed]
    parts = []
    for source in dict.fromkeys(channel.source for channel in learned):
        which = ", ".join(channel.name for channel in learned if channel.source == source)
        parts.append(f"{which} from {_FROM[source]}")
    guessed = [channel for channel in channels if channel.guessed]
    if guessed:
        which = ", ".join(channel.name for channel in guessed)
        why = " and ".join(dict.fromkeys(_FROM[channel.source] for channel in guessed))
        parts.append(f"only guessed for {which}, from {why}")
    parts += [f"that of {channel.name} {_growth(channel)}" for channel in channels if channel.law is not None]
    parts += [f"errors of {channel.name} {_allowed(channel)}" for channel in channels if channel.allowed]
    parts += [f"of {channel.name} {channel.remark}" for channel in channels if channel.remark]
    masked = sum(channel.masked for channel in channels)
    if masked:
        parts.append(_spikes(masked))
    return "Noise: " + "; ".join(parts)


def _allowed(noise: ChannelNoise) -> str:
    """Up to which size errors count as noise by the rig file; in floors, since units are unknown here."""
    size = (
        f"{significant(noise.allowed / noise.floor, 2)} times its white noise" if noise.floor else "its noise"
    )
    slowly = f" if they change over {significant(noise.over, 2)} s or so" if noise.over else ""
    return f"up to {size} count as noise{slowly}, as the rig file states"


def _growth(noise: ChannelNoise) -> str:
    """What the noise depends on, and its ratio to that at rest."""
    law = noise.law
    if law is None:
        return ""
    end = "lowest" if law.origin > 0.0 else "highest"  # in words: units are unknown here
    of = f"its distance from the {end} level" if law.origin else "it"
    size = f"{100.0 * law.level:.2g} % of {of}" if law.level else ""
    if law.shot:
        size = f"{size} and the root of that" if size else f"the root of {of}"
    terms = [
        *([f"the level (by {size})"] if size else []),
        *([f"the rate of change (by {law.rate:.2g} s of it)"] if law.rate else []),
    ]
    return f"grows with {' and '.join(terms)}: typically {noise.sigma / law.floor:.1f} times that at rest"


def recounted(noise: NoiseModel, masked: Sequence[int], edges: Sequence[int]) -> NoiseModel:
    """This noise for some of the records from which it was estimated: the numbers of samples of each
    channel that are spikes, or lie on edges, in these.
    """
    channels = tuple(
        replace(
            channel,
            masked=spikes,
            edges=left_out,
            statement=_recount(channel.statement, channel.masked, spikes),
        )
        for channel, spikes, left_out in zip(noise.channels, masked, edges, strict=True)
    )
    before = sum(channel.masked for channel in noise.channels)
    return replace(noise, channels=channels, statement=_recount(noise.statement, before, sum(masked)))


def _spikes(count: int) -> str:
    return f"{number_of(count, 'spike')} masked"


def _recount(statement: str, before: int, after: int) -> str:
    return statement.replace(f"; {_spikes(before)}", f"; {_spikes(after)}" if after else "")
