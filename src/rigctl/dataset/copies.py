"""Runs that hold the same measurements: counted twice, everything would seem surer than it is."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Sequence

from rigctl.dataset.run import Run


def without_copies(runs: Sequence[Run]) -> tuple[list[Run], list[tuple[Run, Run]]]:
    """The runs, each measurement once; and the copies, each with the run that is kept for it.

    Of copies the last is kept: who imports a file again has seen a reason. Copies are imports of the same
    file with the same samples, and runs otherwise with the same samples, times to the last bit.
    """
    last: dict[Hashable, Run] = {}
    for run in runs:
        last[_content(run)] = run
    kept = [run for run in runs if last[_content(run)] is run]
    return kept, [(run, last[_content(run)]) for run in runs if last[_content(run)] is not run]


def _content(run: Run) -> Hashable:
    """What two runs with the same measurements have in common."""
    info = run.info
    imported = info.get("source") == "import"
    file = info.get("backend", {}).get("sha256") if imported else ""
    digest = info.get("files", {}).get("samples.parquet", {}).get("sha256") if info.get("rows") else ""
    if not (digest or file):
        return run.id  # nothing says that it is a copy
    return digest, file, str(info.get("layout")), info.get("records"), "" if digest else _values(run)


def _values(run: Run) -> str:
    """A digest of the numbers of a table's rows: another sheet of one file has others."""
    import pyarrow.types as kinds

    table, found = run.table("records"), hashlib.sha256()
    for name, column in zip(table.column_names, table.columns, strict=True):
        if kinds.is_floating(column.type):
            found.update(f"{name}: {column.to_pylist()}".encode())
    return found.hexdigest()
