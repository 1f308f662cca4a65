from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Timer

import pytest

from dataset.strokes import measure_strokes
from rigctl.dataset import RunWriter, query
from rigctl.errors import RigctlError

RunMaker = Callable[..., Path]


@pytest.fixture
def two(make_run: RunMaker, runs: Path) -> Path:
    make_run("20261121-093000-stroke")
    make_run("20261121-100000-stroke", records=2)
    return runs


def test_queries_span_runs(two: Path) -> None:
    answer = query(
        "SELECT run, count(*) AS n, max(position) AS highest FROM samples WHERE record >= 0 "
        "GROUP BY run ORDER BY run",
        two,
    )
    assert answer.columns == ("run", "n", "highest")
    assert [row[:2] for row in answer.rows] == [
        ("20261121-093000-stroke", 60),
        ("20261121-100000-stroke", 40),
    ]
    assert answer.rows[0][2] == pytest.approx(19.0)
    assert answer.frame()["n"].tolist() == [60, 40]


def test_all_views_can_be_queried(two: Path) -> None:
    rows = {
        view: query(f"SELECT count(*) FROM {view}", two).rows[0][0] for view in ("runs", "records", "events")
    }
    assert rows == {"runs": 2, "records": 5, "events": 24}
    assert query("SELECT id, procedure, records FROM runs ORDER BY id", two).rows[0] == (
        "20261121-093000-stroke",
        "stroke",
        3,
    )
    assert query("SELECT unit FROM units WHERE \"column\" = 'position'", two).rows == (("mm",), ("mm",))
    assert query("SELECT avg(stroke) FROM records WHERE oil > 25", two).rows[0][0] == pytest.approx(20.0)


def test_columns_that_only_some_runs_have_are_null_in_the_others(two: Path, make_header: object) -> None:
    writer = RunWriter.create(two, make_header("20261122-000000-other"))  # type: ignore[operator]
    writer.open_record(0.0, "creep", {"load": (10.0, "N")}, "1", 10.0)
    writer.close_record(1.0, "complete")
    writer.close("finished")
    assert query("SELECT load, oil FROM records WHERE name = 'creep'", two).rows == ((10.0, None),)


def test_a_run_in_progress_is_omitted(two: Path, make_header: object) -> None:
    writer = RunWriter.create(two, make_header("20261122-000000-other"))  # type: ignore[operator]
    measure_strokes(writer)
    assert query("SELECT count(*) FROM runs", two).rows == ((2,),)
    writer.close("finished")
    assert query("SELECT count(*) FROM runs", two).rows == ((3,),)


def test_without_runs_the_views_are_empty(runs: Path) -> None:
    for view in ("runs", "records", "samples", "events", "units"):
        assert query(f"SELECT * FROM {view}", runs).rows == ()


def test_runs_are_queried_in_folders_with_wildcards_and_quotes_in_their_names(
    tmp_path: Path, make_header: object
) -> None:
    runs = tmp_path / "it's [a]"
    writer = RunWriter.create(runs, make_header())  # type: ignore[operator]
    measure_strokes(writer, records=1)
    writer.close("finished")
    assert query("SELECT run, record FROM records", runs).rows == (("20261121-093000-stroke", 0),)


def test_a_misspelt_table_or_column_is_reported_with_the_nearest(two: Path) -> None:
    with pytest.raises(RigctlError, match="unknown table") as table:
        query("SELECT * FROM sampels", two)
    assert (table.value.value, table.value.nearest) == ("sampels", "samples")
    with pytest.raises(RigctlError, match="unknown column") as column:
        query("SELECT positon FROM samples", two)
    assert (column.value.value, column.value.nearest) == ("positon", "position")


@pytest.mark.parametrize(
    "sql",
    [
        "SELEC 1",
        "",
        ";",
        "SELECT",
        "SELECT 'a' + 1 FROM runs",
        "SELECT sum(id) FROM runs",
        "SELECT * FROM records WHERE",
        "SELECT nonsense(1)",
        "SELECT 1 FROM runs WHERE id = 'x",
    ],
)
def test_invalid_sql_is_reported_without_a_traceback(two: Path, sql: str) -> None:
    with pytest.raises(RigctlError) as caught:
        query(sql, two)
    assert "Traceback" not in str(caught.value)


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT * FROM read_text('{secret}')",
        "SELECT * FROM read_csv('{secret}')",
        "SELECT * FROM '{secret}'",
        "SELECT * FROM glob('{folder}/*')",
        "SELECT content FROM read_blob('{folder}/*')",
        "COPY (SELECT 1) TO '{folder}/written.csv'",
        "COPY runs TO '{samples}' (FORMAT parquet)",
        "ATTACH '{folder}/written.db'",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "CREATE TABLE written AS SELECT 1",
        "DELETE FROM runs",
        "DROP VIEW samples",
        "INSERT INTO runs (id) VALUES ('x')",
        "SELECT 1; SELECT 2",
        "SELECT 1; COPY (SELECT 1) TO '{folder}/written.csv'",
        "EXPLAIN ANALYZE COPY (SELECT 1) TO '{folder}/written.csv'",
        "EXPLAIN ANALYZE COPY runs TO '{samples}' (FORMAT parquet)",
        "explain analyze copy (from samples) to '{samples}'",
        "EXPLAIN ANALYZE COPY runs FROM '{secret}'",
        "EXPLAIN ANALYZE EXPORT DATABASE '{folder}/written'",
        "EXPLAIN ANALYZE ATTACH '{folder}/written.db'",
        "WITH x AS (SELECT * FROM read_csv('{secret}')) SELECT * FROM x",
        "SELECT * FROM parquet_scan('{samples}')",
        "SELECT * FROM parquet_metadata('{samples}')",
        "SELECT * FROM sniff_csv('{secret}')",
        "SELECT * FROM query('SELECT content FROM read_text(''{secret}'') ')",
        "SELECT * FROM query_table('{secret}')",
        "PRAGMA database_list",
        "EXPORT DATABASE '{folder}/written'",
        "CALL dbgen(sf = 0)",
        "SELECT * FROM read_parquet('https://example.org/x.parquet')",
        "SELECT * FROM some_frame",
    ],
)
def test_a_query_can_neither_read_nor_write_other_files(two: Path, tmp_path: Path, sql: str) -> None:
    some_frame = __import__("pandas").DataFrame({"a": [1]})
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    secret = folder / "secret.csv"
    secret.write_text("word\nxyzzy\n", encoding="utf-8")
    kept = two / "20261121-093000-stroke" / "samples.parquet"
    before = kept.read_bytes()
    text = sql.format(secret=secret.as_posix(), folder=folder.as_posix(), samples=kept.as_posix())
    with pytest.raises(RigctlError) as caught:
        query(text, two)
    assert "xyzzy" not in str(caught.value)
    assert [path.name for path in folder.iterdir()] == ["secret.csv"]
    assert kept.read_bytes() == before
    assert len(some_frame) == 1


@pytest.mark.skipif(
    sys.platform == "win32", reason="Windows has no signal to send to another process's Ctrl-C"
)
def test_ctrl_c_stops_a_query_that_never_ends(two: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
    monkeypatch.callback = None
    endless = "SELECT count(*) FROM range(10000000) a, range(10000000) b WHERE a.range + b.range = 7"
    try:
        with pytest.raises(KeyboardInterrupt):
            Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
            query(endless, two)
    finally:
        signal.signal(signal.SIGINT, heard)
