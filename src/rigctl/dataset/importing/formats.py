"""Which files can be read, by the end of their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from rigctl.dataset.importing.foreign import open_apart
from rigctl.dataset.importing.long_format import is_long, open_long
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.table import Source
from rigctl.errors import RigctlError

#: what opens a file: its path, and what the caller says of it
Opener = Callable[[Path, Options], Source]

_HERE: Final = "rigctl.dataset.importing"
#: module and function, imported when a file asks for them
OPENERS: Final[Mapping[str, tuple[str, str]]] = {
    ".csv": ("csv_file", "open_csv"),
    ".tsv": ("csv_file", "open_csv"),
    ".txt": ("csv_file", "open_csv"),
    ".csv.gz": ("csv_file", "open_csv"),
    ".xlsx": ("xlsx_file", "open_xlsx"),
    ".xlsm": ("xlsx_file", "open_xlsx"),
    ".parquet": ("parquet_file", "open_parquet_file"),
    ".tdms": ("tdms_file", "open_tdms"),
    ".mf4": ("mdf_file", "open_mdf"),
    ".mdf": ("mdf_file", "open_mdf"),
    ".mat": ("mat_file", "open_mat"),
}
#: formats whose readers can crash, or never end, over a damaged file
_APART: Final = ("tdms_file", "mdf_file", "mat_file", "xlsx_file")
#: whether those are read in a process of their own; a test of a reader itself may do without
isolated = True


def open_source(path: Path, options: Options) -> Source:
    """Open a file of measurements.

    Raises
    ------
    RigctlError
        the kind of file is unknown, what reads it is not installed, or the file cannot be read.
    """
    source = _open(path, options)
    return open_long(source, options) if is_long(source, options) else source


def _open(path: Path, options: Options) -> Source:
    module, function = OPENERS[ending_of(path)]
    if module in _APART and isolated:
        return open_apart(path, options, f"{_HERE}.{module}", function)
    opener = cast("Opener", getattr(import_module(f"{_HERE}.{module}"), function))
    return opener(path, options)


def ending_of(path: Path) -> str:
    """The end of a file's name that says its kind.

    Raises
    ------
    RigctlError
        it is none that can be read.
    """
    name = path.name.lower()
    for ending in sorted(OPENERS, key=len, reverse=True):
        if name.endswith(ending):
            return ending
    expected = f"a name that ends in {', '.join(OPENERS)}"
    hint = "Save the spreadsheet as XLSX or CSV" if name.endswith((".xls", ".ods")) else None
    raise RigctlError("unknown kind of file", value=path.name, expected=expected, hint=hint)


def stem_of(path: Path) -> str:
    """A file's name without what says its kind."""
    return path.name[: -len(ending_of(path))]
