"""The page's part on a model's versions: how the error fell, down to the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.model.history.change import ModelError
from rigctl.model.history.errors import version_errors
from rigctl.model.history.store import versions
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.strokes import stroke_plot
from rigctl.report.heat_map import HeatMap, heat_map_table
from rigctl.report.numbers import symbol
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name


def history_sections(path: Path, compared: Sequence[ModelComparison] = ()) -> list[Section]:
    """A waterfall for each channel; nothing for a model whose versions have no errors yet.

    Parameters
    ----------
    compared: versions of the model in order, named as such, all compared with the same data: their strokes
        are drawn together, and the error maps of the first and the last side by side.
    """
    found = version_errors(versions(path))
    steps = [(f"{one.version.number}: {one.version.done}", one.error) for one in found]
    if len(steps) < 2:
        return []
    channels = dict.fromkeys(name for _, error in steps for name in error.rmse)
    pictured = compared if len(compared) > 1 and not compared[0].rows else ()
    stroke = stroke_plot(pictured, "version-stroke") if pictured else None
    maps = _before_and_after(pictured[0], pictured[-1]) if pictured else []
    body = render(
        "history.html",
        parts=[_waterfall(channel, steps) for channel in channels],
        stroke=None if stroke is None else plot_slot(stroke),
        maps=[(heat_map_table(one), heat_map_table(other)) for one, other in maps],
    )
    drawn = [] if stroke is None else [stroke]
    return [Section("versions", "How the error fell", body, (*drawn, *(m for pair in maps for m in pair)))]


def _before_and_after(first: ModelComparison, last: ModelComparison) -> list[tuple[HeatMap, HeatMap]]:
    before = channel_maps(first, "before", title=f"{first.name}: ")
    after = channel_maps(last, "after", title=f"{last.name}: ")
    return list(zip(before, after, strict=True))


def _waterfall(channel: str, steps: Sequence[tuple[str, ModelError]]) -> Markup:
    """The error of one channel by version, fitted and held out, above that of its noise."""
    known = [(label, error) for label, error in steps if channel in error.rmse]
    sizes = [
        size for _, error in known for size in (error.rmse[channel], error.heldout_rmse.get(channel, 0.0))
    ]
    largest = max(sizes) or 1.0
    entries: list[Bar] = []
    for label, error in known:
        unit, held_out = symbol(error.units.get(channel, "")), error.heldout_rmse.get(channel)
        fitted = error.rmse[channel]
        entries.append(Bar(label, fitted / largest, f"{fitted:.3g} {unit}", "fitted", 0))
        if held_out is not None:
            entries.append(Bar("", held_out / largest, f"{held_out:.3g} {unit}", "held out", 1))
    floor = next((error.noise[channel] for _, error in reversed(known) if channel in error.noise), None)
    if floor is not None:
        entries.append(Bar("noise", floor / largest, f"{floor:.3g} {unit}", "what noise alone makes", 7))
    return bars(f"Error of the {plain_name(channel)} by version of the model (RMSE)", entries)
