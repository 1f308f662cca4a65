"""Makes ``samples.parquet`` from the journal: one row per sample, in the channels' display units.

In: the journal of one session, and the file that earlier sessions of the run have left. Out: one file
with all rows, written beside the old one, read back, compared, and only then put in its place. Until that
has happened the journal stays, so that the work can be interrupted anywhere and repeated; the session
stored in the metadata tells whether a journal has been taken over already.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rigctl.dataset.parquet import numbers, open_parquet, replace_with
from rigctl.dataset.recording import journal
from rigctl.dataset.recording.journal import Journal, read_journal
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.write import write_error
from rigctl.json_values import parse_json
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

    from rigctl.dataset.recording.header import RunHeader

NAME: Final = "samples.parquet"
#: rows of a row group, so that one record of a long run can be read without the others
GROUP_ROWS: Final = 1 << 17
#: the kind of a bench whose devices are read independently of one another
_SEVERAL: Final = "devices"
#: s by which a reading may arrive after later ones of other devices
_LATEST: Final = 60.0
#: s between two readings at the same time
_APART: Final = 1e-9
#: keys of the file's metadata: the last session in the file, and the damage by session
_SESSION: Final = b"rigctl.session"
_LOSSES: Final = b"rigctl.losses"


@dataclass
class SampleFacts:
    """Facts about a run's samples: their number, in total and per record, and the damage.

    `losses` are by session: the unreadable bytes of its journal, and the rows known to be missing.
    """

    rows: int = 0
    first_time: float = math.inf
    last_time: float = 0.0
    last_of_record: dict[int, float] = field(default_factory=dict)
    rows_of_record: Counter[int] = field(default_factory=Counter)
    losses: Mapping[int, Loss] = field(default_factory=dict)

    def add(self, times: NDArray[np.float64], records: NDArray[np.int32]) -> None:
        """Add a block of rows."""
        import numpy as np

        self.rows += len(times)
        if len(times):
            self.first_time = min(self.first_time, float(np.nanmin(times)))
            self.last_time = max(self.last_time, float(np.nanmax(times)))
        numbers, index, counts = np.unique(records[::-1], return_index=True, return_counts=True)
        for record, last, count in zip(numbers.tolist(), index.tolist(), counts.tolist(), strict=True):
            self.last_of_record[record] = float(times[len(times) - 1 - last])
            self.rows_of_record[record] += count


class Loss(NamedTuple):
    """The loss in one session's journal."""

    bytes: int
    rows: int


def schema(header: RunHeader, session: int, losses: Mapping[int, Loss] | None = None) -> pa.Schema:
    """Return the columns of ``samples.parquet``, each with its unit, kind and calibration."""
    import pyarrow as pa

    fields = []
    for name in header.layout.columns:
        kind = pa.int32() if name == "record" else pa.float64()
        fields.append(pa.field(name, kind, metadata=_field_metadata(header, name)))
    metadata = {_SESSION: str(session)}
    if losses:
        metadata[_LOSSES] = json.dumps({str(key): loss for key, loss in losses.items()})
    return pa.schema(fields, metadata=metadata)


def _field_metadata(header: RunHeader, name: str) -> dict[str, str]:
    layout = header.layout
    kind = "channel" if name in layout.channels else "command" if name in layout.commands else name
    facts = {"unit": layout.unit(name), "kind": kind}
    calibration = header.calibrations.get(name)
    if calibration:
        text = json.dumps(calibration, sort_keys=True, default=str)
        facts["calibration"] = sha256(text.encode("utf-8")).hexdigest()[:12]
        facts["quantity"] = str(calibration.get("quantity", ""))
    if name in layout.differences:
        facts["difference"] = "true"
    return facts


def write_samples(folder: Path, header: RunHeader, session: int, offset: float) -> SampleFacts:
    """Make ``samples.parquet`` from the journal and the rows of earlier sessions.

    The same journal gives the same bytes, even after repetitions and interruptions. Damaged parts of the
    journal are omitted and counted.

    Parameters
    ----------
    session, offset: the run's last session and its start in run time, from the log, in case the journal's own
        header is damaged.

    Raises
    ------
    RigctlError
        the disk is full, or the file read back differs from what was written; the journal is unchanged.
    """
    path = folder / NAME
    source = _journal_of(folder)
    earlier, losses = _state_of(path)
    if source is not None:
        session = source.facts["session"] if source.facts else session
        offset = source.facts["offset"] if source.facts else offset
    # Nothing to add: no journal, or one that is in the file already, because a kill came between replacing
    # the file and removing the journal.
    if source is None or (earlier is not None and earlier >= session):
        if earlier is None:
            _write(path, schema(header, 0), iter(()))
        facts = sample_facts(folder)
    else:
        loss = Loss(source.lost_bytes, source.lost_rows(len(header.layout.columns)))
        if source.damaged or loss.rows:
            losses = {**losses, session: loss}
        # Block by block, as a run may be larger than memory.
        blocks = _earlier_blocks(path) if earlier is not None else iter(())
        target = schema(header, session, losses)
        facts = _write(path, target, _chain(blocks, _blocks(source, header, target, offset)))
    facts.losses = losses
    return facts


def set_aside_journal(folder: Path, session: int, *, misses: bool) -> None:
    """Remove the journal of a run whose ``samples.parquet`` is complete; a damaged one is kept permanently.

    So is one that `misses` samples, even if the rest is readable. Its name contains the session and is never
    reused.
    """
    path = folder / journal.NAME
    with suppress(OSError):
        if not path.exists() or not (misses or read_journal(path).damaged):
            path.unlink(missing_ok=True)
            return
        number, target = 0, folder / f"{journal.NAME}.damaged-{session}"
        while target.exists():
            number += 1
            target = folder / f"{journal.NAME}.damaged-{session}.{number}"
        path.rename(target)


def _journal_of(folder: Path) -> Journal | None:
    path = folder / journal.NAME
    return read_journal(path) if path.exists() else None


def _state_of(path: Path) -> tuple[int | None, dict[int, Loss]]:
    """Return the last session in a ``samples.parquet``, None without such a file, and the damage."""
    if not path.exists():
        return None, {}
    with open_parquet(path) as file:
        metadata = file.schema_arrow.metadata or {}
    try:
        losses = parse_json(metadata.get(_LOSSES, b"{}"))
        return int(metadata.get(_SESSION, b"0")), {int(key): Loss(*loss) for key, loss in losses.items()}
    except (ValueError, TypeError, AttributeError) as problem:
        raise RigctlError(
            "the file is damaged: its metadata are not what rigctl writes there",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        ) from problem


def _chain(*parts: Iterator[pa.Table]) -> Iterator[pa.Table]:
    for part in parts:
        yield from part


def _earlier_blocks(path: Path) -> Iterator[pa.Table]:
    with open_parquet(path) as file:
        for group in range(file.num_row_groups):
            yield file.read_row_group(group)


def _blocks(source: Journal, header: RunHeader, target: pa.Schema, offset: float) -> Iterator[pa.Table]:
    """Yield the journal's rows in display units, with times shifted to run time."""
    import numpy as np
    import pyarrow as pa

    names, layout = header.layout.columns, header.layout
    if source.facts is not None and tuple(source.facts["columns"]) != names:
        raise RigctlError(
            "the journal belongs to another run", where=Location(source.path), exit_code=ExitCode.FAILED
        )
    blocks = source.blocks(len(names), GROUP_ROWS)
    for rows in _in_order(blocks) if header.backend.get("kind") == _SEVERAL else blocks:
        columns: list[Any] = [rows[:, 0] + offset, rows[:, 1].astype(np.int32)]
        for index, name in enumerate(names[2:], start=2):
            unit, difference = parse_unit(layout.unit(name)), name in layout.differences
            columns.append((rows[:, index] - (0.0 if difference else unit.offset)) / unit.factor)
        yield pa.table(columns, schema=target)


def _in_order(blocks: Iterator[NDArray[np.float64]]) -> Iterator[NDArray[np.float64]]:
    """Yield the rows in order of time: of several devices, a slow one's reading arrives after later ones.

    No two rows have the same time, as within a record of one device.
    """
    import numpy as np

    waiting: NDArray[np.float64] | None = None  # rows that those of the next block may precede
    for block in blocks:
        rows = block if waiting is None else np.concatenate([waiting, block])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        for index in np.flatnonzero(np.diff(rows[:, 0]) <= 0.0) + 1:  # of two devices, at the very same time
            rows[index, 0] = max(rows[index, 0], rows[index - 1, 0] + _APART)
        # What is older than any reading that can still come is final; the rest waits for the next block.
        ready = int(np.searchsorted(rows[:, 0], rows[-1, 0] - _LATEST)) if len(rows) else 0
        yield from _groups(rows[:ready])
        waiting = rows[ready:]
    if waiting is not None:
        yield from _groups(waiting)


def _groups(rows: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Yield rows as the file has them: a block of more than one group would be read back as two."""
    for first in range(0, len(rows), GROUP_ROWS):
        yield rows[first : first + GROUP_ROWS]


def _write(path: Path, target: pa.Schema, blocks: Iterator[pa.Table]) -> SampleFacts:
    """Write the blocks to a new file beside `path`, read it back, and replace `path`."""
    import pyarrow.parquet as pq

    facts = SampleFacts()
    checks: list[str] = []
    with replace_with(path) as draft:
        encodings: Mapping[str, Any] = {
            "compression": "zstd",
            "compression_level": 3,
            # converters give few distinct values; times are all distinct, but have similar bytes
            "use_dictionary": [name for name in target.names if name != "time"],
            "column_encoding": {"time": "BYTE_STREAM_SPLIT"},
        }
        with write_error(path), pq.ParquetWriter(draft, target, **encodings) as writer:
            for block in blocks:
                writer.write_table(block, row_group_size=GROUP_ROWS)
                facts.add(numbers(block["time"]), numbers(block["record"]))
                checks.append(_checksum(block))
        with open_parquet(draft) as written:
            groups = range(written.num_row_groups)
            if checks != [_checksum(written.read_row_group(group)) for group in groups]:
                raise RigctlError(
                    "what was read back is not what was written",
                    hint="The journal is kept; check the disk",
                    where=Location(path),
                    exit_code=ExitCode.FAILED,
                )
    return facts


def _checksum(block: pa.Table) -> str:
    digest = sha256()
    for column in block.columns:
        digest.update(numbers(column).tobytes())
    return digest.hexdigest()


def sample_facts(folder: Path) -> SampleFacts:
    """Return the facts in a run's ``samples.parquet``.

    Raises
    ------
    RigctlError
        the file is missing or damaged.
    """
    facts = SampleFacts()
    with open_parquet(folder / NAME) as file:
        for group in range(file.num_row_groups):
            block = file.read_row_group(group, columns=["time", "record"])
            facts.add(numbers(block["time"]), numbers(block["record"]))
    return facts
