"""The set-points of the steps of a watched run, as lines over its channels.

The log gives the start and end of a step, the plan its channel and target. A set-point that depends on the
first reading of its step, such as a ramp or a held value, is drawn once that reading is known.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rigctl.json_values import finite_or_none
from rigctl.plan.tree import Leaf

if TYPE_CHECKING:
    from rigctl.live.steps import PlanPlaces
    from rigctl.plan.action import SetPoint
    from rigctl.rig import Rig

#: steps with set-points that are remembered
_MOST: Final = 200
_ROUND: Final = re.compile(r"#\d+")

#: the first reading of a channel from a time of the run on, in its unit; None where it is not there
FirstReading = Callable[[str, float], float | None]


@dataclass
class _Step:
    """One step that has started; `end` is None while it is in progress."""

    path: str
    begin: float
    end: float | None = None
    line: Mapping[str, Any] | None = None  #: display text, once it is known


class SetPoints:
    """The set-points of the steps of one run.

    Parameters
    ----------
    rig: for the units; with None nothing is shown.
    """

    def __init__(self, rig: Rig | None) -> None:
        self._rig = rig
        self._steps: deque[_Step] = deque(maxlen=_MOST)
        self._places: PlanPlaces | None = None

    def follow(self, places: PlanPlaces) -> None:
        """Set the plan."""
        self._places = places

    def take(self, line: Mapping[str, Any]) -> None:
        """Handle a line of the log: the start or end of a step or of the run."""
        time, kind = line.get("time"), line.get("kind")
        if not isinstance(time, int | float):
            return
        if kind == "step" and line.get("state") == "begin":
            path = str(line.get("path", ""))
            if self._places is None or self._set_point_at(path) is not None:
                self._steps.append(_Step(path, float(time)))
        elif kind == "step" and line.get("state") == "end":
            for step in self._steps:
                if step.end is None and step.path == line.get("path"):
                    step.end = float(time)
        elif kind == "end":
            for step in self._steps:
                step.end = float(time) if step.end is None else step.end

    def shown(self, first: FirstReading, since: float) -> list[dict[str, Any]]:
        """The set-points after `since`, s of the run, in the units of their channels."""
        lines = []
        for step in self._steps:
            if step.end is not None and step.end < since:
                continue
            if step.line is None:
                step.line = self._line(step, first)
            if step.line is not None:
                lines.append({**step.line, "begin": step.begin, "end": step.end})
        return lines

    def _set_point_at(self, path: str) -> SetPoint | None:
        if self._places is None:
            return None
        chain = self._places.chain(_ROUND.sub("", path))
        return chain[-1].action.set_point() if chain and isinstance(chain[-1], Leaf) else None

    def _line(self, step: _Step, first: FirstReading) -> Mapping[str, Any] | None:
        """Start and target value, duration in s, and tolerance."""
        from rigctl.units import parse_unit

        set_point = self._set_point_at(step.path)
        if set_point is None or self._rig is None or set_point.channel not in self._rig.channels:
            return None
        channel = self._rig.channels[set_point.channel]
        unit = parse_unit(channel.unit)
        start = (
            first(set_point.channel, step.begin)
            if set_point.to is None or set_point.ramp is not None
            else None
        )
        if start is None and (set_point.to is None or set_point.ramp is not None):
            return None
        to = start if set_point.to is None else unit.from_si(set_point.to, difference=channel.difference)
        assert to is not None  # noqa: S101 - without a value of its own it is the reading, which is known here
        seconds = 0.0
        if set_point.ramp is not None and start is not None:
            seconds = abs(to - start) * unit.factor / set_point.ramp if set_point.ramp > 0.0 else math.inf
        return {
            "channel": set_point.channel,
            "from": to if start is None else start,
            "to": to,
            "seconds": finite_or_none(seconds),
            "within": None if set_point.within is None else set_point.within / unit.factor,
        }
