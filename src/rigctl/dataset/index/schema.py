"""The tables of the index, and the views that a filter may name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from rigctl.dataset.run_fields import COLUMNS

#: version of the tables below; an index of another version is rebuilt
VERSION: Final = 4
#: columns of a run for filters: those of `rigctl runs sql`, and what its annotations count
RUN_COLUMNS: Final = (*COLUMNS, "notes", "excluded")
#: its folder, whether it is still open, its start as text, its order, the version of its file
INNER_COLUMNS: Final = ("shard", "open", "started_as", "second", "began", "number", "size", "mtime")
CHANNEL_COLUMNS: Final = ("run", "name", "unit", "kind", "low", "high")
VIEWS: Final = {"runs": RUN_COLUMNS, "channels": CHANNEL_COLUMNS}
#: oldest first, in the order of `rigctl.dataset.catalogue.run_folders`
ORDER: Final = "second, began, number, id"


def quoted(names: Iterable[str]) -> str:
    """Quote names for SQL, since some are SQL keywords."""
    return ", ".join(f'"{name}"' for name in names)


#: contains no value from a user
TABLES: Final = f"""
CREATE TABLE shard (name TEXT PRIMARY KEY, mtime INTEGER) WITHOUT ROWID;
CREATE TABLE run (
    key INTEGER PRIMARY KEY, {quoted((*RUN_COLUMNS, *INNER_COLUMNS))}
);
CREATE UNIQUE INDEX run_place ON run (shard, id);
CREATE INDEX run_order ON run ({ORDER});
CREATE INDEX run_id ON run (id);
CREATE INDEX run_open ON run (shard, id) WHERE open;
CREATE TABLE channel_name (key INTEGER PRIMARY KEY, name TEXT, unit TEXT, kind TEXT,
    UNIQUE (name, unit, kind));
CREATE TABLE channel (
    name INTEGER, run INTEGER, low REAL, high REAL, PRIMARY KEY (name, run)
) WITHOUT ROWID;
CREATE VIEW runs AS SELECT {quoted(RUN_COLUMNS)} FROM run;
CREATE VIEW channels AS
    SELECT run.id AS run, channel_name.name, unit, kind, low, high
    FROM channel_name JOIN channel ON channel.name = channel_name.key JOIN run ON run.key = channel.run;
PRAGMA user_version = {VERSION};
"""  # noqa: S608
