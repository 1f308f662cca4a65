"""The section on learning: by round the verdict, the rivals, the error, and predicted beside achieved
results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rigctl.answers.learning import gain_bars, learning_answer, round_row
from rigctl.answers.numbers import words
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned, Round
from rigctl.planning.outline import clock_time
from rigctl.report.analysis.history import history_sections
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name

#: effects that are drawn, those with the highest maximum probability first
_DRAWN = 6
#: an effect that was never more probable than this is not drawn
_PROBABLE = 0.01


def learning_sections(learned: Learned, model: Path, named: NamedModels | None = None) -> list[Section]:
    """How it ended; then the rounds, and the resulting versions of the model.

    Parameters
    ----------
    named: the original and the current model, on all measurements.
    """
    plot = rounds_plot(learned)
    body = render(
        "learning.html",
        learned=learned,
        good=learned.ended is LearningEnd.ADEQUATE,
        rounds=[round_row(one) for one in learned.rounds],
        spent=clock_time(learned.spent),
        plot=None if plot is None else plot_slot(plot),
        predictions=page_blocks(gain_bars(learned)),
    )
    hint = "round by round: what was measured, what was predicted, what was achieved"
    drawn = () if plot is None else (plot,)
    story = Section("learning", "What was learnt", body, drawn, folded=True, hint=hint)
    answer = learning_answer(
        learned, () if named is None else named.fits, () if named is None else named.left
    )
    about = f"{model.name}, version {learned.version}"
    return [answer_section(answer, named, about=about), story, *history_sections(model)]


def hidden_section(hidden: str, found: str, *, right: bool) -> Section:
    """The end of a demonstration's page: the hidden effects, and those found.

    Parameters
    ----------
    hidden, found: effects with their parameters as ``name:parameter=value``.
    """

    def as_text(text: str) -> str:
        return words(text.replace(":", ", ").replace("=", " "))

    body = render("hidden.html", hidden=as_text(hidden), found=as_text(found), right=right)
    return Section("hidden", "Was it right?", body, closes=True)


def rounds_plot(learned: Learned) -> Plot | None:
    """The probability of each rival and the error, by round; nothing for a single round."""
    judged = [one for one in learned.rounds if one.judged]
    if len(judged) < 2:
        return None
    numbers = np.array([float(one.number) for one in judged])
    rivals = [
        Trace(plain_name(name), numbers, _course(judged, name), Look.MARKED, k)
        for k, name in enumerate(_drawn(judged))
    ]
    channels = list(dict.fromkeys(name for one in judged for name in one.error))
    errors = [
        Trace(
            plain_name(name),
            numbers,
            np.array([one.error.get(name, np.nan) for one in judged]),
            Look.MARKED,
            k,
            "of the noise",
        )
        for k, name in enumerate(channels)
    ]
    panels = [Panel("probability", tuple(rivals), 1.4, (0.0, 1.05))] if rivals else []
    panels.append(Panel("error / noise", tuple(errors), 1.0))
    return Plot("rounds", "The verdict after each round", "round", tuple(panels))


def _drawn(judged: Sequence[Round]) -> list[str]:
    most = dict[str, float]()
    for one in judged:
        for name, chance in one.probabilities.items():
            most[name] = max(most.get(name, 0.0), chance)
    likely = [name for name, chance in most.items() if chance > _PROBABLE]
    return sorted(likely, key=lambda name: -most[name])[:_DRAWN]


def _course(judged: Sequence[Round], name: str) -> np.ndarray:
    return np.array([one.probabilities.get(name, 0.0) for one in judged])
