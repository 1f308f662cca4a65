"""The readings of the channels: value, recent trend, and limits.

In: the newest values of a run or of a bench that is watched. Out: a table for a terminal. Values are
shown with the digits that their noise or their converter leaves, and trends no larger than a share of the
range, so that noise does not look like a signal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rigctl.rig import Channel, Limit, Rig
from rigctl.units import parse_unit, show

if TYPE_CHECKING:
    from rich.table import Table

BLOCKS, PLAIN_BLOCKS = "▁▂▃▄▅▆▇█", "_.-=+*#@"
_LENGTH = 24  # values in a sparkline
#: smallest span of a sparkline, as a share of the channel's limits, so that noise is not exaggerated
_LEAST_SPAN = 0.02


class Readings:
    """The newest values of a rig's channels, and their history."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.values: Mapping[str, float] = {}
        self.commands: Mapping[str, float] = {}
        self.alarms: Mapping[str, str] = {}
        self._past: Mapping[str, tuple[float, ...]] = dict.fromkeys(rig.channels, ())

    def update(
        self,
        values: Mapping[str, float],
        commands: Mapping[str, float],
        alarms: Mapping[str, str] | None = None,
    ) -> None:
        """Take the next values, SI; `alarms` has ``warn`` or ``stop`` for channels with an alarm.

        The old data are replaced, never modified: another thread may be drawing them.
        """
        self.values, self.commands, self.alarms = values, commands, alarms or {}
        self._past = {
            name: (*past, values.get(name, math.nan))[-_LENGTH:] for name, past in self._past.items()
        }

    def past(self, name: str) -> Sequence[float]:
        """The latest values of a channel, oldest first."""
        return self._past[name]


def readings_table(readings: Readings, *, unicode: bool = True) -> Table:
    """A table of all channels and commands for `rich`.

    Parameters
    ----------
    unicode: False for a terminal that shows only ASCII.
    """
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column()
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(style="dim")
    for name, channel in readings.rig.channels.items():
        alarm = readings.alarms.get(name)
        style = {"warn": "yellow", "stop": "bold red"}.get(alarm or "", "")
        value = readings.values.get(name, math.nan)
        line = sparkline(readings.past(name), least_span(channel, readings.rig), unicode=unicode)
        table.add_row(
            Text(name, style=style),
            Text(shown(value, channel), style=style or ("" if math.isfinite(value) else "red")),
            Text(line, style="cyan"),
            Text(limits_of(name, channel, readings.rig)),
        )
    for name, actuator in readings.rig.actuators.items():
        command = readings.commands.get(name, math.nan)
        text = actuator.show(command) if math.isfinite(command) else "–"
        moving = math.isfinite(command) and command != 0.0 and actuator.kind != "level"
        table.add_row(Text(name), Text(text, style="bold green" if moving else ""), Text(""), Text(""))
    return table


def shown(value: float, channel: Channel) -> str:
    """A value in the channel's unit, with the decimals that are significant for its noise."""
    if not math.isfinite(value):
        return "no value"
    unit = parse_unit(channel.unit)
    number = unit.from_si(value, difference=channel.difference)
    text = f"{number:.{decimals(channel)}f}"
    text = text if float(text) else text.removeprefix("-")  # -0 is shown as 0
    return f"{text} {channel.unit}".removesuffix(" 1")


def decimals(channel: Channel) -> int:
    """Decimals of a channel's value: those of its converter's step, or of its noise without a converter."""
    step = (channel.resolution or channel.noise_level) / parse_unit(channel.unit).factor
    if not math.isfinite(step) or step <= 0.0:
        return 3
    return min(max(-math.floor(math.log10(step) + 1e-9), 0), 6)


def limits_of(name: str, channel: Channel, rig: Rig) -> str:
    """The tightest limits that stop a run, e.g. ``-3 … 245 mm``; empty if there are none."""
    mine = [limit for limit in rig.limits.values() if limit.channel == name and limit.action == "stop"]
    low, high = _tightest(mine)
    unit = channel.unit
    if low is not None and high is not None:
        number = show(low, unit, difference=channel.difference).removesuffix(unit).strip()
        return f"{number} … {show(high, unit, difference=channel.difference)}"
    if high is not None:
        return f"below {show(high, unit, difference=channel.difference)}"
    if low is not None:
        return f"above {show(low, unit, difference=channel.difference)}"
    return ""


def _tightest(limits: Sequence[Limit]) -> tuple[float | None, float | None]:
    lows = [limit.threshold for limit in limits if limit.bound == "below"]
    highs = [limit.threshold for limit in limits if limit.bound == "above"]
    return (max(lows) if lows else None, min(highs) if highs else None)


def least_span(channel: Channel, rig: Rig) -> float:
    """The smallest range that a sparkline of this channel spans, SI."""
    if channel.range is not None:
        return _LEAST_SPAN * (channel.range[1] - channel.range[0])
    return 4.0 * (channel.resolution or channel.noise_level)


def sparkline(values: Sequence[float], span: float, *, unicode: bool = True) -> str:
    """Values as a sparkline of block characters, with a gap for a missing value.

    Parameters
    ----------
    span: a smaller range than this is drawn as if it were this wide, around its middle.
    """
    blocks = BLOCKS if unicode else PLAIN_BLOCKS
    quarters = [0.25 * value for value in values]  # differences of the largest floats stay finite
    present = [value for value in quarters if math.isfinite(value)]
    if not present:
        return " " * len(values)
    low, high = min(present), max(present)
    if high - low < 0.25 * span:
        middle = 0.5 * low + 0.5 * high
        low, high = middle - 0.125 * span, middle + 0.125 * span
    range_ = high - low if high > low else math.inf
    top = len(blocks) - 1
    return "".join(
        blocks[round((value - low) / range_ * top)] if math.isfinite(value) else " " for value in quarters
    )
