"""The result of a comparison, for a reader who has a minute; every other answer has the same form.

One title, one plain sentence, and the next questions: how large, how certain, how the error changed, what is
left. The page and the terminal show the same; the evidence follows in technical terms.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rigctl.analysis.adequacy import chance_text
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.slot_evidence import SlotEvidence
from rigctl.model.fit.fit import FitResult
from rigctl.noise import Source, Standing
from rigctl.report.numbers import plural
from rigctl.report.systematic import ChannelFall, falls, left_of
from rigctl.units import significant

Tone = Literal["good", "warn", "bad", "open"]

#: format of `chance_text`
_CHANCE = re.compile(r" \(p [<=] [0-9.e+-]+\)")
#: relative change of an error from which it counts as changed
_CHANGED = 0.02


@dataclass(frozen=True)
class Answer:
    """The answer, without its evidence.

    Attributes
    ----------
    tone: good if nothing is wrong, warn if something is missing, bad if the model fails, open if these data
        cannot tell.
    title: the verdict in a few words.
    sentence: the verdict in a plain sentence, without a full stop.
    facts: headings and texts, the most important first.
    first: sentences that come before the verdict: what has to be known to trust it.
    """

    tone: Tone
    title: str
    sentence: str
    facts: tuple[tuple[str, str], ...]
    first: tuple[str, ...] = ()


def comparison_answer(model: ModelComparison) -> Answer:
    """How well one model agrees, and where it fails most."""
    facts = [("fit", fit_text(model))]
    if not model.adequacy.undecided:  # where the noise is not known, no error is within it or beyond
        facts.append(("error", error_text(falls([model.fit], [left_of(model)]), pattern_of(model))))
    verdict = model.adequacy.verdict
    if verdict is False:
        facts += [("mostly at", _most(model)), ("lacks", "" if model.bounded else _wanted(model))]
    facts.append(("held out", held_out_text([model.fit])))
    facts.append(("decided by", "; or ".join(model.decided_by)))
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: "open"}
    titles = {True: "Agrees", False: "Does not agree", None: "Cannot tell"}
    return Answer(tones[verdict], titles[verdict], model.statement, nonempty(facts), model.first)


def fit_text(model: ModelComparison) -> str:
    """Error, noise and fit (R²) of every channel; "" for a table, whose values are listed."""
    return "" if model.rows else "; ".join(model.in_brief)


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


def models_answer(models: Sequence[ModelComparison]) -> Answer:
    """The answer for the last of several models, with the change of the error since the first."""
    last = comparison_answer(models[-1])
    if len(models) == 1:
        return last
    fits = [model.fit for model in models]
    lefts = [left_of(model) for model in models]
    facts = [("error", error_text(falls(fits, lefts))), ("held out", held_out_text(fits))]
    facts += [(head, text) for head, text in last.facts if head not in ("error", "held out")]
    facts.sort(key=lambda fact: fact[0] != "fit")
    return replace(last, facts=nonempty(facts))


def plain_statement(model: ModelComparison) -> str:
    """A comparison's statement without its p-value."""
    return without_chance(model.statement)


def without_chance(text: str) -> str:
    """A sentence without its ``(p = 0.53)``."""
    return _CHANCE.sub("", text)


def nonempty(facts: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """The facts that are not empty."""
    return tuple((head, text) for head, text in facts if text)


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


def _most(model: ModelComparison) -> str:
    """The worst condition, if it is not due to chance."""
    from rigctl.analysis.decision_levels import ALPHA

    worst = [one for one in model.where if one.by == "condition" and one.p_value < ALPHA][:2]
    return "; ".join(f"{one.label} ({100 * one.share_of_error:.0f} % of it)" for one in worst)


def _wanted(model: ModelComparison) -> str:
    """The equations that most probably lack a term."""
    from rigctl.analysis.decision_levels import SLOT_SEPARABLE

    known = [one for one in model.slots if one.log_evidence > SLOT_SEPARABLE]
    if not known or (model.rows and len(known[0].alike) > 1):
        return ""
    near = [one for one in known if one.slot in known[0].alike][:2]
    return f"a term: {'; or '.join(_place(one) for one in (known[0], *near))}"


def _place(slot: SlotEvidence) -> str:
    """Where a term is missing, in words, and its name where it is one."""
    meanings = slot.meaning.split("; ")
    return f"{meanings[0]} ({slot.slot})" if len(meanings) == 1 else ", ".join(meanings)
