"""A table without time: one row is one observation, at its own condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.columns import Assigned
from rigctl.dataset.importing.table import Fault, RawTable
from rigctl.rig.layout import Layout
from rigctl.units import parse_unit

if TYPE_CHECKING:
    from rigctl.dataset.writer import RunWriter
    from rigctl.rig import Rig

#: temperatures and pressures say where something was observed
_CONDITIONS: Final = ("K", "Pa")


@dataclass(frozen=True)
class Observations:
    """Rows that are ready to be written: a record without samples each."""

    table: RawTable
    columns: Sequence[Assigned]
    layout: Layout
    faults: Sequence[Fault]

    @property
    def rows(self) -> int:
        """Number of observations."""
        return len(self.table.lines)

    def write(self, writer: RunWriter, name: str) -> int:
        """Write all of them; returns their number.

        Commands, temperatures and pressures are the record's sweep, everything else its measures. A missing
        value is left out.
        """
        for row in range(self.rows):
            sweep: dict[str, tuple[float, str]] = {}
            measures: list[tuple[Assigned, float]] = []
            for column in self.columns:
                written = float(self.table.columns[column.place][row])
                if column.unit is None or written != written:  # noqa: PLR0124 - NaN: missing
                    continue
                value = column.unit.to_si(written, difference=column.difference)
                if _is_condition(column):
                    sweep[column.name] = (value, column.shown)
                else:
                    measures.append((column, value))
            writer.open_record(0.0, name, sweep, f"line {self.table.lines[row]}", 0.0)
            for column, value in measures:
                writer.measure(column.name, value, column.shown, difference=column.difference)
            writer.close_record(0.0, "complete")
        return self.rows


def take_observations(table: RawTable, assigned: Sequence[Assigned], rig: Rig) -> Observations:
    """Turn a table without ``time`` into observations."""
    del rig  # the names have been compared with it already
    return Observations(table, assigned, Layout((), (), ("s", "1")), table.faults)


def _is_condition(column: Assigned) -> bool:
    dimension = parse_unit(column.shown).dimension
    return column.kind == "command" or any(dimension == parse_unit(unit).dimension for unit in _CONDITIONS)
