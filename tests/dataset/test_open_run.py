from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from dataset.strokes import sample
from rigctl.dataset import Run, RunWriter, exclude, open_run, verify
from rigctl.dataset.parquet import numbers
from rigctl.errors import RigctlError

RunMaker = Callable[..., Path]


@pytest.fixture
def run(make_run: RunMaker) -> Run:
    return open_run(make_run())


def test_a_record_has_its_data_in_si_units(run: Run) -> None:
    record = run.record(1)
    assert (record.index, record.name, record.path, record.rate) == (1, "stroke", "1/record", 100.0)
    assert (record.start, record.end, record.outcome, record.usable) == (1.1, 1.5, "complete", True)
    assert record.time.tolist() == [1.1 + row / 100 for row in range(20)]
    assert record.channels["position"] == pytest.approx(0.001 * np.arange(20))
    assert record.channels["oil_temperature"] == pytest.approx(313.15)
    assert record.commands["heater"].tolist() == [1.0] * 20
    assert [(s.time, s.actuator, s.value, s.uncertainty) for s in record.switches] == [
        (1.1, "valve", 1.0, 0.001)
    ]


def test_columns_and_records_can_be_read_individually(run: Run) -> None:
    frame = run.samples(["time", "position"], record=2)
    assert frame.columns.tolist() == ["time", "position"]
    assert (len(frame), frame.attrs["units"]) == (20, {"time": "s", "position": "mm"})
    assert run.signals("supply_pressure", 0).tolist() == pytest.approx([30e5] * 20)
    assert len(run.signals("supply_pressure")) == 63


@pytest.mark.parametrize("rows", [7, 1000])
def test_sequential_and_individual_reads_of_records_agree(
    make_run: RunMaker, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a record spans parts of the file, and parts hold several records."""
    monkeypatch.setattr("rigctl.dataset.recording.samples_file.GROUP_ROWS", rows)
    run = open_run(make_run())
    for chosen in ((0, 1, 2), (2, 0), ()):
        for index, record in zip(chosen, run.each(chosen), strict=True):
            alone = run.record(index)
            assert record.index == index
            assert record.time.tolist() == alone.time.tolist()
            assert record.channels["position"].tolist() == alone.channels["position"].tolist()
            assert (record.switches, record.sweep) == (alone.switches, alone.sweep)
    with pytest.raises(RigctlError, match="no such record"):
        list(run.each([99]))


def test_values_survive_writing_and_reading(writer: RunWriter) -> None:
    values = np.random.default_rng(1).uniform(0.0, 0.3, 500)
    for row, value in enumerate(values):
        writer.append(sample(row / 100, position=value))
    assert open_run(writer.close("finished")).signals("position") == pytest.approx(values, rel=1e-15)


def test_a_run_is_read_lazily(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    (run.folder / "samples.parquet").unlink()
    opened = open_run(run.folder)
    assert opened.info["rows"] == 63
    assert len(opened.records) == 3
    with pytest.raises(RigctlError, match="the file is missing"):
        opened.samples()


def test_a_misspelt_column_is_reported_with_the_nearest(run: Run) -> None:
    with pytest.raises(RigctlError) as caught:
        run.signals("positon")
    assert caught.value.nearest == "position"


@pytest.mark.parametrize("record", [-1, 3])
def test_a_missing_record_is_reported(run: Run, record: int) -> None:
    with pytest.raises(RigctlError, match="no such record") as caught:
        run.record(record)
    assert caught.value.expected == "0 to 2"


def test_running_and_unclosed_runs_are_distinguished(writer: RunWriter) -> None:
    with pytest.raises(RigctlError, match="still in progress"):
        open_run(writer.folder)
    writer._journal.close()
    writer._log.close()
    writer._lock.release()
    with pytest.raises(RigctlError, match="never closed") as caught:
        open_run(writer.folder)
    assert "rigctl runs verify" in str(caught.value.hint)
    verify(writer.folder)
    assert open_run(writer.folder).info["status"] == "interrupted"


def test_a_damaged_file_is_reported(run: Run) -> None:
    (run.folder / "samples.parquet").write_bytes(b"PAR1 nonsense PAR1")
    with pytest.raises(RigctlError, match="damaged") as caught:
        open_run(run.folder).samples()
    assert caught.value.where.file == run.folder / "samples.parquet"


def test_a_run_of_a_million_samples_is_read_back_and_stored_compressed(writer: RunWriter) -> None:
    count = 1_000_000
    block = np.tile(sample(0.0, 0), (count, 1))
    block[:, 0] = np.arange(count) / 1000
    block[:, 1] = np.arange(count) // 100_000
    block[:, 4] = np.round(np.sin(block[:, 0]) * 511 + 512) / 1023 * 0.3
    for record in range(10):
        writer.open_record(record * 100.0, "stroke", {}, str(record), 1000.0)
        writer.append_block(block[record * 100_000 : (record + 1) * 100_000])
        writer.close_record(record * 100.0 + 99.999, "complete")
    folder = writer.close("finished")
    run = open_run(folder)
    assert run.record(7).time[[0, -1]].tolist() == [700.0, 799.999]
    assert np.array_equal(run.signals("time"), block[:, 0])
    assert (folder / "samples.parquet").stat().st_size < 8 * count


def test_a_run_has_text_and_notebook_representations(run: Run) -> None:
    assert run.summary() == f"{run.id} finished, 'stroke' on 'bench', 3 records, 63 samples"
    shown = run._repr_html_()
    assert shown.startswith(f"<p>{run.id} finished")
    assert shown.count("<tr") == 1 + len(run.records)


def test_user_text_is_escaped_in_a_notebook(run: Run) -> None:
    exclude(run.folder, [1], "<script>alert(1)</script>")
    info = {**run.info, "reason": "<img src=x>"}
    shown = Run(run.folder, info)._repr_html_()
    assert "<script" not in shown
    assert "<img" not in shown
    assert "&lt;script&gt;" in shown
    assert "&lt;img src=x&gt;" in shown


@pytest.mark.parametrize(
    "column",
    [
        pa.chunked_array([[1.5, None, 3.0], [4.0]]),
        pa.chunked_array([[1, None, 3], [4]], pa.int32()),
        pa.chunked_array([[1, 2], [4]], pa.int32()),
        pa.chunked_array([], pa.float64()),
        pa.chunked_array([], pa.int32()),
        pa.chunked_array([np.arange(10.0)]).slice(2, 5),
    ],
)
def test_converted_columns_agree_with_those_of_pyarrow(column: pa.ChunkedArray) -> None:
    found, expected = numbers(column), column.to_numpy()
    assert found.dtype == expected.dtype
    np.testing.assert_array_equal(found, expected)


def test_records_are_read_without_pandas(make_run: RunMaker) -> None:
    """Loading pandas takes longer than reading the records of a campaign."""
    code = (
        "import sys\n"
        "from rigctl.dataset import open_run\n"
        "run = open_run(sys.argv[1])\n"
        "found = list(run.each(run.usable))\n"
        "assert found[0].switches and run.record_units and run.signals('position').size\n"
        "sys.exit('pandas' in sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(make_run())], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
