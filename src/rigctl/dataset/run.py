"""A closed run, opened for reading.

In: a run's folder, or its copy in storage. Out: its records in SI, its tables as data frames, its events.
What was stored is not changed; what is not to be believed is left out here: readings outside their
possible range are no values, records that are damaged or excluded are not usable. Tables are read when
they are asked for.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from rigctl.argument_types import checks_argument_types
from rigctl.dataset import run_json
from rigctl.dataset.catalogue import locate_run
from rigctl.dataset.history import COMPLETE
from rigctl.dataset.parquet import numbers
from rigctl.dataset.record_rows import RecordRows
from rigctl.dataset.recording import journal, samples_file
from rigctl.dataset.recording.header import RunHeader
from rigctl.dataset.recording.records_file import EVENTS
from rigctl.dataset.recording.writer_lock import in_progress
from rigctl.dataset.table_columns import event_data, open_table
from rigctl.errors import ExitCode, Location, RigctlError, require_known, unknown_name
from rigctl.json_values import parse_json
from rigctl.notebook import one_line
from rigctl.units import parse_unit
from rigctl.wording import number_of

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq
    from numpy.typing import NDArray

    from rigctl.dataset.storage.store import StoredFolder
    from rigctl.rig import Layout

#: the stored tables of a run
_TABLES: Final = ("samples", "records", "events")
#: error of a conversion to display units and back, as a share of a channel's range
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Switch:
    """A switch of an actuator to an SI value.

    `uncertainty` is the half-width of the interval of its time, s; `record` is the open record when it was
    logged, −1 for none.
    """

    time: float
    actuator: str
    value: float
    uncertainty: float
    record: int = -1


@dataclass(frozen=True)
class Record:
    """One excitation: everything SI, times in s of the run.

    Parameters
    ----------
    time: of each sample, shape (n,).
    channels, commands: values at these times by name, shape (n,) each; NaN for missing values, and for
        readings outside the possible range of their channel.
    switches: exact times of the commands from `start` to `end`.
    sweep: its sweep variables.
    measures: its measures in the procedure.
    """

    index: int
    name: str
    path: str
    rate: float
    start: float
    end: float
    outcome: str
    excluded: str | None
    time: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]
    commands: Mapping[str, NDArray[np.float64]]
    switches: tuple[Switch, ...]
    sweep: Mapping[str, float]
    measures: Mapping[str, float]

    @property
    def usable(self) -> bool:
        """Whether analysis may use the record: it is complete and not excluded."""
        return self.outcome == COMPLETE and self.excluded is None


@dataclass(frozen=True)
class Run:
    """A closed run. Data are read on request, and only the columns that are needed.

    Parameters
    ----------
    folder: its folder, on this computer or in storage.
    info: the content of ``run.json``.
    """

    folder: Path | StoredFolder
    info: Mapping[str, Any] = field(repr=False)

    @property
    def id(self) -> str:
        """The run's id."""
        return str(self.info["id"])

    @cached_property
    def header(self) -> RunHeader:
        """The header of the run."""
        names = RunHeader.__dataclass_fields__
        return RunHeader.from_json({key: value for key, value in self.info.items() if key in names})

    @property
    def layout(self) -> Layout:
        """The columns of a sample and their display units."""
        return self.header.layout

    def __repr__(self) -> str:
        """Return the run on one line."""
        return one_line(self, self.summary())

    def summary(self) -> str:
        """Return one line: the run, its status, the bench, the numbers of records and samples."""
        count, rows = self.info["records"], self.info["rows"]
        reason = f": {self.info['reason']}" if self.info.get("reason") else ""
        bench = f" on '{self.header.rig.name}'" if self.header.rig.name else ""
        return (
            f"{self.id} {self.info['status']}, '{self.header.procedure.name}'{bench}, "
            f"{number_of(count, 'record')}, {number_of(rows, 'sample')}{reason}"
        )

    def _repr_html_(self) -> str:
        """Return the summary and the records for a notebook; user text is escaped."""
        from html import escape

        units = self.records.attrs["units"]
        heads = {name: f"{name} [{unit}]" for name, unit in units.items() if unit != "1"}
        shown = self.records.drop(columns=["path"]).rename(columns=heads)
        table = shown.to_html(index=False, escape=True, na_rep="", float_format=lambda value: f"{value:.4g}")
        return f"<p>{escape(self.summary())}</p>{table}"

    @checks_argument_types
    def samples(self, columns: Sequence[str] | None = None, record: int | None = None) -> pd.DataFrame:
        """Return the samples in display units; ``attrs["units"]`` has the unit of each column.

        Parameters
        ----------
        columns: names to read; all by default.
        record: only the samples of this record.

        Raises
        ------
        RigctlError
            there is no such column or record, or the file is missing or damaged.
        """
        return _frame(self._read(tuple(columns) if columns is not None else self.layout.columns, record))

    @checks_argument_types
    def table(self, name: str, record: int | None = None) -> pa.Table:
        """Return a stored table: ``samples`` (of one record, if given), ``records`` or ``events``.

        The metadata of each field have its unit.
        """
        if name == "samples":
            return self._read(self.layout.columns, record)
        if name not in _TABLES:
            raise unknown_name("table", name, _TABLES)
        with open_table(self.folder / f"{name}.parquet") as file:
            return file.read()

    @cached_property
    def records(self) -> pd.DataFrame:
        """Return one row per record, sweep values and measures in the units of ``attrs["units"]``."""
        return _frame(self._record_rows)

    @property
    def record_units(self) -> dict[str, str]:
        """Return the display unit of each column of `records` that has one."""
        return _units(self._record_rows)

    @cached_property
    def _record_rows(self) -> pa.Table:
        return self.table("records")

    @cached_property
    def events(self) -> pd.DataFrame:
        """Return one row per event, in order of time; ``data`` is JSON."""
        return _frame(self.table("events"))

    @cached_property
    def switches(self) -> tuple[Switch, ...]:
        """Every switch of an actuator with its exact time, in order of time."""
        rows = self.table("events")
        columns = (rows[name].to_pylist() for name in ("kind", "time", "record", "data"))
        switches = []
        with self.event_data():
            for kind, time, record, data in zip(*columns, strict=True):
                if kind != "command":
                    continue
                facts = parse_json(data)
                if "actuator" in facts and facts.get("value") is not None:
                    value, uncertainty = float(facts["value"]), float(facts.get("uncertainty") or 0.0)
                    switches.append(Switch(float(time), facts["actuator"], value, uncertainty, int(record)))
        return tuple(switches)

    def event_data(self) -> AbstractContextManager[None]:
        """Report what is wrong with the data of an event in the block as damage of the file."""
        return event_data(self.folder / EVENTS)

    @cached_property
    def usable(self) -> tuple[int, ...]:
        """Return the indices of the records that analysis may use: complete and not excluded."""
        rows = self._record_rows
        columns = (rows[name].to_pylist() for name in ("record", "outcome", "excluded"))
        return tuple(
            record
            for record, outcome, excluded in zip(*columns, strict=True)
            if outcome == COMPLETE and excluded is None
        )

    @checks_argument_types
    def signals(self, name: str, record: int | None = None) -> NDArray[np.float64]:
        """Return the values of one column in SI, shape (n,); of one record, or of the whole run.

        Raises
        ------
        RigctlError
            no such column or record.
        """
        return self._si(self._read((name,), record), name)

    @checks_argument_types
    def record(self, index: int) -> Record:
        """Return one record with its samples.

        Raises
        ------
        RigctlError
            there is no such record.
        """
        return self._record(index, self._read(self.layout.columns, index))

    @checks_argument_types
    def each(self, indices: Iterable[int]) -> Iterator[Record]:
        """Yield these records; in ascending order the file is read once.

        Raises
        ------
        RigctlError
            there is no such record.
        """
        with self._open_samples(self.layout.columns) as file:
            rows = RecordRows(file, self.layout.columns)
            for index in indices:
                self._require(index)
                yield self._record(index, rows.of(index))

    def _record(self, index: int, table: pa.Table) -> Record:
        rows = self._record_rows
        row = rows.slice(index, 1).to_pylist()[0]
        facts = {key: row[key] for key in ("name", "path", "rate", "start", "end", "outcome", "excluded")}
        return Record(
            index=index,
            **facts,
            time=self._si(table, "time"),
            channels=_fixed({name: self._possible(table, name) for name in self.layout.channels}),
            commands=_fixed({name: self._si(table, name) for name in self.layout.commands}),
            switches=self._switches_of(index, row["start"], row["end"]),
            sweep=_fixed(_values_si(rows.schema, row, "sweep")),
            measures=_fixed(_values_si(rows.schema, row, "measure")),
        )

    def _switches_of(self, record: int, start: float, end: float) -> tuple[Switch, ...]:
        """Return a record's switches; a pulse may end after it, and times of an import may restart."""
        if self.header.source == "import":
            return self._imported_switches.get(record, ())
        first = bisect_left(self.switches, start, key=_time_of)
        return self.switches[first : bisect_right(self.switches, end, lo=first, key=_time_of)]

    @cached_property
    def _imported_switches(self) -> Mapping[int, tuple[Switch, ...]]:
        by_record: dict[int, list[Switch]] = {}
        for switch in self.switches:
            by_record.setdefault(switch.record, []).append(switch)
        return {record: tuple(switches) for record, switches in by_record.items()}

    def _read(self, columns: Sequence[str], record: int | None) -> pa.Table:
        require_known("column", columns, self.layout.columns)
        with self._open_samples(columns) as file:
            if record is None:
                return file.read(columns=list(columns))
            self._require(record)
            return RecordRows(file, columns).of(record)

    @contextmanager
    def _open_samples(self, columns: Sequence[str]) -> Iterator[pq.ParquetFile]:
        """Open the samples, which must have these columns, as the run's layout states."""
        path = self.folder / samples_file.NAME
        with open_table(path) as file:
            if missing := [name for name in columns if name not in file.schema_arrow.names]:
                raise RigctlError(
                    "the file is damaged: it lacks a column of the run",
                    value=missing[0],
                    where=Location(path if isinstance(path, Path) else str(path)),
                    exit_code=ExitCode.FAILED,
                )
            yield file

    def _require(self, record: int) -> None:
        count = self.info["records"]
        if not 0 <= record < count:
            raise RigctlError(
                f"run {self.id} has no such record",
                value=str(record),
                expected=f"0 to {count - 1}" if count else "none, for it has no records",
            )

    def _possible(self, table: pa.Table, name: str) -> NDArray[np.float64]:
        """Return the readings of a channel in SI, NaN for impossible ones; runs of old have no range."""
        import numpy as np

        values = self._si(table, name)
        span = self.header.calibrations.get(name, {}).get("range")
        if span is None:
            return values
        low, high = span
        slack = _ROUNDING * (high - low)  # of display units
        return np.where((values >= low - slack) & (values <= high + slack), values, np.nan)

    def _si(self, table: pa.Table, name: str) -> NDArray[np.float64]:
        import numpy as np

        unit = parse_unit(self.layout.unit(name))
        values = numbers(table[name]).astype(np.float64)
        offset = 0.0 if name in self.layout.differences else unit.offset
        return np.asarray(values * unit.factor + offset, dtype=np.float64)


@checks_argument_types
def open_run(ref: str | Path, runs: str | Path | None = None) -> Run:
    """Open a closed run; a run in storage is read there, without a copy.

    Parameters
    ----------
    ref: an id, an unambiguous start of one, a path, an address, or ``latest``.
    runs: the folder or address of the runs; by default the project's.

    Raises
    ------
    RigctlError
        there is no such run, it is still in progress, or it was never closed.
    """
    folder = locate_run(ref, runs)
    if not isinstance(folder, Path):
        return Run(folder, MappingProxyType(folder.info))
    info = run_json.read_info(folder)
    if info["status"] == run_json.RUNNING or (folder / journal.NAME).exists():
        going_on = in_progress(folder)
        raise RigctlError(
            "the run is still in progress" if going_on else "the run was never closed",
            value=folder.name,
            hint=None if going_on else f"'rigctl runs verify {folder.name}' recovers it",
        )
    return Run(folder, MappingProxyType(info))


def _time_of(switch: Switch) -> float:
    return switch.time


def _frame(table: pa.Table) -> pd.DataFrame:
    frame: pd.DataFrame = table.to_pandas()
    frame.attrs["units"] = _units(table)
    return frame


def _units(table: pa.Table) -> dict[str, str]:
    return {
        column.name: unit
        for column in table.schema
        if (unit := (column.metadata or {}).get(b"unit", b"").decode("utf-8"))
    }


def _values_si(schema: pa.Schema, row: Mapping[str, Any], kind: str) -> dict[str, float]:
    """Return the sweep values or the measures of a record, by their names in the procedure."""
    values = {}
    for column in schema:
        facts = {key.decode(): value.decode("utf-8") for key, value in (column.metadata or {}).items()}
        if facts.get("kind") == kind and row[column.name] is not None:
            unit = parse_unit(facts["unit"])
            values[facts["variable"]] = unit.to_si(row[column.name], difference="difference" in facts)
    return values


def _fixed(values: dict[str, Any]) -> Mapping[str, Any]:
    return MappingProxyType(values)
