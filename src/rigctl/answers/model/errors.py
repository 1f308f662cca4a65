"""The errors of a model after each step, as bars."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigctl.answers.blocks import Bar, Bars, Block
from rigctl.model.history.change import ModelError
from rigctl.units import significant


def error_bars(steps: Sequence[tuple[str, ModelError]], *, changed: bool = False) -> list[Block]:
    """The error of each channel after each step; the bars are the error without the noise.

    If the noise is not known they are the whole error. With `changed` only channels whose error differs
    between any two steps by more than a hundredth.
    """
    blocks: list[Block] = []
    for channel in dict.fromkeys(name for _, error in steps for name in error.rmse):
        rmse = [error.rmse[channel] for _, error in steps if channel in error.rmse]
        if changed and max(rmse) - min(rmse) <= 0.01 * max(rmse):
            continue
        unit = next((error.units[channel] for _, error in steps if channel in error.units), "")
        values = _values(steps, channel)
        noise = next((value for _, kind, value in values if kind == "noise"), 0.0)
        sizes = [math.sqrt(max(value**2 - noise**2, 0.0)) for _, _, value in values]
        largest = max(sizes) or 1.0
        what = "; bars without the noise" if noise else ""
        width = max(len(label) for label, _, _ in values)
        bars = tuple(
            Bar(f"{label:<{width}}  {kind}".rstrip(), size / largest, significant(value))
            for (label, kind, value), size in zip(values, sizes, strict=True)
        )
        title = f"{channel}, root mean square error{f' [{unit}]' if unit else ''}{what}"
        blocks.append(Bars(title, bars))
    return blocks


def _values(steps: Sequence[tuple[str, ModelError]], channel: str) -> list[tuple[str, str, float]]:
    """Label, kind and value of every bar of a channel."""
    values: list[tuple[str, str, float]] = []
    for label, error in steps:
        if channel in error.rmse:
            values.append((label, "fitted", error.rmse[channel]))
        if channel in error.heldout_rmse:
            named = label if channel not in error.rmse else ""
            values.append((named, "held out", error.heldout_rmse[channel]))
    noise = [error.noise[channel] for _, error in steps if channel in error.noise]
    return values + [("", "noise", value) for value in noise[-1:]]
