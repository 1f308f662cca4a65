"""Opens and replaces Parquet files, with clear errors for damage and a full disk."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkstemp
from typing import TYPE_CHECKING, Any

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.write import replace_file, write_error
from rigctl.printable import shown_path

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from numpy.typing import NDArray

    from rigctl.dataset.storage.store import StoredFile


@contextmanager
def open_parquet(path: Path | StoredFile) -> Iterator[pq.ParquetFile]:
    """Open a local or stored Parquet file for reading.

    Raises
    ------
    RigctlError
        the file is missing, or damaged, as detected here or while it is read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not isinstance(path, Path):
        with path.open() as source:
            try:
                with pq.ParquetFile(source) as file:
                    yield file
            except (OSError, pa.ArrowException) as problem:
                raise RigctlError(
                    f"the object in storage cannot be read: {problem}",
                    value=shown_path(path),
                    exit_code=ExitCode.FAILED,
                ) from problem
        return
    try:
        # one look at the path and a plain file: an index opens a hundred thousand of them
        if not stat.S_ISREG(os.stat(path).st_mode):  # noqa: PTH116
            raise OSError("a folder, a pipe or a device")
        with pa.OSFile(os.fspath(path)) as source, pq.ParquetFile(source) as file:
            yield file
    except FileNotFoundError as problem:
        raise RigctlError("the file is missing", where=Location(path), exit_code=ExitCode.FAILED) from problem
    except (OSError, pa.ArrowException) as problem:
        raise RigctlError(
            "the file is damaged",
            hint=f"'rigctl runs verify {path.parent.name}' says what can be saved",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        ) from problem


def numbers(column: pa.ChunkedArray) -> NDArray[Any]:
    """Return the values of a numeric column, NaN for nulls.

    ``column.to_numpy()`` does the same, but loads pandas first, which takes longer than reading a run.
    """
    import numpy as np
    import pyarrow as pa

    if column.null_count:
        column = column.cast(pa.float64()).fill_null(float("nan"))
    return np.concatenate([np.empty(0, column.type.to_pandas_dtype()), *map(np.from_dlpack, column.chunks)])


@contextmanager
def replace_with(path: Path) -> Iterator[Path]:
    """Provide a temporary file that replaces `path`, flushed to disk, if the block succeeds."""
    with write_error(path):
        handle, name = mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
        os.close(handle)
    draft = Path(name)
    try:
        yield draft
        with write_error(path):
            draft.chmod(0o644)
            with draft.open("rb+") as file:
                os.fsync(file.fileno())
            replace_file(draft, path)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a small table atomically: the old file stays until the new one is complete."""
    import pyarrow.parquet as pq

    with replace_with(path) as draft, write_error(path):
        pq.write_table(table, draft, compression="zstd")
