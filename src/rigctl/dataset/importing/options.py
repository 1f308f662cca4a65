"""How a file is to be read where it does not say so itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Literal, get_args

from rigctl.dataset.importing.headings import plain_name
from rigctl.errors import RigctlError, nearest_name

#: which of two numbers in a date is the day; ``iso`` refuses dates that do not begin with their year
DateOrder = Literal["iso", "day-first", "month-first"]
#: what becomes of a row whose time does not go on
TimePolicy = Literal["refuse", "drop", "spread", "split"]
DATE_ORDERS: Final[tuple[str, ...]] = get_args(DateOrder)
TIME_POLICIES: Final[tuple[str, ...]] = get_args(TimePolicy)


@dataclass(frozen=True)
class Options:
    """What the caller says of a file.

    Parameters
    ----------
    columns: ours by theirs: ``{"Druck": "supply_pressure [bar]", "comment": "-"}``.
    may_lack: which of `columns` a file need not have: those of a mapping for many files.
    missing: further marks of missing values, e.g. ``-9999``; one that is a number is compared as a number.
    dates: which number of a date is the day; when left out, a date that can be read in two ways is refused.
    zone: IANA name of the time zone of times that name none, e.g. ``Europe/Berlin``; UTC when left out.
    times: what becomes of rows whose time does not go on: all is refused; they are dropped; equal times are
        spread evenly up to the next one; a step back begins another record.
    split: what begins another record: ``command``, ``command:NAME``, ``gap`` or ``column:NAME``.
    resample: the common times of channels that have their own: a step (``10 ms``) or a column's name.
    assume: inputs that the file lacks and that stayed at a value: ``{"ambient": "21 degC"}``.
    encoding, delimiter, decimal: of a text file; found out when left out.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    may_lack: frozenset[str] = frozenset()
    missing: tuple[str, ...] = ()
    dates: DateOrder | None = None
    zone: str | None = None
    times: TimePolicy = "refuse"
    split: str | None = None
    resample: str | None = None
    assume: Mapping[str, str] = field(default_factory=dict)
    encoding: str | None = None
    delimiter: str | None = None
    decimal: str | None = None

    def over(self, other: Options) -> Options:
        """These where they say something, and `other` where they do not."""
        usual = Options()
        said = {
            item.name: value
            for item in fields(self)
            if (value := getattr(self, item.name)) != getattr(usual, item.name)
        }
        return replace(
            other,
            **{
                **said,
                "columns": {**other.columns, **self.columns},
                "may_lack": other.may_lack - set(self.columns),
                "assume": {**other.assume, **self.assume},
                "missing": tuple(dict.fromkeys((*other.missing, *self.missing))),
            },
        )

    def ours(self, name: str) -> str:
        """What a column of the file is called here, without its unit."""
        return plain_name(self.columns.get(name, name).partition("[")[0])

    def unit_of(self, name: str) -> str | None:
        """The unit that the caller gives a column of the file."""
        _, bracket, unit = self.columns.get(name, "").partition("[")
        return unit.partition("]")[0].strip() if bracket else None


#: what may be said in words, and the words
_CHOICES: Final[Mapping[str, tuple[str, ...]]] = {
    "dates": DATE_ORDERS,
    "times": TIME_POLICIES,
    "decimal": (".", ","),
}


def checked_choices(choices: Mapping[str, str | None]) -> dict[str, Any]:
    """Those of some options that are said, each with one of its words.

    Raises
    ------
    RigctlError
        a word is none of an option's.
    """
    said = {name: value for name, value in choices.items() if value is not None}
    for name, value in said.items():
        known = _CHOICES.get(name)
        if known is not None and value not in known:
            raise RigctlError(
                f"--{name}: no such choice",
                value=value,
                expected=f"one of {' '.join(known)}" if name == "decimal" else f"one of {', '.join(known)}",
                nearest=nearest_name(value, known),
            )
    return said
