"""The section on a model's versions: how the error fell, down to the noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.blocks import Bar, Bars
from rigctl.answers.numbers import symbol
from rigctl.model.history.change import ModelError
from rigctl.model.history.errors import version_errors
from rigctl.model.history.store import versions
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.stroke_over_temperature import stroke_plot
from rigctl.report.blocks import page_blocks
from rigctl.report.heat_map import HeatMap, heat_map_table
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import significant

#: a smaller excess over the noise can come from noise that was estimated from a part of the data
_AT_NOISE = 1.05
_UNSEEN = "on records no fit saw"
#: an excess below this share of the noise is not distinguished from it
_WITHIN = 0.1


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
        parts=[_waterfall(channel, steps) for channel in channels],
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


def _waterfall(channel: str, steps: Sequence[tuple[str, ModelError]]) -> Markup:
    """A channel's error without the noise, by version, fitted and held out.

    The noise is the estimated one, or the error of the last version if that exceeds it only by chance. If the
    noise is not known the whole error is shown.
    """
    known = [(label, error) for label, error in steps if channel in error.rmse]
    unit = symbol(known[-1][1].units.get(channel, ""))
    noise = next((error.noise[channel] for _, error in reversed(known) if error.noise.get(channel)), 0.0)
    last = known[-1][1].rmse[channel]
    base = last if last < _AT_NOISE * noise else noise
    rows: list[tuple[str, float, str, int]] = []
    for label, error in known:
        rows.append((label, error.rmse[channel], "fitted", 0))
        if channel in error.heldout_rmse:
            rows.append((_UNSEEN, error.heldout_rmse[channel], "held out", 1))
    sizes = [math.sqrt(max(rmse**2 - base**2, 0.0)) for _, rmse, _, _ in rows]
    largest = max(sizes) or 1.0
    shown = [
        Bar(
            label,
            size / largest,
            _size_text(size, noise, unit),
            f"{what}; RMSE {significant(rmse, 3)} {unit}".rstrip(),
            colour,
        )
        for (label, rmse, what, colour), size in zip(rows, sizes, strict=True)
    ]
    if not noise:
        return page_blocks([Bars(f"{plain_name(channel)}: error by version (RMSE)", tuple(shown))])
    size = f"{significant(noise, 3)} {unit}".rstrip()
    heading = f"systematic error by version; the noise of {size} is taken off"
    return page_blocks([Bars(f"{plain_name(channel)}: {heading}", tuple(shown))])


def _size_text(size: float, noise: float, unit: str) -> str:
    """A size as text, or a note that it is within the noise."""
    return "within the noise" if size < _WITHIN * noise else f"{significant(size, 2)} {unit}".rstrip()
