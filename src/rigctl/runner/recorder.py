"""The destination of a run's samples and events: a `RunWriter`, or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rigctl.plan.measured import MeasuredValue


class Recorder(Protocol):
    """What the runner requires of a `rigctl.dataset.RunWriter`."""

    @property
    def id(self) -> str:
        """The run's id."""
        ...

    @property
    def folder(self) -> Path | None:
        """The run's folder; None if nothing is kept."""
        ...

    @property
    def record(self) -> int:
        """Index of the open record; −1 between records."""
        ...

    def append(self, row: Sequence[float]) -> None:
        """Keep one sample."""
        ...

    def event(self, time: float, kind: str, **fields: Any) -> None:
        """Keep an event."""
        ...

    def open_record(
        self, time: float, name: str, sweep: Mapping[str, tuple[float, str]], path: str, rate: float
    ) -> int:
        """Begin a record."""
        ...

    def measure(self, value: MeasuredValue) -> None:
        """Keep a value."""
        ...

    def close_record(self, time: float, outcome: str, missing: float = 0.0) -> None:
        """End the open record, which lacks the share `missing` of its samples or of a channel's readings."""
        ...

    def warnings(self) -> Sequence[str]:
        """Warnings about the disk since the last call."""
        ...

    def close(self, status: str, reason: str | None = None, unconfirmed: str | None = None) -> Path | None:
        """End the run; `unconfirmed` names the outputs that may still be on."""
        ...


class Unrecorded:
    """Keeps nothing: for moving the bench by hand and for monitoring it.

    Parameters
    ----------
    on_event: called with every event.
    """

    id = ""
    folder = None
    record = -1

    def __init__(self, on_event: Callable[[float, str, Mapping[str, Any]], None]) -> None:
        self._on_event = on_event

    def append(self, row: Sequence[float]) -> None:
        """Forget a sample."""

    def event(self, time: float, kind: str, **fields: Any) -> None:
        """Pass an event on."""
        self._on_event(time, kind, fields)

    def open_record(
        self, time: float, name: str, sweep: Mapping[str, tuple[float, str]], path: str, rate: float
    ) -> int:
        """There are no records here."""
        return -1

    def measure(self, value: MeasuredValue) -> None:
        """Forget a value."""

    def close_record(self, time: float, outcome: str, missing: float = 0.0) -> None:
        """There are no records here."""

    def warnings(self) -> Sequence[str]:
        """There is no disk here."""
        return ()

    def close(self, status: str, reason: str | None = None, unconfirmed: str | None = None) -> None:
        """Nothing to close."""
