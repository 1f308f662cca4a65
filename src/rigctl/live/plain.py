"""A run as lines: for a log, a pipe, or a terminal that cannot redraw."""

from __future__ import annotations

from contextlib import suppress
from types import TracebackType
from typing import Self, TextIO

from rigctl.live.steps import PlanPlaces
from rigctl.plan import Plan
from rigctl.planning.outline import clock_time
from rigctl.printable import printable
from rigctl.runner.snapshot import ShownEvent, View

_STEP = 0.1  # interval between progress lines


class PlainDisplay:
    """One line for each change of state, each record, each alarm, and each tenth of the way."""

    interactive = False

    def __init__(self, plan: Plan, stream: TextIO) -> None:
        self._places = PlanPlaces(plan)
        self._stream = stream
        self._record = -1
        self._tenths = 0
        self._written: tuple[ShownEvent, ...] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def __call__(self, view: View) -> None:
        """Write what is new in this view."""
        self._write_events(view)
        if view.record not in (-1, self._record):
            self._write_record(view)
        self._record = view.record
        tenths = int(view.progress / _STEP + 1e-9)
        if tenths > self._tenths and view.state == "running":
            self._tenths = tenths
            remaining = f", about {clock_time(view.time_left)} left" if view.time_left is not None else ""
            self._write(view.time, f"{view.progress:.0%} done{remaining}")

    def _write_record(self, view: View) -> None:
        node = self._places.record(view.path)
        name = f" {node.name}" if node is not None else ""
        sweep = ", ".join(f"{key}={value}" for key, value in bindings(self._places, view.path).items())
        number = (
            f"{view.records_done + 1} of {view.records_total}" if view.records_total else str(view.record)
        )
        self._write(view.time, f"record {number}:{name}" + (f" at {sweep}" if sweep else ""))

    def _write_events(self, view: View) -> None:
        """Write changes of state, alarms, faults and notes, each once."""
        for happening in view.happenings:
            if any(happening is earlier for earlier in self._written):
                continue
            if happening.kind == "state":
                self._write(happening.time, happening.message + _reason(view, happening.message))
            else:
                self._write(happening.time, f"{happening.kind}: {happening.message}")
        self._written = view.happenings

    def _write(self, time: float, text: str) -> None:
        with suppress(OSError, ValueError):  # a closed pipe ends the lines, not the run
            self._stream.write(f"{stamp(time)}  {printable(text)}\n")
            self._stream.flush()


def _reason(view: View, state: str) -> str:
    """The reason for an abnormal state of the run."""
    return f": {view.message}" if view.message and state in ("failed", "aborted") else ""


def stamp(seconds: float) -> str:
    """A time as ``1:02:03``."""
    total = int(seconds)
    return f"{total // 3600}:{total % 3600 // 60:02d}:{total % 60:02d}"


def bindings(steps: PlanPlaces, path: str) -> dict[str, str]:
    """The sweep values and arguments at a step, as text."""
    values: dict[str, str] = {}
    for node in steps.chain(path):
        values.update(getattr(node, "bindings", {}))
    return values
