"""How `rigctl import` reads the log of a draft: the columns' names and units, and the form of the file."""

from __future__ import annotations

from dataclasses import replace

from rigctl.proposal.columns import Table


def column_pairs(table: Table) -> list[str]:
    """The columns as ``theirs=ours [unit]``, where the heading says it differently or not at all."""
    omitted = {column.theirs for column in table.columns if column.role == "left out"}
    keys = {column.key for column in table.columns if column.role == "left out"}
    renamed = [text for text in table.renamed if text.partition("=")[0] not in omitted | keys]
    return [*renamed, *(f"{theirs}=-" for theirs in sorted(omitted))]


def log_format_text(path: str, table: Table) -> str | None:
    """The text of the file `path` that ``log_format`` of a rig file names; None if the log needs none.

    It has what the user said and what the names and units of this log mean, but not how this log's times
    go on: that is no matter of later ones.
    """
    from rigctl.dataset.importing.mapping import mapping_text
    from rigctl.dataset.importing.options import Options

    pairs = (text.partition("=") for text in column_pairs(table))
    options = replace(table.options, columns={theirs: ours for theirs, _, ours in pairs})
    if table.path is None or options == Options():
        return None
    return mapping_text(path, options)
