"""The page's part on a model's versions: how the error fell, down to the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from rigctl.model.history.change import ModelError
from rigctl.model.history.errors import version_errors
from rigctl.model.history.store import versions
from rigctl.report.analysis.bars import Bar, bars
from rigctl.report.numbers import symbol
from rigctl.report.section import Section, render
from rigctl.report.signals import plain_name


def history_sections(path: Path) -> list[Section]:
    """A waterfall for each channel; nothing for a model whose versions have no errors yet."""
    found = version_errors(versions(path))
    steps = [(f"{one.version.number}: {one.version.done}", one.error) for one in found]
    if len(steps) < 2:
        return []
    channels = dict.fromkeys(name for _, error in steps for name in error.rmse)
    parts = [_waterfall(channel, steps) for channel in channels]
    return [Section("versions", "How the error fell", render("history.html", parts=parts))]


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
