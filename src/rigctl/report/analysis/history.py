"""The section on a model's versions: how the error fell, down to the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.model.errors import error_bars
from rigctl.model.history.change import ModelError
from rigctl.model.history.errors import version_errors
from rigctl.model.history.store import versions
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.stroke_over_temperature import stroke_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.heat_map import HeatMap, heat_map_table
from rigctl.report.section import Section, plot_slot, render


def history_sections(path: Path, compared: Sequence[ModelComparison] = ()) -> list[Section]:
    """A waterfall chart for each channel; nothing for a model whose versions have no errors yet.

    Parameters
    ----------
    compared: versions of the model in order, named as such, all compared with the same data: their strokes
        are drawn together, and the error maps of the first and the last side by side.
    """
    errors = version_errors(versions(path))
    steps = [(f"{one.version.number}: {one.version.done}", one.error) for one in errors]
    if len(steps) < 2:
        return []
    channels = [
        name for name in dict.fromkeys(n for _, error in steps for n in error.rmse) if _changed(name, steps)
    ]
    pictured = compared if len(compared) > 1 and not compared[0].rows else ()
    stroke = stroke_plot(pictured, "version-stroke") if pictured else None
    maps = _before_and_after(pictured[0], pictured[-1], channels) if pictured else []
    body = render(
        "history.html",
        bars=page_blocks(error_bars(steps, changed=True)),
        stroke=None if stroke is None else plot_slot(stroke),
        maps=[(heat_map_table(one), heat_map_table(other)) for one, other in maps],
    )
    drawn = [] if stroke is None else [stroke]
    hint = f"how the error fell over {len(steps)} versions"
    maps_drawn = (m for pair in maps for m in pair)
    return [Section("versions", "Versions of the model", body, (*drawn, *maps_drawn), folded=True, hint=hint)]


def _changed(channel: str, steps: Sequence[tuple[str, ModelError]]) -> bool:
    """Whether a channel's error differs between any two versions by more than a hundredth."""
    sizes = [error.rmse[channel] for _, error in steps if channel in error.rmse]
    return bool(sizes) and max(sizes) - min(sizes) > 0.01 * max(sizes)


def _before_and_after(
    first: ModelComparison, last: ModelComparison, channels: Sequence[str]
) -> list[tuple[HeatMap, HeatMap]]:
    """Maps of the channels whose error changed, of the first version beside those of the last."""
    before = channel_maps(first, "before", title=f"{first.name}: ", channels=channels)
    after = channel_maps(last, "after", title=f"{last.name}: ", channels=channels)
    return list(zip(before, after, strict=True))
