"""The columns of a sample, in order: determined by the rig file, and used by bench, runner and dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigctl.expressions import ValueType

#: columns that precede those of the rig in every run
TIME, RECORD = "time", "record"


@dataclass(frozen=True)
class Layout:
    """Names and display units of the columns of a sample.

    `differences` names the columns that contain temperature intervals, which are shown without offset.
    """

    channels: tuple[str, ...]
    commands: tuple[str, ...]
    units: tuple[str, ...]  #: one for each of `columns`
    differences: frozenset[str] = frozenset()

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """``time`` and ``record``, the channels, the commands."""
        return (TIME, RECORD, *self.channels, *self.commands)

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """The names for conditions, in the order of ``Sample.values + Sample.commands``."""
        return (*self.channels, *self.commands)

    def unit(self, column: str) -> str:
        """Return the display unit of a column; "1" for plain numbers."""
        return self.units[self.columns.index(column)]

    def types(self) -> Mapping[str, ValueType]:
        """The type of each channel and command, for checking expressions."""
        from rigctl.expressions import type_of_unit

        return {
            name: type_of_unit(self.unit(name), difference=name in self.differences) for name in self.signals
        }
