"""The channels of a bench on a terminal, redrawn in place: `rigctl monitor` without a run."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from rigctl.backends.protocol import Sample
from rigctl.live.plain import stamp
from rigctl.live.readings import Readings, readings_table
from rigctl.printable import printable
from rigctl.rig import Rig
from rigctl.runner.interlocks import Alarm

if TYPE_CHECKING:
    from rich.console import RenderableType

_RATE = 4.0  # redrawings per second of wall time
_NOTICES = 3  # the newest messages of the bench that are shown


class MonitorDisplay:
    """Every channel with its trend and limits, and the active alarms."""

    def __init__(self, rig: Rig, stream: TextIO) -> None:
        from rich.console import Console
        from rich.live import Live

        self._rig = rig
        self._readings = Readings(rig)
        self._time = 0.0
        self._alarms: dict[str, Alarm] = {}
        self._devices: Sequence[str] = ()
        self._notices: deque[str] = deque(maxlen=_NOTICES)
        console = Console(file=stream, highlight=False)
        self._unicode = console.encoding.lower().startswith("utf")
        self._live = Live(
            get_renderable=self.render, console=console, refresh_per_second=_RATE, redirect_stdout=False
        )

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def __call__(
        self,
        sample: Sample,
        alarms: Sequence[Alarm],
        notices: Sequence[str] = (),
        devices: Sequence[str] = (),
    ) -> None:
        """Take a sample, the alarms that it raised or cleared, and the messages of the bench and on its
        devices."""
        self._notices.extend(notices)
        self._devices = devices
        changed = {alarm.name: alarm for alarm in alarms}
        latched = {**self._alarms, **changed}
        self._alarms = {name: alarm for name, alarm in latched.items() if alarm.active}
        layout = self._rig.layout
        self._time = sample.time
        self._readings.update(
            dict(zip(layout.channels, sample.values, strict=True)),
            dict(zip(layout.commands, sample.commands, strict=True)),
            {alarm.channel: alarm.action for alarm in self._alarms.values()},
        )

    def render(self) -> RenderableType:
        """The current display."""
        from rich.console import Group
        from rich.text import Text

        alarms = [Text(printable(alarm.message), style="red") for alarm in self._alarms.values()]
        notices = [Text(printable(text), style="yellow") for text in self._notices]
        heading = Text(f"{printable(self._rig.name)}  {stamp(self._time)}  Ctrl-C ends", style="dim")
        devices = [Text(printable(text), style="dim") for text in self._devices]
        table = readings_table(self._readings, unicode=self._unicode)
        return Group(heading, *devices, Text(""), table, *alarms, *notices)
