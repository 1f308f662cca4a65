"""Import options, for what a file does not specify."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Literal, get_args

from rigctl.dataset.importing.cells.headings import plain_name
from rigctl.dataset.importing.cells.numbers import read_number
from rigctl.errors import RigctlError, nearest_name

#: which of two numbers in a date is the day; ``iso`` requires dates that begin with the year
DateOrder = Literal["iso", "day-first", "month-first"]
#: treatment of a row whose time does not increase
TimePolicy = Literal["refuse", "drop", "spread", "split"]
DATE_ORDERS: Final[tuple[str, ...]] = get_args(DateOrder)
TIME_POLICIES: Final[tuple[str, ...]] = get_args(TimePolicy)


@dataclass(frozen=True)
class Options:
    """The caller's import options.

    Parameters
    ----------
    columns: ours by theirs: ``{"Druck": "supply_pressure [bar]", "comment": "-"}``.
    may_lack: those of `columns` that a file may lack, such as those of a mapping for many files.
    missing: further marks of missing values, e.g. ``-1``; one that is a number is compared as a number;
        ``none``: no number marks a missing value by itself.
    dates: which number of a date is the day; if omitted, an ambiguous date is refused.
    zone: IANA name of the time zone of times without one, e.g. ``Europe/Berlin``; UTC if omitted.
    times: treatment of rows whose time does not increase: refuse the file, as without it; drop them; spread
        equal times evenly up to the next one; begin another record at a step back.
    split: what begins another record: ``command``, ``command:NAME``, ``gap`` or ``column:NAME``.
    resample: the common times of channels with separate times: a step (``10 ms``) or a column's name.
    assume: constant inputs that the file lacks: ``{"ambient": "21 degC"}``.
    encoding, delimiter, decimal: of a text file; detected if omitted.
    heading: line of the heading in a text file or on a sheet, from 1; 0 if there is none; found if omitted.
    own: names of the bench's channels and actuators, none of which is the time.
    log_format: the file from which options were taken that the caller has not given; None without one.
    written_for: of the columns taken from it, the unit in the heading that it was written for, "" for none.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    may_lack: frozenset[str] = frozenset()
    missing: tuple[str, ...] = ()
    dates: DateOrder | None = None
    zone: str | None = None
    times: TimePolicy | None = None
    split: str | None = None
    resample: str | None = None
    assume: Mapping[str, str] = field(default_factory=dict)
    encoding: str | None = None
    delimiter: str | None = None
    decimal: str | None = None
    heading: int | None = None
    own: frozenset[str] = frozenset()
    log_format: str | None = None
    written_for: Mapping[str, str] = field(default_factory=dict)

    def over(self, other: Options) -> Options:
        """Return these options, with those of `other` where they are not set."""
        usual = Options()
        changes = {
            item.name: value
            for item in fields(self)
            if (value := getattr(self, item.name)) != getattr(usual, item.name)
        }
        return replace(
            other,
            **{
                **changes,
                "columns": {**other.columns, **self.columns},
                "may_lack": other.may_lack - set(self.columns),
                "written_for": {
                    name: unit for name, unit in other.written_for.items() if name not in self.columns
                },
                "assume": {**other.assume, **self.assume},
                "missing": tuple(dict.fromkeys((*other.missing, *self.missing))),
            },
        )

    @property
    def time_policy(self) -> TimePolicy:
        """The treatment of rows whose time does not increase."""
        return self.times or "refuse"

    @property
    def missing_numbers(self) -> tuple[float, ...]:
        """The marks of missing values that are numbers."""
        values = (read_number(text, ".", ()) for text in self.missing)
        return tuple(value for value in values if value is not None)

    def ours(self, name: str) -> str:
        """Return our name of a column, without its unit."""
        return plain_name(self.columns.get(name, name).partition("[")[0])

    def unit_of(self, name: str) -> str | None:
        """Return the unit given by the caller for a column."""
        _, bracket, unit = self.columns.get(name, "").partition("[")
        return unit.partition("]")[0].strip() if bracket else None


#: options with a fixed set of values
_CHOICES: Final[Mapping[str, tuple[str, ...]]] = {
    "dates": DATE_ORDERS,
    "times": TIME_POLICIES,
    "decimal": (".", ","),
}


def checked_choices(choices: Mapping[str, str | None]) -> dict[str, Any]:
    """Return the options that are set, each with a valid value.

    Raises
    ------
    RigctlError
        a value is not allowed for its option.
    """
    values = {name: value for name, value in choices.items() if value is not None}
    for name, value in values.items():
        known = _CHOICES.get(name)
        if known is not None and value not in known:
            raise RigctlError(
                f"--{name}: no such choice",
                value=value,
                expected=f"one of {' '.join(known)}" if name == "decimal" else f"one of {', '.join(known)}",
                nearest=nearest_name(value, known),
            )
    return values
