"""What a free correction reaches on the data of a model, beside that model, in words and bars."""

from __future__ import annotations

from rigctl.analysis.agreement.achievable_error import AchievableError
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.blocks import Bar, Bars, Block, Sentence
from rigctl.units import show, significant

#: the error of a free model is given as a number where it is smaller than this share of the model's
_NOTABLY = 0.98


def free_model_text(model: ModelComparison) -> str:
    """``reaches 0.132 mm in position, this one 0.142 mm, noise 0.101 mm``; "" for a table."""
    if not model.achievable:
        return ""
    return "; ".join(map(_reached, model.beaten)) or "finds nothing more"


def _reached(one: AchievableError) -> str:
    if one.free < _NOTABLY * one.model:
        return (
            f"reaches {_in(one, one.free)} in {one.channel}, this one {_in(one, one.model)}, "
            f"noise {_in(one, one.noise)}"
        )
    return f"predicts {_share(one)} of what this one leaves in {one.channel} beside slow noise"


def contradiction(model: ModelComparison) -> list[Block]:
    """That a free model beats one that passes every test: something is missing that none of them shows."""
    if not model.contradicted:
        return []
    found = " and ".join(f"{_share(one)} of what it leaves in {one.channel}" for one in model.beaten)
    text = (
        f"A free model contradicts this: from the inputs it predicts {found}, on data that it was not fitted "
        "to. Something is missing that no test shows"
    )
    return [Sentence(text, "warn", "warning")]


def free_model_bars(model: ModelComparison, caption: str) -> list[Block]:
    """The error of each channel, and that of a free model, beside its noise."""
    bars: list[Bar] = []
    for one in model.achievable:
        longest = max(one.model, one.noise)
        for label, error, colour in (
            (f"{one.channel}, this model", one.model, 0),
            ("a free model", one.free, 1),
            ("noise", one.noise, 2),
        ):
            bars.append(Bar(label, error / longest, _in(one, error), colour=colour))
    title = "root mean square error, and what a free model reaches on data left out of its fit"
    return [Bars(f"{caption}: {title}" if caption else title, tuple(bars))] if bars else []


def _share(one: AchievableError) -> str:
    return f"{significant(100.0 * one.share, 2)} %"


def _in(one: AchievableError, error: float) -> str:
    return show(error, one.unit, difference=True, digits=3)
