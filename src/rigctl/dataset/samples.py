"""From the journal to ``samples.parquet``: one row per sample, in the units the channels are shown in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset import journal
from rigctl.dataset.journal import Journal, read_journal
from rigctl.dataset.parquet import open_parquet, replace_with, write_error
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

    from rigctl.dataset.header import RunHeader

NAME: Final = "samples.parquet"
#: rows of a row group: one record of a long run is read without the others
GROUP_ROWS: Final = 1 << 17
#: key of the file's metadata: the last session whose journal is in the file
_SESSION: Final = b"rigctl.session"


@dataclass
class SampleFacts:
    """What the samples say about the run: how many there are, and when the last one of a record was."""

    rows: int = 0
    last_time: float = 0.0
    last_of_record: dict[int, float] = field(default_factory=dict)
    lost_bytes: int = 0  #: of the journal, behind its last whole frame

    def add(self, times: NDArray[np.float64], records: NDArray[np.int32]) -> None:
        """Take in a block of rows."""
        import numpy as np

        self.rows += len(times)
        if len(times):
            self.last_time = max(self.last_time, float(np.nanmax(times)))
        last_first, places = np.unique(records[::-1], return_index=True)
        for record, place in zip(last_first.tolist(), places.tolist(), strict=True):
            self.last_of_record[record] = float(times[len(times) - 1 - place])


def schema(header: RunHeader, session: int) -> pa.Schema:
    """The columns of ``samples.parquet``, each with its unit, kind and calibration."""
    import pyarrow as pa

    fields = []
    for name in header.layout.columns:
        kind = pa.int32() if name == "record" else pa.float64()
        fields.append(pa.field(name, kind, metadata=_field_metadata(header, name)))
    return pa.schema(fields, metadata={_SESSION: str(session)})


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


def write_samples(folder: Path, header: RunHeader) -> SampleFacts:
    """Make ``samples.parquet`` from the journal, and from what earlier sessions left there.

    The same journal gives the same bytes, however often this is done and wherever it was interrupted.

    Raises
    ------
    RigctlError
        the disk is full, or the file read back is not what was written; the journal is untouched.
    """
    path = folder / NAME
    found = _journal_of(folder)
    earlier = _session_in(path)
    if found is None or (earlier is not None and earlier >= found.facts["session"]):
        if earlier is None:
            _write(path, schema(header, 0), iter(()))
        facts = _facts_of(path)
    else:
        blocks = _earlier_blocks(path) if earlier is not None else iter(())
        facts = _write(path, schema(header, found.facts["session"]), _chain(blocks, _blocks(found, header)))
    facts.lost_bytes = found.lost_bytes if found else 0
    return facts


def remove_journal(folder: Path) -> None:
    """Remove the journal of a run whose ``samples.parquet`` is whole."""
    with suppress(OSError):
        (folder / journal.NAME).unlink(missing_ok=True)


def _journal_of(folder: Path) -> Journal | None:
    path = folder / journal.NAME
    return read_journal(path) if path.exists() else None


def _session_in(path: Path) -> int | None:
    """The last session in a ``samples.parquet``; None when there is no such file."""
    if not path.exists():
        return None
    with open_parquet(path) as file:
        return int((file.schema_arrow.metadata or {}).get(_SESSION, b"0"))


def _chain(*parts: Iterator[pa.Table]) -> Iterator[pa.Table]:
    for part in parts:
        yield from part


def _earlier_blocks(path: Path) -> Iterator[pa.Table]:
    with open_parquet(path) as file:
        for group in range(file.num_row_groups):
            yield file.read_row_group(group)


def _blocks(found: Journal, header: RunHeader) -> Iterator[pa.Table]:
    """The journal's rows in display units; times are moved to where the session lies in the run."""
    import numpy as np
    import pyarrow as pa

    names, layout = header.layout.columns, header.layout
    if found.columns != names:
        raise RigctlError(
            "the journal belongs to another run", where=Location(found.path), exit_code=ExitCode.FAILED
        )
    target = schema(header, found.facts["session"])
    for rows in found.blocks(GROUP_ROWS):
        columns: list[Any] = [rows[:, 0] + found.facts["offset"], rows[:, 1].astype(np.int32)]
        for index, name in enumerate(names[2:], start=2):
            unit, difference = parse_unit(layout.unit(name)), name in layout.differences
            columns.append((rows[:, index] - (0.0 if difference else unit.offset)) / unit.factor)
        yield pa.table(columns, schema=target)


def _write(path: Path, target: pa.Schema, blocks: Iterator[pa.Table]) -> SampleFacts:
    """Write the blocks to a new file beside `path`, read it back, and put it in its place."""
    import pyarrow.parquet as pq

    facts = SampleFacts()
    checks: list[str] = []
    with replace_with(path) as draft:
        encodings: Mapping[str, Any] = {
            "compression": "zstd",
            "compression_level": 3,
            # converters give few distinct values; times are many, but their bytes are alike
            "use_dictionary": [name for name in target.names if name != "time"],
            "column_encoding": {"time": "BYTE_STREAM_SPLIT"},
        }
        with write_error(path), pq.ParquetWriter(draft, target, **encodings) as writer:
            for block in blocks:
                writer.write_table(block, row_group_size=GROUP_ROWS)
                facts.add(block["time"].to_numpy(), block["record"].to_numpy())
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
        digest.update(column.to_numpy().tobytes())
    return digest.hexdigest()


def _facts_of(path: Path) -> SampleFacts:
    facts = SampleFacts()
    with open_parquet(path) as file:
        for group in range(file.num_row_groups):
            block = file.read_row_group(group, columns=["time", "record"])
            facts.add(block["time"].to_numpy(), block["record"].to_numpy())
    return facts
