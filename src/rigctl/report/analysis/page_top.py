"""The top of an analysis page: the verdict, the decrease of the systematic error, one overlay.

In: the `Answer` that the terminal shows too, and the models that it is about (`NamedModels`). Out: the
first section of the page. All else on the page is evidence, and folded.

The bars show the systematic error, with the noise subtracted: of two errors close to the noise of a
reading, their bars would be nearly equal even if one model left nothing. Only channels that have changed,
or whose error stands out, are drawn, and of the records the one in which the models differ most; the
others are named in a line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rigctl.answers.blocks import Answer, Bar, Bars
from rigctl.answers.findings.systematic_error import ChannelFall, falls
from rigctl.answers.numbers import words
from rigctl.model.fit.fit import FitResult
from rigctl.report.analysis.overlay import condition_of, fall_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Plot
from rigctl.report.section import Section, plot_slot, render

Floats = NDArray[np.float64]

#: most channels in one overlay
_MOST_CHANNELS = 2
#: facts that are drawn as bars, or have a separate folded section
_ELSEWHERE = ("error", "lacks")
#: a channel whose error is below this share of the largest one is not drawn
_DRAWN = 0.5


@dataclass(frozen=True)
class NamedModels:
    """Models on the same data, by their names on the page: the first is the original, the last the current
    one.

    `left` is the systematic error of each, as of `rigctl.answers.findings.systematic_error.falls`.
    """

    names: tuple[str, ...]
    fits: tuple[FitResult, ...]
    left: tuple[Mapping[str, float], ...]

    @property
    def timed(self) -> bool:
        """Whether there are time series to draw, not the rows of a table."""
        return not self.fits[0].problem.measurements.table

    @property
    def record(self) -> int:
        """The most telling record: where the models differ most, or a single model fits worst."""
        first, last = self.fits[0], self.fits[-1]
        errors = [first.normalised_error(k) for k in range(len(first.outputs))]
        if len(self.fits) > 1:
            errors = [error - last.normalised_error(k) for k, error in enumerate(errors)]
        return int(np.argmax([_mean_square(error) for error in errors]))


def _mean_square(error: Floats) -> float:
    present = error[np.isfinite(error)]
    return float(np.mean(present**2)) if present.size else 0.0


def answer_section(answer: Answer, named: NamedModels | None, *, about: str) -> Section:
    """The beginning of the page.

    Parameters
    ----------
    named: the models of the answer; with None nothing is drawn.
    about: the model after which the page is named.
    """
    channel_falls = falls(named.fits, named.left) if named is not None else ()
    shown = [one for one in channel_falls if _shows(one)]
    error = next((text for head, text in answer.facts if head == "error"), "")
    plot = None
    if named is not None and named.timed:
        most = max((max(one.sizes) for one in shown), default=0.0)
        drawn_most = [one.channel for one in shown if max(one.sizes) > _DRAWN * most]
        plot = _overlay(named, drawn_most[:_MOST_CHANNELS])
    body = render(
        "answer.html",
        answer=answer,
        first=[words(one) for one in answer.first],
        sentence=words(answer.sentence),
        facts=[(words(head), words(text)) for head, text in answer.facts if head not in _ELSEWHERE],
        falls=None if named is None else _chart(shown, named),
        quiet="" if answer.tone == "open" else words(_unchanged(channel_falls, shown) if shown else error),
        plot=None if plot is None else plot_slot(plot),
        caption="" if plot is None else plot.caption,
        remarks=page_blocks((*answer.remarks, *answer.folded)),
    )
    drawn = () if plot is None else (plot,)
    return Section("answer", words(answer.title), body, drawn, names_page=about)


def _shows(one: ChannelFall) -> bool:
    """Whether to draw a channel: its error changed or, for a single model, exceeds the noise."""
    return one.changed if len(one.sizes) > 1 else not one.within(0)


def _chart(shown: Sequence[ChannelFall], named: NamedModels) -> Markup | None:
    """A bar for each channel and model, in sigmas of one reading; the noise of one reading beside them."""
    known, own = [one for one in shown if not one.own], [one for one in shown if one.own]
    title = "Systematic error" if len(named.names) == 1 else "How the systematic error falls"
    charts = [
        *([_bars(f"{title}: {_SCALE}", known, named)] if known else []),
        *([_bars(_OWN_SCALE, own, named)] if own else []),
    ]
    return Markup("").join(charts) if charts else None


#: of the two charts
_SCALE = "by how much it stands out from the noise, all readings together"
_OWN_SCALE = "Error of the model, noise included, where the slow part of the noise is not known"


def _bars(title: str, shown: Sequence[ChannelFall], named: NamedModels) -> Markup:
    largest = max(size for one in shown for size in one.sizes) or 1.0
    entries = [
        _bar(one, index, one.title if len(named.names) == 1 else f"{one.title}, {name}", largest)
        for one in shown
        for index, name in enumerate(named.names)
    ]
    return page_blocks([Bars(title, tuple(entries))])


def _bar(one: ChannelFall, index: int, label: str, largest: float) -> Bar:
    within, last = one.within(index), index == len(one.sizes) - 1 > 0
    length = 0.0 if within else one.sizes[index] / largest
    size = one.sigmas(index) if one.own or within else one.amount(index)
    return Bar(words(label), length, size, _beside(one, index), 0 if last else 1)


def _beside(one: ChannelFall, index: int) -> str:
    amount = one.amount(index)
    what = one.own or "noise"
    noise = f"; one reading has {one.noise_text} of {what}" if index == 0 else ""
    return (f"{amount}{noise}" if one.own else noise.removeprefix("; ")) if amount else ""


def _unchanged(channel_falls: Sequence[ChannelFall], shown: Sequence[ChannelFall]) -> str:
    """A sentence on the channels that are not drawn."""
    rest = [one for one in channel_falls if one not in shown]
    if not rest:
        return ""
    beyond = [one for one in rest if not one.within(-1)]
    within = [one.title for one in rest if one.within(-1)]
    parts = [f"{', '.join(within)}: within the noise"] if within else []
    parts += [
        f"{one.title}: {one.beside_noise(-1) if one.own else f'{one.amount(-1)} beyond the noise'}"
        for one in beyond
    ]
    same = " before and after" if len(channel_falls[0].sizes) > 1 else ""
    return f"{'; '.join(parts)}{same}"


def _overlay(named: NamedModels, channels: Sequence[str]) -> Plot | None:
    """The most telling record, measured and modelled, with the residuals of the first and the last model."""
    if not channels:
        return None
    first, last = named.fits[0], named.fits[-1]
    models = [(named.names[0], first)]
    if len(named.fits) > 1:
        models.append((named.names[-1], last))
    k = named.record
    which = "where the two differ most" if len(models) > 1 else "the worst record"
    caption = f"Measured and modelled, {which}: {words(condition_of(first, k))}"
    return fall_plot(models, k, "answer-overlay", caption, channels)
