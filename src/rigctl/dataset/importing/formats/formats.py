"""The readable file formats, by extension."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.formats.foreign import open_in_process
from rigctl.dataset.importing.formats.long_format import is_long, open_long
from rigctl.dataset.importing.formats.table import Source
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.plugins import load_plugin, plugin_names

#: opens a file, given its path and the caller's options
Opener = Callable[[Path, Options], Source]

#: group of the entry points of other packages: by extension, an `Opener`
ENTRY_POINTS: Final = "rigctl.importers"
_HERE: Final = "rigctl.dataset.importing.formats"
#: module and function, imported when needed
OPENERS: Final[Mapping[str, tuple[str, str]]] = {
    ".csv": ("csv_file", "open_csv"),
    ".tsv": ("csv_file", "open_csv"),
    ".txt": ("csv_file", "open_csv"),
    ".csv.gz": ("csv_file", "open_csv"),
    ".dat": ("csv_file", "open_csv"),
    ".lvm": ("csv_file", "open_csv"),
    ".asc": ("csv_file", "open_csv"),
    ".xlsx": ("xlsx_file", "open_xlsx"),
    ".xlsm": ("xlsx_file", "open_xlsx"),
    ".parquet": ("parquet_file", "open_parquet_file"),
    ".tdms": ("tdms_file", "open_tdms"),
    ".mf4": ("mdf_file", "open_mdf"),
    ".mdf": ("mdf_file", "open_mdf"),
    ".mat": ("mat_file", "open_mat"),
}
#: formats whose readers can crash or hang on a damaged file
_APART: Final = ("tdms_file", "mdf_file", "mat_file", "xlsx_file")
#: whether those are read in a separate process; tests of a reader itself may disable this
isolated = True


def open_source(path: Path, options: Options) -> Source:
    """Open a file of measurements.

    Raises
    ------
    RigctlError
        the kind of file is unknown, its reader is not installed, or the file cannot be read.
    """
    source = _open(path, options)
    if not is_long(source, options):
        return source
    names = ((heading.name, heading.unit) for heading in source.headings)
    return open_long(source, with_time_column(names, options))


def _open(path: Path, options: Options) -> Source:
    ending = ending_of(path)
    if path.exists() and not path.is_file() and not path.is_dir():  # reading it might never end
        raise RigctlError("cannot read the file: it is a pipe or a device", where=Location(path))
    if ending not in OPENERS:
        installed: Opener = load_plugin(ENTRY_POINTS, ending)
        return installed(path, options)
    module, function = OPENERS[ending]
    if module in _APART and isolated:
        return open_in_process(path, options, f"{_HERE}.{module}", function)
    opener = cast("Opener", getattr(import_module(f"{_HERE}.{module}"), function))
    return opener(path, options)


def ending_of(path: Path) -> str:
    """Return the extension of a file that gives its format.

    Raises
    ------
    RigctlError
        the format cannot be read.
    """
    name = path.name.lower()
    for ending in sorted(OPENERS, key=len, reverse=True):
        if name.endswith(ending):
            return ending
    installed = plugin_names(ENTRY_POINTS)
    for ending in sorted(installed, key=len, reverse=True):
        if name.endswith(ending):
            return ending
    expected = f"a name that ends in {', '.join((*OPENERS, *installed))}"
    hint = "Save the spreadsheet as XLSX or CSV" if name.endswith((".xls", ".ods")) else None
    raise RigctlError("unknown kind of file", value=path.name, expected=expected, hint=hint)


def stem_of(path: Path) -> str:
    """Return a file's name without the extension of its format."""
    return path.name[: -len(ending_of(path))]
