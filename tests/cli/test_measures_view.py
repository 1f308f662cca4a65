"""The measures of a run's records, as a table."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pyarrow as pa
import pytest

from rigctl.answers.measures import measure_blocks
from rigctl.cli.blocks import show
from rigctl.dataset import Run


def run_of(columns: dict[str, tuple[str, str, list[Any]]]) -> Run:
    """A run with these columns of its records: kind, unit, values."""
    count = len(next(iter(columns.values()))[2])
    fields = [pa.field("record", pa.int64()), pa.field("outcome", pa.string())]
    arrays: list[Any] = [list(range(count)), ["complete"] * count]
    for name, (kind, unit, values) in columns.items():
        array = pa.array(values)
        fields.append(pa.field(name, array.type, metadata={"kind": kind, "unit": unit}))
        arrays.append(array)
    table = pa.table(arrays, schema=pa.schema(fields))
    return cast("Run", SimpleNamespace(table=lambda _: table))


def printed(run: Run, capsys: pytest.CaptureFixture[str]) -> list[str]:
    show(measure_blocks(run))
    lines = capsys.readouterr().out.splitlines()
    return [" ".join(line.split()) for line in lines if line.strip(" ─")]


def test_one_measure_of_a_sweep_of_two_variables_is_a_table_over_both(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sweep = [(oil, supply) for oil in (20.0, 80.0) for supply in (20.0, 30.0)]
    run = run_of(
        {
            "oil": ("sweep", "degC", [one for one, _ in sweep]),
            "supply": ("sweep", "bar", [one for _, one in sweep]),
            "stroke": ("measure", "mm", [77.42, 95.0, 110.04, 96.5]),
        }
    )
    assert printed(run, capsys) == [
        "stroke [mm] over supply",
        "oil [degC] 20 bar 30 bar",
        "20 77.4 95.0",
        "80 110.0 96.5",
    ]


def test_repeated_points_and_several_measures_are_a_row_for_each_record(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = run_of(
        {
            "level": ("sweep", "%", [10.0, 10.0]),
            "top": ("measure", "degC", [31.25, None]),
            "worked": ("measure", "1", [1.0, 0.5]),
        }
    )
    assert printed(run, capsys) == [
        "record level [%] top [degC] worked",
        "1 10 31.25 1.000",
        "2 10 0.500",
    ]


def test_records_without_measures_have_no_table() -> None:
    assert measure_blocks(run_of({"level": ("sweep", "%", [10.0])})) == []
