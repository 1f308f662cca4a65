"""The section on records that no fit saw: how good the model is there, and what it still misses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.answers.blocks import Bar, Bars, Block, Figure, Sentence
from rigctl.answers.held_out import sentences
from rigctl.answers.numbers import symbol
from rigctl.report.analysis.overlay import overlay_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Plot
from rigctl.report.section import Section, plot_slot
from rigctl.report.signals import plain_name
from rigctl.units import significant


def unseen_sections(groups: Sequence[HeldOutGroup]) -> list[Section]:
    """A statement; if the model misses something, also bars and the record that shows it most."""
    if not groups:
        return []
    drawn, blocks = list[Plot](), list[Block]()
    for number, one in enumerate(groups):
        first, *rest = sentences(one)
        blocks += [Sentence(first, "good" if one.as_good else "warn"), *map(Sentence, rest)]
        if not one.as_good:
            drawn.append(_worst(one, number))
            blocks += [_bars(name, values) for name, values in one.channels().items()]
            blocks.append(Figure(drawn[-1].id, drawn[-1].caption))
    good = all(one.as_good for one in groups)
    body = page_blocks(blocks, {plot.id: plot_slot(plot) for plot in drawn})
    hint = "as good as where it was fitted" if good else ""
    return [Section("unseen", "Records that no fit saw", body, tuple(drawn), folded=good, hint=hint)]


def _bars(name: str, values: dict[str, object]) -> Bars:
    unit = symbol(str(values["unit"]))
    sizes = [("here", values["rmse"], 1), ("where it was fitted", values["fitted_rmse"], 0)]
    sizes.append(("the noise alone", values["noise"], 7))
    known = [(label, float(str(size)), colour) for label, size, colour in sizes if size is not None]
    largest = max(size for _, size, _ in known) or 1.0
    shown = [
        Bar(label, size / largest, f"{significant(size, 3)} {unit}", "", colour)
        for label, size, colour in known
    ]
    return Bars(f"Error of the {plain_name(name)} (RMSE)", tuple(shown))


def _worst(one: HeldOutGroup, number: int) -> Plot:
    """The record with the largest error."""
    fit = one.fit
    k = max(fit.fitted, key=lambda index: float(np.nanmean(fit.normalised_error(index) ** 2)))
    label = one.called(fit.problem.records[k].label)
    return overlay_plot([("model", fit)], k, f"unseen-{number}", f"The worst of these records, {label}")
