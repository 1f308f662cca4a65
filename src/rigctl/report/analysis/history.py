"""The page's part on a model's versions: how the error fell, down to the noise."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from rigctl.model.history.errors import version_errors
from rigctl.model.history.store import versions
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.numbers import symbol
from rigctl.report.section import Section, render
from rigctl.report.signals import plain_name


def history_sections(path: Path) -> list[Section]:
    """A waterfall for each channel; nothing for a model whose versions have no errors yet."""
    shown = [one for one in version_errors(versions(path)) if one.error is not None]
    if len(shown) < 2:
        return []
    channels = list(dict.fromkeys(name for one in shown if one.error for name in one.error.rmse))
    parts: list[Markup] = []
    for channel in channels:
        entries: list[Bar] = []
        values = [one.error.rmse[channel] for one in shown if one.error and channel in one.error.rmse]
        values += [
            one.error.heldout_rmse[channel]
            for one in shown
            if one.error and channel in one.error.heldout_rmse
        ]
        largest = max(values) or 1.0
        floor, unit = None, ""
        for one in shown:
            if one.error is None or channel not in one.error.rmse:
                continue
            unit = symbol(one.error.units.get(channel, ""))
            floor = one.error.noise.get(channel, floor)
            label = f"{one.version.number}: {one.version.done}"
            value = one.error.rmse[channel]
            entries.append(Bar(label, value / largest, f"{value:.3g} {unit}", "fitted", 0))
            outside = one.error.heldout_rmse.get(channel)
            if outside is not None:
                entries.append(Bar("", outside / largest, f"{outside:.3g} {unit}", "held out", 1))
        if floor is not None:
            entries.append(Bar("noise", floor / largest, f"{floor:.3g} {unit}", "what noise alone makes", 7))
        parts.append(bars(f"Error of the {plain_name(channel)} by version of the model (RMSE)", entries))
    return [Section("versions", "How the error fell", render("history.html", parts=parts))]
