"""Import options for one logger's files, stored in a YAML file for reuse.

In: a file, or the options of an import. Out: the same options again. A mapping keeps the answers to what
the first import of an unknown logger asks; a rig file can name it as the form of its logs (`log_format`),
and `rigctl family new` writes one.

It also keeps the headings that it was written for, with their units (`written_for`): a unit that the user
gave belongs to such a heading, and a later file that states another unit is not read in that one. A file
may lack columns of a mapping; one that was typed for this file must be there.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel, ConfigDict, Field

from rigctl.dataset.importing.cells.headings import split_heading
from rigctl.dataset.importing.columns import read_mapping
from rigctl.dataset.importing.formats.dialect import checked_delimiter
from rigctl.dataset.importing.options import DateOrder, Options, TimePolicy
from rigctl.errors import Location, RigctlError
from rigctl.files.scalars import quoted

#: the scalar fields of a mapping
_PLAIN: Final = ("dates", "zone", "times", "split", "resample", "encoding", "delimiter", "decimal", "heading")


class ImportMapping(BaseModel):
    """Import options; what is omitted is detected, or the user is asked."""

    model_config = ConfigDict(extra="forbid")

    columns: dict[str, str] = Field(
        default_factory=dict, description="ours by theirs, with the unit: 'Druck: supply_pressure [bar]'"
    )
    missing: list[str | float] = Field(default_factory=list, description="further marks of missing values")
    dates: DateOrder | None = Field(default=None, description="which number of a date is the day")
    zone: str | None = Field(default=None, description="time zone of times that name none: Europe/Berlin")
    times: TimePolicy | None = Field(default=None, description="what becomes of times that do not go on")
    split: str | None = Field(default=None, description="what begins a record: command, gap or column:NAME")
    resample: str | None = Field(
        default=None, description="common times of channels with clocks of their own"
    )
    assume: dict[str, str | float] = Field(
        default_factory=dict, description="inputs that were not recorded and stayed at a value"
    )
    encoding: str | None = Field(default=None, description="of a text file, e.g. cp1252")
    delimiter: str | None = Field(default=None, description="between the cells")
    decimal: str | None = Field(default=None, description="the decimal sign, '.' or ','")

    heading: int | None = Field(
        default=None, ge=0, description="line of the heading in a text file or on a sheet; 0 without one"
    )

    def options(self) -> Options:
        """Return the mapping as options of the importer.

        Raises
        ------
        RigctlError
            a column or a delimiter is invalid.
        """
        checked_delimiter(self.delimiter)
        pairs = [f"{theirs}={ours}" for theirs, ours in self.columns.items()]
        columns = read_mapping(pairs)
        return Options(
            columns=columns,
            may_lack=frozenset(columns),
            written_for=dict(_written_for(theirs) for theirs in self.columns),
            missing=tuple(_text(mark) for mark in self.missing),
            assume={name: _text(value) for name, value in self.assume.items()},
            **{name: getattr(self, name) for name in _PLAIN},
        )


def _written_for(theirs: str) -> tuple[str, str]:
    """Return a column's name and the unit beside it: a heading as it was when the mapping was written."""
    name, unit = split_heading(theirs)
    return name or theirs, unit or ""


def _text(written: str | float) -> str:
    return written if isinstance(written, str) else f"{written:.15g}"


def load_mapping(path: Path) -> Options:
    """Read a saved mapping.

    Raises
    ------
    RigctlError
        the file cannot be read, or an entry is wrong; names its place.
    """
    from rigctl.files.validate import validate
    from rigctl.files.yaml import read_document

    document = read_document(path)
    if not isinstance(document.data, Mapping):
        raise RigctlError("not a mapping", expected="columns, missing, dates, …", where=document.locate())
    mapping = validate(document, ImportMapping)
    try:
        return mapping.options()
    except RigctlError as problem:
        raise problem.at(document.locate()) from None


def require_same_mapping(path: Path, options: Options) -> None:
    """Refuse a file that exists with another content than `save_mapping` would write.

    Raises
    ------
    RigctlError
        a different file exists.
    """
    if not path.exists():
        return
    try:
        same = _entries(load_mapping(path)) == _entries(options)
    except RigctlError:
        same = False
    if not same:
        raise RigctlError(
            "a different file exists already",
            where=Location(path),
            hint="Name another one, or delete it first",
        )


def save_mapping(path: Path, options: Options) -> None:
    """Write a mapping for `load_mapping`; an existing file must have the same content.

    Raises
    ------
    RigctlError
        a different file exists, or it cannot be written.
    """
    from rigctl.files.write import write_text

    require_same_mapping(path, options)
    if not path.exists():
        write_text(path, mapping_text(path.name, options))


def mapping_text(file: str, options: Options) -> str:
    """Return the text of a mapping for `load_mapping` in a file called `file`."""
    lines = ["# how files of one logger are read: rigctl import FILE --mapping " + file]
    for name, value in _entries(options).items():
        if isinstance(value, Mapping):
            lines.append(f"{name}:")
            lines += [f"  {quoted(key)}: {quoted(text)}" for key, text in value.items()]
        elif isinstance(value, tuple):
            lines.append(f"{name}: [{', '.join(quoted(text) for text in value)}]")
        else:
            lines.append(f"{name}: {value if isinstance(value, int) else quoted(value)}")
    return "\n".join(lines) + "\n"


def _entries(options: Options) -> dict[str, Any]:
    """Return the options that differ from their defaults."""
    usual = Options()
    return {
        name: getattr(options, name)
        for name in ImportMapping.model_fields
        if getattr(options, name) not in (None, {}, ()) and getattr(options, name) != getattr(usual, name)
    }
