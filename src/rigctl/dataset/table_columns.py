"""The columns of a run's tables that everything relies on, in files that are not trusted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.dataset.parquet import open_parquet
from rigctl.dataset.recording import records_file, samples_file
from rigctl.errors import ExitCode, Location, RigctlError

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from rigctl.dataset.storage.store import StoredFile

_NUMBER: Final = "numbers"
_WHOLE: Final = "whole numbers"
_TEXT: Final = "texts"
#: files of a run, and what the columns are that all of them have
_COLUMNS: Final[Mapping[str, Mapping[str, str]]] = {
    samples_file.NAME: {"time": _NUMBER, "record": _WHOLE},
    records_file.RECORDS: {
        "record": _WHOLE,
        **dict.fromkeys(("rate", "start", "end"), _NUMBER),
        **dict.fromkeys(("name", "path", "outcome", "excluded"), _TEXT),
    },
    records_file.EVENTS: {
        "time": _NUMBER,
        "record": _WHOLE,
        **dict.fromkeys(("kind", "path", "message", "data"), _TEXT),
    },
}


@contextmanager
def open_table(path: Path | StoredFile) -> Iterator[pq.ParquetFile]:
    """Open a table of a run for reading.

    Raises
    ------
    RigctlError
        as `open_parquet`, or as `require_columns`.
    """
    with open_parquet(path) as file:
        require_columns(path, file.schema_arrow)
        yield file


def require_columns(path: Path | StoredFile, schema: pa.Schema) -> None:
    """Refuse a table that lacks one of its columns, or has something else in one; samples are numbers.

    Raises
    ------
    RigctlError
        names the column.
    """
    known = _COLUMNS[path.name]
    for name, kind in known.items():
        if len(schema.get_all_field_indices(name)) != 1 or not _is(schema.field(name).type, kind):
            raise _damaged(path, f"it needs one column '{name}' of {kind}")
    if path.name == samples_file.NAME:
        for field in schema:
            if not _is(field.type, _NUMBER):
                raise _damaged(path, f"column '{field.name}' is not of numbers")


@contextmanager
def event_data(path: Path | StoredFile) -> Iterator[None]:
    """Report events whose data cannot be read as such: they are JSON, with fields that depend on the event.

    Raises
    ------
    RigctlError
        a field is missing, or is not what rigctl writes there.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as problem:
        raise _damaged(path, f"the data of an event are not what rigctl writes there: {problem}") from problem


def _is(kind: pa.DataType, wanted: str) -> bool:
    from pyarrow import types

    if wanted == _TEXT:
        return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_null(kind))
    whole = types.is_integer(kind) and not types.is_uint64(kind)
    return bool(whole or (wanted == _NUMBER and types.is_floating(kind)))


def _damaged(path: Path | StoredFile, what: str) -> RigctlError:
    return RigctlError(
        f"the file is damaged: {what}",
        where=Location(path if isinstance(path, Path) else str(path)),
        exit_code=ExitCode.FAILED,
    )
