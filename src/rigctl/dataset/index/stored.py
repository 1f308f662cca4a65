"""Updates an index from the runs in a storage.

One listing gives the length and version mark (ETag) of each ``run.json``; unchanged ones are not read again.
A storage without such marks is read each time.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Final

from rigctl.dataset.index.refresh import insert_channels, insert_rows, remove_rows, transaction
from rigctl.dataset.index.rows import DAMAGED, ChannelRange, Row, ranges_of, stored_row

if TYPE_CHECKING:
    from rigctl.dataset.storage.store import Store

logger = logging.getLogger(__name__)

#: runs requested per transaction: the loss by an interrupt
_BATCH: Final = 500
#: number of runs from which reading them is logged
_LONG: Final = 2000
#: threads that read samples, which wait for the network
_READERS: Final = 8


def refresh_stored(index: sqlite3.Connection, store: Store, *, channels: bool) -> None:
    """Update the index from the storage; unchanged runs are not read.

    Parameters
    ----------
    channels: whether the ranges of the channels are needed; they are stored once read.

    Raises
    ------
    RigctlError
        the storage does not respond, or refuses.
    """
    listed = store.states()
    known = {run_id: (size, tag) for run_id, size, tag in index.execute("SELECT id, size, mtime FROM run")}
    wanted = [run_id for run_id, state in listed.items() if not state[1] or known.get(run_id) != state]
    if len(wanted) >= _LONG:
        logger.warning("reading %d runs of %s for its index, once", len(wanted), store.address)
    for start in range(0, len(wanted), _BATCH):
        batch = {run_id: listed[run_id] for run_id in wanted[start : start + _BATCH]}
        rows = _read(store, batch)
        with transaction(index):
            remove_rows(index, [("", run_id) for run_id in batch])
            insert_rows(index, rows)
    if gone := known.keys() - listed.keys():
        with transaction(index):
            remove_rows(index, [("", run_id) for run_id in gone])
    if channels:
        _look_at_samples(index, store)


def _read(store: Store, batch: Mapping[str, tuple[int, str]]) -> list[Row]:
    """Return the rows of runs whose ``run.json`` has changed, without those removed meanwhile.

    A file whose length differs from the listing was replaced meanwhile or truncated in transit. It is stored
    without a mark, and read again the next time.
    """
    rows = []
    for run_id, (length, info) in store.infos(batch).items():
        size, tag = batch[run_id]
        state = (size, tag if length == size else "")
        rows.append(stored_row(store.folder(run_id), info, state))
    return rows


def _look_at_samples(index: sqlite3.Connection, store: Store) -> None:
    """Add the ranges of channels for runs that have none yet."""
    lacking = index.execute(
        "SELECT key, id FROM run WHERE status != ? AND key NOT IN (SELECT run FROM channel)", [DAMAGED]
    ).fetchall()

    def ranges(one: tuple[int, str]) -> tuple[ChannelRange, ...]:
        folder = store.folder(one[1])
        return ranges_of(folder, folder.info)

    for start in range(0, len(lacking), _BATCH):
        batch = lacking[start : start + _BATCH]
        with ThreadPoolExecutor(_READERS, thread_name_prefix="rigctl-index") as pool:
            rows = list(pool.map(ranges, batch))
        with transaction(index):
            insert_channels(index, [(key, row) for (key, _), row in zip(batch, rows, strict=True)])
