"""Detection of runs with the same measurements: counted twice, they would make every result too certain."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Sequence

from rigctl.dataset.run import Run


def without_copies(runs: Sequence[Run]) -> tuple[list[Run], list[tuple[Run, Run]]]:
    """Return the runs with each measurement once, and the copies with the run kept for each.

    The last copy is kept, as there was a reason to import the file again. Copies are imports of the same file
    with the same samples, and other runs whose samples, including the times, are identical to the last bit.
    """
    last: dict[Hashable, Run] = {}
    for run in runs:
        last[_content(run)] = run
    originals = [run for run in runs if last[_content(run)] is run]
    return originals, [(run, last[_content(run)]) for run in runs if last[_content(run)] is not run]


def _content(run: Run) -> Hashable:
    """Return a key that is the same for two runs with the same measurements."""
    info = run.info
    imported = info.get("source") == "import"
    file = info.get("backend", {}).get("sha256") if imported else ""
    digest = info.get("files", {}).get("samples.parquet", {}).get("sha256") if info.get("rows") else ""
    if not (digest or file):
        return run.id  # cannot be recognised as a copy
    return digest, file, str(info.get("layout")), info.get("records"), "" if digest else _values(run)


def _values(run: Run) -> str:
    """Return a digest of a table's numbers, which differ between two sheets of one file."""
    import pyarrow.types as kinds

    table, digest = run.table("records"), hashlib.sha256()
    for name, column in zip(table.column_names, table.columns, strict=True):
        if kinds.is_floating(column.type):
            digest.update(f"{name}: {column.to_pylist()}".encode())
    return digest.hexdigest()
