"""A run on a terminal, redrawn by a separate thread, so that a slow terminal never slows the run.

The run hands over a `View` ten times a second; `Readings` takes some of them, and rich's thread draws the
newest four times a second. Views are immutable and replaced as a whole, so that the thread needs no lock.
"""

from __future__ import annotations

from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from rigctl.live.plain import stamp
from rigctl.live.readings import Readings, readings_table
from rigctl.live.steps import PlanPlaces, Stage, StepLine, outline
from rigctl.plan import Plan
from rigctl.planning.outline import clock_time
from rigctl.printable import printable
from rigctl.runner.snapshot import View

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text

#: redraws per second of wall time; drawing takes about 10 ms, which the run shares
_RATE = 4.0
_HAPPENINGS = 5
_STATES = {
    "running": "bold green",
    "paused": "bold yellow",
    "safe": "bold yellow",
    "failed": "bold red",
    "aborted": "bold yellow",
    "finished": "bold green",
}
_KINDS = {"alarm": "red", "fault": "red", "gap": "yellow"}
_MARKS = {Stage.DONE: ("✓", "+", "dim"), Stage.CURRENT: ("▶", ">", "bold"), Stage.AHEAD: ("·", ".", "dim")}


class TerminalDisplay:
    """State and progress, steps, channels, the latest events, and the open question."""

    interactive = True

    def __init__(self, plan: Plan, stream: TextIO, *, hint: str = "") -> None:
        from rich.console import Console
        from rich.live import Live

        self._plan = plan
        self._places = PlanPlaces(plan)
        self._readings = Readings(plan.rig)
        self._hint = hint
        self._view: View | None = None
        self._last_update = 0.0
        self._over = False
        self._console = Console(file=stream, highlight=False)
        self._unicode = self._console.encoding.lower().startswith("utf")
        self._live = Live(
            get_renderable=self.render,
            console=self._console,
            refresh_per_second=_RATE,
            redirect_stdout=False,  # stdout carries results
        )

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over = True
        if self._view is not None:
            self._update(self._view)
        self._live.stop()

    def __call__(self, view: View) -> None:
        """Keep the view for the next drawing."""
        self._view = view
        now = monotonic()
        if now - self._last_update >= 1.0 / _RATE:
            self._last_update = now
            self._update(view)

    def _update(self, view: View) -> None:
        alarms = {alarm.channel: alarm.action for alarm in view.alarms}
        self._readings.update(view.values, view.commands, dict(alarms))

    def render(self) -> RenderableType:
        """The current display."""
        from rich.console import Group
        from rich.text import Text

        view = self._view
        if view is None:
            return Text("")
        parts: list[RenderableType] = [self._heading(view), self._progress(view)]
        if view.question:  # near the top, where no low terminal cuts it off
            parts += [Text(""), Text(printable(view.question), style="bold cyan")]
        parts.append(Text(""))
        below = self._below(view)
        if self._over and view.state == "finished":  # no step is left that would be the current one
            return Group(*parts, readings_table(self._readings, unicode=self._unicode), *below)
        table = readings_table(self._readings, unicode=self._unicode)
        occupied = len(parts) + table.row_count + len(below) + 3
        parts += [
            self._step(line) for line in outline(self._places, view.path, self._console.height - occupied)
        ]
        parts += [Text(""), table, *below]
        return Group(*parts)

    def _heading(self, view: View) -> RenderableType:
        from rich.text import Text

        line = Text(no_wrap=True, overflow="ellipsis")
        line.append(printable(self._plan.name), "bold")
        line.append(f" on {printable(self._plan.rig.name)}  ", "dim")
        line.append(view.state, _STATES.get(view.state, "bold"))
        line.append(f"  {stamp(view.time)}")
        if view.message:
            line.append(f"  {printable(view.message)}", "yellow")
        return line

    def _progress(self, view: View) -> RenderableType:
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        row = Table.grid(padding=(0, 2))
        texts = [
            Text(f"{view.progress:4.0%}"),
            Text(_records(view)),
            Text(
                f"about {clock_time(view.time_left)} left" if view.time_left and not self._over else "", "dim"
            ),
        ]
        room = self._console.width - sum(text.cell_len + 2 for text in texts)
        width = max(min(self._console.width // 3, 40, room), 8)
        row.add_row(ProgressBar(total=1.0, completed=view.progress, width=width), *texts)
        return row

    def _step(self, line: StepLine) -> RenderableType:
        from rich.text import Text

        sign, plain, style = _MARKS[line.stage]
        text = Text(
            f"{'  ' * line.depth}{sign if self._unicode else plain} {printable(line.label)}",
            style=style,
            no_wrap=True,
            overflow="ellipsis",
        )
        if line.note:
            text.append(f"  {line.note}", "cyan")
        return text

    def _below(self, view: View) -> list[Text]:
        """The latest events, and the keys."""
        from rich.text import Text

        lines = [Text("")]
        for happening in view.happenings[-_HAPPENINGS:]:
            line = Text(no_wrap=True, overflow="ellipsis")
            line.append(f"{stamp(happening.time)}  ", "dim")
            kind = "" if happening.kind == "state" else f"{happening.kind}: "
            line.append(f"{kind}{printable(happening.message)}", _KINDS.get(happening.kind, ""))
            lines.append(line)
        if self._hint and not self._over:
            lines += [Text(""), Text(self._hint, style="dim")]
        return lines


def _records(view: View) -> str:
    """The open record, or the number of records."""
    if not view.records_total:
        return ""
    if view.record >= 0:
        return f"record {view.records_done + 1} of {view.records_total}"
    return f"{view.records_done} of {view.records_total} records"
