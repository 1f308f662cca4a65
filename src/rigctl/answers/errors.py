"""The errors of models in words: the systematic error, its change, and the error on records held out.

In: falls of the systematic error by channel (`rigctl.answers.findings.systematic_error`), fits. Out:
clauses, "" where there is nothing to say. An error is stated in the unit of its channel only beyond the
noise: below it, the root mean square is that of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.findings.systematic_error import ChannelFall
from rigctl.answers.numbers import plural
from rigctl.model.fit.fit import FitResult
from rigctl.noise import Source, Standing
from rigctl.units import significant
from rigctl.wording import chance_text

#: relative change of an error from which it counts as changed
_CHANGED = 0.02


def fit_text(model: ModelComparison) -> str:
    """Error, noise and fit (R²) of every channel; "" for a table, whose values are listed."""
    return "" if model.rows else "; ".join(in_brief(model))


def noise_known_from(channel: Mapping[str, Any]) -> str:
    """From what the noise of a channel of `ModelComparison.channels` is known; the number is its white part
    where the rig file states more."""
    if channel["noise_source"] == "floor" and channel["noise_stated"]:
        return f"its white part; the rig file states {significant(channel['noise_stated'], 2)}"
    if channel["noise_standing"] == "floor" and not channel["noise_plateau"]:
        return "its white part at most"
    standing: Standing = channel["noise_standing"]
    return _KNOWN_FROM[channel["noise_source"] if standing == "measured" else standing]


_KNOWN_FROM: dict[Source | Standing, str] = {
    "replicates": "replicates",
    "quiet": "quiet stretches",
    "residuals": "residuals in windows",
    "differences": "neighbouring readings",
    "stated": "the rig file",
    "floor": "its white part alone",
    "guess": "a guess",
    "assumed": "a guess",
}


def pattern_of(model: ModelComparison) -> str:
    """The test that rejects a model most clearly, with its probability; "" if none does."""
    if model.adequacy.verdict is not False or not model.adequacy.tests:
        return ""
    name, test = min(model.adequacy.tests.items(), key=lambda one: one[1].p_value)
    return f"test '{name}', {chance_text(test.p_value)}"


def error_text(channel_falls: Sequence[ChannelFall], pattern: str = "") -> str:
    """The systematic error of each channel; for two models, of those where it changed.

    Parameters
    ----------
    pattern: what rejects the only model, whether or not its error is larger than the noise; see `pattern_of`.
    """
    if not channel_falls:
        return ""
    guessed = [one.channel for one in channel_falls if one.guessed]
    note = f"; the noise of {', '.join(guessed)} is only guessed" if guessed else ""
    # For two models the change is what matters, and it is known better than either error: its X does not
    # depend on the noise assumed. Hence three groups of channels: those whose floor alone is known, those
    # beyond the noise, and those within it that changed all the same.
    if len(channel_falls[0].sizes) > 1:
        changed = [one for one in channel_falls if one.changed]
        if not changed:
            return f"unchanged in every channel: {_state(channel_falls, -1)}{note}"
        hidden = [one.channel for one in changed if one.hidden_fall]
        sizes = [
            f"{one.channel} from {_size(one, 0)} to {_size(one, -1)}"
            for one in changed
            if not one.hidden_fall and not one.own
        ]
        parts = [_own_fall(one) for one in changed if one.own]
        parts += [f"beyond the noise, {'; '.join(sizes)}"] if sizes else []
        parts += [f"within the noise before and after, smaller now, {', '.join(hidden)}"] if hidden else []
        return f"{'; '.join(parts)}{note}"
    if pattern and all(one.within(0) for one in channel_falls):
        return f"no larger than the noise on any channel, but not random ({pattern}){note}"
    return f"{_state(channel_falls, 0)}{note}"


def _state(channel_falls: Sequence[ChannelFall], index: int) -> str:
    own = [one for one in channel_falls if one.own and not one.within(index)]
    beyond = [one for one in channel_falls if not one.own and not one.within(index)]
    within = [one.channel for one in channel_falls if one.within(index)]
    if not beyond and not own:
        return (
            "within the noise on every channel" if len(channel_falls) > 1 else f"{within[0]} within its noise"
        )
    parts = [f"{one.channel} {one.beside_noise(index)}" for one in own]
    sizes = "; ".join(f"{one.channel} {_size(one, index)}" for one in beyond)
    parts += [f"beyond the noise, {sizes}"] if sizes else []
    parts += [f"{', '.join(within)} within {'its' if len(within) == 1 else 'their'} noise"] if within else []
    return "; ".join(parts)


def _own_fall(one: ChannelFall) -> str:
    """``thermocouple from 0.118 V to 0.092 V, 4.2 times its white noise of 0.022 V``."""
    if one.within(-1):
        return f"{one.channel} from {one.amount(0)} to {one.sigmas(-1)} of {one.noise_text}"
    start = one.amount(0) or f"within the noise of {one.noise_text}"
    return f"{one.channel} from {start} to {one.beside_noise(-1)}"


def _size(one: ChannelFall, index: int) -> str:
    return one.sigmas(index) if one.within(index) else one.amount(index)


def held_out_text(fits: Sequence[FitResult]) -> str:
    """The error on records that no fit saw, in units of the noise; for two models, where it changed."""
    first, last = fits[0].heldout_errors, fits[-1].heldout_errors
    parts = []
    for name, error in first.items():
        after = last[name].nrmse
        if len(fits) == 1:
            parts.append(f"{name} {significant(error.nrmse, 3)}")
        elif abs(error.nrmse - after) > _CHANGED * error.nrmse:
            parts.append(f"{name} {significant(error.nrmse, 3)} to {significant(after, 3)}")
    if not parts:
        return ""
    records = plural(len(fits[0].held_out), "record")
    return f"error/noise on {records} that no fit saw: {', '.join(parts)}"


def in_brief(model: ModelComparison) -> list[str]:
    """One line for each channel: its error, the noise, and the share of its variance explained (R²)."""
    return [_channel_in_brief(name, one) for name, one in model.channels().items()]


def _channel_in_brief(name: str, one: Mapping[str, Any]) -> str:
    """``speed: error 0.45 rad/s, white noise 0.024 rad/s, fit 93.1 % (R²)``."""
    share = one["noise_share"]
    white = one["noise_source"] == "floor"
    what = "white noise" if white else "guessed noise" if one["noise_standing"] == "guess" else "noise"
    bound = "at most " if white and not one["noise_plateau"] else ""
    noise = f"{significant(100.0 * share, 2)} %" if share else f"{significant(one['noise'], 2)} {one['unit']}"
    text = f"{name}: error {significant(one['rmse'], 3)} {one['unit']}, {what} {bound}{noise}"
    if one["noise_stated"]:
        text += f", stated {significant(one['noise_stated'], 2)} {one['unit']}"
    return text if one["r2"] is None else f"{text}, fit {_per_cent(one['r2'])} (R²)"


def _per_cent(share: float) -> str:
    """A share of a variance: ``67 %``, with more digits close to 100 %, where they matter."""
    # R² = 0.9993 would be 100 %: as many decimals as the rest needs for one digit.
    rest = 100.0 * (1.0 - share)
    digits = min(6, max(0, -math.floor(math.log10(rest)))) if 0.0 < rest < 1.0 else 0
    return f"{100.0 * share:.{digits}f} %"
