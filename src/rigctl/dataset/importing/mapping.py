"""How one logger's files are read, kept in a YAML file so that the next one needs no thought."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel, ConfigDict, Field

from rigctl.dataset.importing.columns import read_mapping
from rigctl.dataset.importing.dialect import checked_delimiter
from rigctl.dataset.importing.options import DateOrder, Options, TimePolicy
from rigctl.errors import Location, RigctlError

#: the fields of a mapping that are no mappings or lists themselves
_PLAIN: Final = ("dates", "zone", "times", "split", "resample", "encoding", "delimiter", "decimal")


class ImportMapping(BaseModel):
    """How files are read that do not say so themselves; what is left out is found out or asked."""

    model_config = ConfigDict(extra="forbid")

    columns: dict[str, str] = Field(
        default_factory=dict, description="ours by theirs, with the unit: 'Druck: supply_pressure [bar]'"
    )
    missing: list[str | float] = Field(default_factory=list, description="further marks of missing values")
    dates: DateOrder | None = Field(default=None, description="which number of a date is the day")
    zone: str | None = Field(default=None, description="time zone of times that name none: Europe/Berlin")
    times: TimePolicy = Field(default="refuse", description="what becomes of times that do not go on")
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

    def options(self) -> Options:
        """The same as the importer takes it.

        Raises
        ------
        RigctlError
            a column or a delimiter is none.
        """
        checked_delimiter(self.delimiter)
        pairs = [f"{theirs}={ours}" for theirs, ours in self.columns.items()]
        columns = read_mapping(pairs)
        return Options(
            columns=columns,
            may_lack=frozenset(columns),
            missing=tuple(_text(mark) for mark in self.missing),
            assume={name: _text(value) for name, value in self.assume.items()},
            **{name: getattr(self, name) for name in _PLAIN},
        )


def _text(written: str | float) -> str:
    return written if isinstance(written, str) else f"{written:.15g}"


def load_mapping(path: Path) -> Options:
    """Read a saved mapping.

    Raises
    ------
    RigctlError
        the file cannot be read, or something in it is wrong; with its place.
    """
    from rigctl.files.validate import validate
    from rigctl.files.yaml import read_document

    document = read_document(path)
    if not isinstance(document.data, Mapping):
        raise RigctlError("not a mapping", expected="columns, missing, dates, …", where=document.locate())
    found = validate(document, ImportMapping)
    try:
        return found.options()
    except RigctlError as problem:
        raise problem.at(document.locate()) from None


def save_mapping(path: Path, options: Options) -> None:
    """Write a mapping that `load_mapping` reads; a file that is there already must say the same.

    Raises
    ------
    RigctlError
        the file is there already, or cannot be written.
    """
    from rigctl.files.write import write_text

    if path.exists():
        try:
            same = _entries(load_mapping(path)) == _entries(options)
        except RigctlError:
            same = False
        if same:
            return
        raise RigctlError(
            "the file is there already, and says something else",
            where=Location(path),
            hint="Name another one, or delete it first",
        )
    lines = ["# how files of one logger are read: rigctl import FILE --mapping " + path.name]
    for name, value in _entries(options).items():
        if isinstance(value, Mapping):
            lines.append(f"{name}:")
            lines += [f"  {_quoted(key)}: {_quoted(text)}" for key, text in value.items()]
        elif isinstance(value, tuple):
            lines.append(f"{name}: [{', '.join(_quoted(text) for text in value)}]")
        else:
            lines.append(f"{name}: {_quoted(value)}")
    write_text(path, "\n".join(lines) + "\n")


def _entries(options: Options) -> dict[str, Any]:
    """What an option says that is not what goes without saying."""
    usual = Options()
    return {
        name: getattr(options, name)
        for name in ImportMapping.model_fields
        if getattr(options, name) not in (None, {}, ()) and getattr(options, name) != getattr(usual, name)
    }


def _quoted(text: object) -> str:
    """A text as YAML takes it for one, whatever stands in it."""
    import json

    return json.dumps(str(text), ensure_ascii=False)
