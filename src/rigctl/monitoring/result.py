"""The findings of a survey, in words and as data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from rigctl.analysis.decision_levels import SURVEY_ALPHA
from rigctl.model.measured.note import Note
from rigctl.monitoring.changed_effect import Named
from rigctl.monitoring.entries import DATE, Axis, Entry
from rigctl.monitoring.evaluation import Reading
from rigctl.monitoring.multiplicity import Change, Judged, Quantity, QuantitySeries
from rigctl.notebook import as_html, one_line
from rigctl.units import parse_unit, show, with_uncertainty
from rigctl.wording import chance_text, number_of

if TYPE_CHECKING:
    import pandas as pd

#: largest number of step levels in a sentence
_LEVELS = 6
#: number of entries that a note names
_NAMED = 3
#: the nearest quantity is named if its p-value is below this, though it is no change
_NEAR = 0.1


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

    def note_text(self, note: Note) -> str:
        """A note on the data, with the entries to which it applies unless these are all."""
        labels = self.data_notes[note]
        if len(labels) == len(self.read):
            return note.text
        more = f" and {len(labels) - _NAMED} more" if len(labels) > _NAMED else ""
        return f"{note.text} ({', '.join(labels[:_NAMED])}{more})"

    @property
    def verdict(self) -> Literal["changed", "no_change_seen", "cannot_tell"]:
        """Whether something has changed; ``cannot_tell`` if there are too few runs to show it."""
        if self.changes:
            return "changed"
        return "no_change_seen" if self.judged.enough else "cannot_tell"

    @property
    def statement(self) -> str:
        """The findings, in one or more sentences."""
        count = len(self.read)
        tests = sum(one.found is not None for one in self.judged.tested)
        what = number_of(count, "run")
        if tests:  # otherwise it is the number of runs that is too small
            what += f", {number_of(tests, 'quantity', 'quantities')}"
        if self.changes:
            return ". ".join(self.sentence(change) for change in self.changes)
        if not self.judged.enough:
            return (
                f"These data cannot tell: {what}. With so few runs their scatter without a change is "
                "unknown, and no change can be distinguished from it"
            )
        nearest = self.judged.tested[0]
        text = f"No change is detected: {what}, none of which changes by more than the runs scatter"
        if nearest.p_value is not None and nearest.p_value < _NEAR:
            text += f"; {nearest.course.quantity.name} comes closest ({chance_text(nearest.p_value)})"
        return text

    def sentence(self, change: Change) -> str:
        """One change: what, from and to which value, since when, when first significant, and its p-value."""
        shape, lines = change.shape, self.read
        names = " or ".join([change.quantity.name, *change.alike[:4]])
        if len(change.alike) > 4:
            names += f" or one of {len(change.alike) - 4} others"
        before, after = self.amount(change.quantity, shape.before), self.amount(change.quantity, shape.after)
        verb = "grew" if shape.after > shape.before else "fell"
        verb = f"{verb} from {before} to {after}"
        if len(change.steps) > 1:
            levels = [self.amount(change.quantity, level) for level in change.levels[:_LEVELS]]
            more = f" and {len(change.levels) - _LEVELS} more" if len(change.levels) > _LEVELS else ""
            verb = f"changed in steps, {', '.join(levels)}{more}"
        since = lines[min(change.steps[0] if change.steps else shape.begins, len(lines) - 1)]
        first = lines[min(change.first_sure, len(lines)) - 1]
        text = (
            f"{names} {verb}, since {self.axis.text(since.entry)}, first significant at {first.entry.label} "
            f"({chance_text(change.p_value)})"
        )
        if change.alike:
            text += "; these runs cannot tell which of them"
        return text

    def between(self, change: Change) -> tuple[str, str]:
        """The earliest and the latest start of the change, in words."""
        lines = self.read
        early, late = max(change.shape.earliest - 1, 0), min(change.shape.latest, len(lines) - 1)
        return self.axis.text(lines[early].entry), self.axis.text(lines[late].entry)

    def amount(self, quantity: Quantity, si: float, std: float | None = None) -> str:
        """A value of a quantity in its unit."""
        unit = parse_unit(quantity.unit)
        value = unit.from_si(si, difference=quantity.difference)
        if std is None or not std > 0.0 or not math.isfinite(std):
            return show(si, quantity.unit, difference=quantity.difference, digits=3)
        return with_uncertainty(value, std / unit.factor, quantity.unit)

    def bare(self, quantity: Quantity, si: float, std: float) -> str:
        """A value with its standard deviation, without its unit; empty if a run does not determine it."""
        if not math.isfinite(si):
            return ""
        unit = parse_unit(quantity.unit)
        return with_uncertainty(
            unit.from_si(float(si), difference=quantity.difference), float(std) / unit.factor
        )

    def amount_difference(self, quantity: Quantity, si: float) -> str:
        """A scatter of a quantity in its unit."""
        return show(si, quantity.unit, difference=True, digits=2)

    def shown(self) -> tuple[QuantitySeries, ...]:
        """The series that are drawn: what has changed and every parameter, then the largest of the rest."""
        changed = {change.quantity.name: change.course for change in self.changes}
        rest = {one.course.quantity.name: one.course for one in self.judged.tested}
        rest |= {course.quantity.name: course for course in self.named.courses}
        parameters = {name: rest[name] for name in (*self.freed, *self.held)}
        return tuple({**changed, **parameters, **rest, **changed}.values())

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return {
            "model": self.model,
            "verdict": self.verdict,
            "statement": self.statement,
            "level": SURVEY_ALPHA,
            "over": self.axis.name,
            "over_unit": "s since 1970" if self.axis.name == DATE else self.axis.unit,
            "free": list(self.freed),
            "shared": list(self.held),
            "changes": [self._change(one) for one in self.changes],
            "diagnosis": self.named.verdict or None,
            "remarks": list(self.named.remarks),
            "quantities": [self._tested(k) for k in range(len(self.judged.tested))],
            "runs": [self._line(line) for line in self.lines],
            "notes": list(self.notes),
        }

    def _change(self, change: Change) -> dict[str, Any]:
        quantity, shape, lines = change.quantity, change.shape, self.read
        early, late = self.between(change)
        return {
            "quantity": quantity.name,
            "indistinguishable": list(change.alike),
            "kind": "steps" if len(change.steps) > 1 else shape.kind,
            "before": self._in_unit(quantity, shape.before),
            "before_std": self._in_unit(quantity, shape.before_std, difference=True),
            "after": self._in_unit(quantity, shape.after),
            "after_std": self._in_unit(quantity, shape.after_std, difference=True),
            "unit": quantity.unit,
            "levels": [self._in_unit(quantity, level) for level in change.levels],
            "since": lines[min(shape.begins, len(lines) - 1)].entry.label,
            "between": [early, late],
            "first_sure": lines[min(change.first_sure, len(lines)) - 1].entry.label,
            "p_value": change.p_value,
            "statement": self.sentence(change),
        }

    def _tested(self, index: int) -> dict[str, Any]:
        one = self.judged.tested[index]
        quantity = one.course.quantity
        read = self.read
        return {
            "name": quantity.name,
            "kind": quantity.kind,
            "unit": quantity.unit,
            "p_value": one.p_value,
            "between_runs": self._in_unit(quantity, one.between, difference=True),
            "neighbour_correlation": None if one.found is None else one.found.correlation,
            "apart": [read[k].entry.label for k in one.apart],
            "values": [self._in_unit(quantity, float(value)) for value in one.course.values],
            "std": [self._in_unit(quantity, float(std), difference=True) for std in one.course.std],
        }

    def _line(self, line: Line) -> dict[str, Any]:
        fields = {"run": line.entry.label, "started": line.entry.started, "over": line.entry.place}
        if line.reading is None:
            return fields | {"failed": line.failed}
        return fields | {
            "adequate": line.reading.adequate,
            "p_value": line.reading.p_value,
            "chi2_reduced": line.reading.chi2_reduced,
            "records": line.reading.records,
            "notes": list(map(str, line.reading.notes)),
        }

    def _in_unit(self, quantity: Quantity, si: float | None, *, difference: bool = False) -> float | None:
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
                "value": self._in_unit(course.quantity, float(course.values[line.index])),
                "std": self._in_unit(course.quantity, float(course.std[line.index]), difference=True),
                "unit": course.quantity.unit,
            }
            for course in self.shown()
            for line in self.read
        ]
        return pd.DataFrame(rows)

    def _repr_html_(self) -> str:
        """The statement and the values, as a notebook shows them."""
        return as_html(self.summary(), self.frame())
