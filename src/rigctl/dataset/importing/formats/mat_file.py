"""MATLAB's MAT files up to version 7: vectors, structures of vectors, and arrays of such structures.

Each structure is a record; units are texts in a structure ``units`` with the same field names, beside the
vectors or in the structure. Nothing in a file is ever executed: functions and objects are reported and left
out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.cells.headings import split_heading, unit_of
from rigctl.dataset.importing.formats.groups import (
    Column,
    Group,
    GroupedFile,
    as_numbers,
    clear_errors,
    common_length,
    is_text,
    open_groups,
)
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: beginning of a file of version 7.3, which is HDF5
_NEWEST: Final = b"MATLAB 7.3 MAT-file"
#: fields of a structure that name it
_NAMES: Final = ("name", "label")


@dataclass
class _Found:
    """The groups found in a file, and the remarks on the rest."""

    groups: list[Group] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def open_mat(path: Path, options: Options) -> GroupedFile:
    """Read a MAT file.

    Raises
    ------
    RigctlError
        the file cannot be read, is of version 7.3, or contains no table.
    """
    content = _Found()
    variables = _load(path)
    units = _units(variables.pop("units", None))
    vectors: dict[str, Any] = {}
    for name, value in variables.items():
        if _is_structure(value):
            _take_structures(path, name, value, units, options, content)
        else:
            vectors[name] = value
    if not content.groups:
        content.groups += _group(path, "", vectors, units, options, content.remarks)
    else:
        content.remarks += [f"variable '{name}' is not a structure and is left out" for name in vectors]
    if not content.groups:
        raise RigctlError(
            "; ".join(["nothing in it is a table", *content.remarks]),
            expected="vectors of equal length, or structures of them",
            where=Location(path),
        )
    read = open_groups(path, lambda: nullcontext(content.groups), options, noun="structure")
    return replace(read, remarks=(*read.remarks, *content.remarks))


def _load(path: Path) -> dict[str, Any]:
    """Load the variables of a file, one-element and empty dimensions removed."""
    from scipy.io import loadmat

    with clear_errors(path, "MAT"):
        with open(path, "rb", opener=regular) as file:
            if file.read(len(_NEWEST)) == _NEWEST:
                raise RigctlError(
                    "the file is of version 7.3, which cannot be read",
                    hint="Save it as version 7: save('file.mat', '-struct', 'data', '-v7')",
                    where=Location(path),
                )
        loaded = loadmat(path, squeeze_me=True, struct_as_record=False)
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


def _is_structure(value: Any) -> bool:
    """Return whether this is a structure or an array of structures."""
    return bool(_structures(value))


def _structures(value: Any) -> list[Any]:
    from scipy.io.matlab import mat_struct

    if isinstance(value, mat_struct):
        return [value]
    if getattr(getattr(value, "dtype", None), "kind", "") == "O" and value.ndim == 1:
        structures = [item for item in value if isinstance(item, mat_struct)]
        return structures if len(structures) == len(value) else []
    return []


def _fields(structure: Any) -> dict[str, Any]:
    return {name: getattr(structure, name) for name in structure._fieldnames}  # noqa: SLF001 - its only list


def _units(value: Any) -> dict[str, str]:
    """Return the texts of a structure ``units``."""
    structures = _structures(value)
    fields = _fields(structures[0]) if len(structures) == 1 else {}
    return {name: unit for name, unit in fields.items() if isinstance(unit, str)}


def _take_structures(
    path: Path, name: str, value: Any, units: Mapping[str, str], options: Options, content: _Found
) -> None:
    """Add each structure of a variable as a group."""
    several = _structures(value)
    for number, structure in enumerate(several, start=1):
        fields = _fields(structure)
        own_units = {**units, **_units(fields.pop("units", None))}
        named = next((fields.pop(key) for key in _NAMES if isinstance(fields.get(key), str)), "")
        label = named or (f"{name}({number})" if len(several) > 1 else name)
        if any(group.name == label for group in content.groups):
            label = f"{label} ({number})"
        if "signals" in fields and "time" in fields:
            fields = {"time": fields["time"], **_signals(fields["signals"])}
        content.groups += _group(path, label, fields, own_units, options, content.remarks)


def _signals(value: Any) -> dict[str, Any]:
    """Return the signals of a Simulink "structure with time"."""
    signals: dict[str, Any] = {}
    for number, signal in enumerate(_structures(value), start=1):
        fields = _fields(signal)
        label = fields.get("label")
        name = label if isinstance(label, str) and label else f"signal_{number}"
        values: Any = fields.get("values")
        if getattr(values, "ndim", 0) == 2:
            signals |= {f"{name}_{index}": column for index, column in enumerate(values.T, start=1)}
        else:
            signals[name] = values
    return signals


def _group(
    path: Path,
    label: str,
    fields: Mapping[str, Any],
    units: Mapping[str, str],
    options: Options,
    remarks: list[str],
) -> Iterator[Group]:
    """Return the vectors among some fields as a group, with remarks on the omitted fields."""
    import numpy as np

    where = f"structure '{label}'" if label else "the file"
    vectors: dict[str, NDArray[Any]] = {}
    for name, value in fields.items():
        array = np.atleast_1d(np.asarray(value)) if not _is_structure(value) else None
        reason = _unusable(array, value)
        if reason is None and array is not None:
            vectors[name] = array
        elif reason:
            remarks.append(f"in {where}: '{name}' is {reason} and is left out")
    longest = max((len(array) for array in vectors.values()), default=0)
    for name in [name for name, array in vectors.items() if len(array) == 1 < longest]:
        remarks.append(f"in {where}: '{name}' is a single value and is left out")
        del vectors[name]
    if not vectors:
        return
    rows = common_length(path, where, {name: len(array) for name, array in vectors.items()}, options)
    columns = []
    for name, array in vectors.items():
        plain, unit = split_heading(name)
        columns.append(Column(plain or name, unit_of(units.get(name)) or unit, _reader(path, name, array)))
    yield Group(label, rows, tuple(columns))


def _unusable(array: NDArray[Any] | None, value: Any) -> str | None:
    """Return why a value is not a column: a text, empty if it has no data; None for a column."""
    if array is None:
        return "a structure in a structure"
    kind = type(value).__name__
    if kind in ("MatlabFunction", "MatlabOpaque", "MatlabObject"):
        return "a function or an object"
    if array.size == 0:
        return ""
    if array.ndim > 1:
        return f"a matrix of {' x '.join(str(size) for size in array.shape)}, whose columns have no names"
    if is_text(array):
        return None if array.size > 1 else "a text"
    return None if array.dtype.kind in "fiub" else "no numbers"


def _reader(path: Path, name: str, array: NDArray[Any]) -> Callable[[int, int], NDArray[Any]]:
    def read(start: int, stop: int) -> NDArray[Any]:
        part = array[start:stop]
        return part if is_text(part) else as_numbers(path, name, part)

    return read
