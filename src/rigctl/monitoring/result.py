"""The findings of a survey."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from rigctl.model.measured.note import Note
from rigctl.monitoring.changed_effect import Named
from rigctl.monitoring.entries import DATE, Axis, Entry
from rigctl.monitoring.evaluation import Reading
from rigctl.monitoring.multiplicity import Change, Judged, Quantity, QuantitySeries
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Line:
    """One entry: its information, or why it has none; `index` its number among those that were read."""

    entry: Entry
    reading: Reading | None
    failed: str = ""
    index: int = -1


@dataclass(frozen=True)
class Survey:
    """The result of evaluating many runs with one model.

    Attributes
    ----------
    freed, held: parameters fitted in each run, and those common to all runs.
    axis: over which the runs are ordered.
    lines: every entry, in that order.
    judged: the series of every quantity, tested.
    named: what has changed.
    notes: remarks on the order.
    """

    model: str
    freed: tuple[str, ...]
    held: tuple[str, ...]
    axis: Axis
    lines: tuple[Line, ...] = field(repr=False)
    judged: Judged = field(repr=False)
    named: Named = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def changes(self) -> tuple[Change, ...]:
        """The significant changes."""
        return self.named.changes

    @property
    def read(self) -> tuple[Line, ...]:
        """The entries that could be read."""
        return tuple(line for line in self.lines if line.reading is not None)

    @property
    def failed(self) -> tuple[Line, ...]:
        """The entries that could not be read."""
        return tuple(line for line in self.lines if line.reading is None)

    @cached_property
    def data_notes(self) -> dict[Note, tuple[str, ...]]:
        """The remarks on the data, each with the labels of the entries to which it applies."""
        labels_by_note: dict[Note, list[str]] = {}
        for line in self.lines:
            for note in line.reading.notes if line.reading is not None else ():
                labels_by_note.setdefault(note, []).append(line.entry.label)
        return {note: tuple(labels) for note, labels in labels_by_note.items()}

    @property
    def verdict(self) -> Literal["changed", "no_change_seen", "cannot_tell"]:
        """Whether something has changed; ``cannot_tell`` if there are too few runs to show it."""
        if self.changes:
            return "changed"
        return "no_change_seen" if self.judged.enough else "cannot_tell"

    @property
    def statement(self) -> str:
        """The findings, in one or more sentences."""
        return worded(self, "survey.statement")

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return documented(self, "survey_document")

    def shown(self) -> tuple[QuantitySeries, ...]:
        """The series that are drawn: what has changed and every parameter, then the largest of the rest."""
        changed = {change.quantity.name: change.course for change in self.changes}
        rest = {one.course.quantity.name: one.course for one in self.judged.tested}
        rest |= {course.quantity.name: course for course in self.named.courses}
        parameters = {name: rest[name] for name in (*self.freed, *self.held)}
        return tuple({**changed, **parameters, **rest, **changed}.values())

    @staticmethod
    def in_unit(quantity: Quantity, si: float | None, *, difference: bool = False) -> float | None:
        """A value in the unit of its quantity; None if it is not finite."""
        if si is None or not math.isfinite(si):
            return None
        unit = parse_unit(quantity.unit)
        return si / unit.factor if difference else unit.from_si(si, difference=quantity.difference)

    def __repr__(self) -> str:
        """The findings, on one line."""
        return one_line(self, self.summary())

    def summary(self) -> str:
        """The findings, in words."""
        return self.statement

    def frame(self) -> pd.DataFrame:
        """One row for each run and quantity, in the unit of the quantity."""
        import pandas as pd

        rows = [
            {
                "run": line.entry.label,
                self.axis.name: line.entry.started if self.axis.name == DATE else line.entry.place,
                "quantity": course.quantity.name,
                "value": self.in_unit(course.quantity, float(course.values[line.index])),
                "std": self.in_unit(course.quantity, float(course.std[line.index]), difference=True),
                "unit": course.quantity.unit,
            }
            for course in self.shown()
            for line in self.read
        ]
        return pd.DataFrame(rows)

    def _repr_html_(self) -> str:
        """The statement and the values, as a notebook shows them."""
        return as_html(self.summary(), self.frame())
