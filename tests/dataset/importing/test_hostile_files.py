"""Files that would crash a reader: each gives one message quickly, and leaves no run."""

from __future__ import annotations

import gzip
import io
import struct
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigctl.dataset.importing import Options, first_pass, import_file, read_table
from rigctl.dataset.importing.formats import foreign
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig
from systems import needs_posix

RIG = Path(__file__).parents[3] / "rigs" / "hl32-bench.yaml"
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(RIG)


def refusal(path: Path, rig: Rig, **how: Any) -> str:
    with pytest.raises(RigctlError) as caught:
        import_file(path, rig, path.parent / "runs", **how)
    assert not (path.parent / "runs").exists()
    return str(caught.value)


# --- text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time [s]~position [mm]\n0~1\n", "1:1: column 1 has no name, got 'time [s]~position [mm]'"),
        ("time [s],pos\rition [mm]\n0,1\n", "1:10: unknown column, got 'pos ition'"),
        ("time [s],position [mm]\n0,1\n1,2\r3\n", ":3:3: position: not a number, got '2\u240d3'"),
        ("time [s],position [mm]\n0,1\n1,'\x00'\n", ":3:3: position: not a number"),
        ('time [s],position [mm]\n0,1\n1,"2\n2,3\n', ":3: position: a quote is not closed"),
        ('time [s],position [mm]\n0,1\n1,"2\n', ":3: position: a quote is not closed"),
        ('time [s],position [mm]\n0,1\n1,"2', ":3: position: a quote is not closed"),
        ("time [s],position [mm]\n" + "x" * (1 << 21), "2: the line is longer than 1 MiB"),
        ("#" * (1 << 21), "1: the line is longer than 1 MiB"),
        ("time [s],position [mm]\n0," + "1" * 200_000, ":2: wrong number of cells"),
    ],
)
def test_text_that_is_not_a_table_is_refused(tmp_path: Path, rig: Rig, text: str, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode())
    assert said in refusal(path, rig)


@pytest.mark.parametrize("heading", ["", "time [s],position [mm]"])
def test_a_table_of_100_000_columns_is_refused_at_once(tmp_path: Path, rig: Rig, heading: str) -> None:
    """Each column would be examined by itself; a row of them is shorter than the longest line."""
    path = tmp_path / "log.csv"
    path.write_text(heading + "," * 99_999 + "\n" + "1," * 99_999 + "1\n", encoding="utf-8")
    said = refusal(path, rig)
    assert "the table has too many columns, got '100000 columns'" in said or "'100001 columns'" in said
    with pytest.raises(RigctlError, match="the table has too many columns"):
        read_table(path)


def test_many_unknown_columns_are_one_short_message(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "log.csv"
    names = ["time [s]", *(f"c{k} [degC]" for k in range(300))]
    path.write_text("\n".join([",".join(names), ",".join(["1"] * 301)]), encoding="utf-8")
    said = refusal(path, rig)
    assert "300 columns are unknown: c0, c1, " in said
    assert len(said) < 1000


def test_a_bar_is_accepted_as_a_delimiter(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time [s]|position [mm]\n0|1\n1|2\n", encoding="utf-8")
    assert import_file(path, rig, tmp_path / "runs").rows == 2


class Endless(io.RawIOBase):
    """Compressed bytes of a line of 10.9 GB, made as they are read: deflate blocks of zeros are tiny."""

    def __init__(self, head: bytes, fill: bytes, times: int) -> None:
        packer = zlib.compressobj(9, zlib.DEFLATED, 31)
        self._head = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
        self._block = packer.compress(fill) + packer.flush(zlib.Z_FULL_FLUSH)
        self._times = times

    def written(self) -> bytes:
        return self._head + self._block * self._times


@pytest.mark.parametrize(
    ("head", "fill", "said"),
    [
        (b"time [s],position [mm]\n0,1\n", b"7" * (1 << 24), "the line is longer than 1 MiB"),
        (b"", b"#" * (1 << 24), "the line is longer than 1 MiB"),
        (b"time [s],position [mm]\n0,1\n", b"\n" * (1 << 24), "more than 1000000 blank lines"),
        (b"\n", b"\n" * (1 << 24), "the file has no heading"),
        # of 64 bytes: one block holds more bad rows than are counted, but not millions of them
        (b"time [s],position [mm]\n0,1\n", (b"x" * 62 + b",\n") * (1 << 18), "nothing was imported"),
        (b"time [s],position [mm]\n0,1\n", (b"x" * 61 + b",x\n") * (1 << 18), "3: another heading"),
        (b"\ntime [s],position [mm]\n0,1\n", (b"1.1." * 15 + b"1,\n") * (1 << 18), "nothing was imported"),
    ],
)
def test_a_compressed_file_of_eleven_gigabytes_is_read_as_far_as_it_is_a_table(
    tmp_path: Path, rig: Rig, head: bytes, fill: bytes, said: str
) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(Endless(head, fill, (11 << 30) // len(fill)).written())
    assert said in refusal(path, rig)


def test_a_file_of_bad_rows_only_is_not_read_to_its_end(
    tmp_path: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_pass, "MOST_BAD", 100)
    path = tmp_path / "log.csv"
    path.write_text("time [s],position [mm]\n0,1\n" + "0,1\n" * 5000, encoding="utf-8")
    assert "5000 bad rows, 4980 of them not listed" in refusal(path, rig)


def test_a_truncated_gzip_file_is_reported_as_damaged(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "log.csv.gz"
    rows = "".join(f"{k},{k * 7919 % 1000}\n" for k in range(2000))
    whole = gzip.compress(f"time [s],position [mm]\n{rows}".encode())
    path.write_bytes(whole[: len(whole) // 2])
    assert "the file is damaged" in refusal(path, rig)


TEXTS = st.one_of(
    st.text(alphabet="time [s],;|\t\n\r\"'0123456789.-+eE:/TZ#NaN°\x00éposition [mm]", max_size=300),
    st.binary(max_size=300),
)


@given(head=st.sampled_from(["", "time [s],position [mm]\n", "time;position [mm]\n"]), body=TEXTS)
@settings(max_examples=75, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_imported_or_refused_with_one_message(rig: Rig, head: str, body: str | bytes) -> None:
    content = head.encode() + (body if isinstance(body, bytes) else body.encode("utf-8", "replace"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        path.write_bytes(content)
        try:
            import_file(path, rig, Path(folder) / "runs")
        except RigctlError as problem:
            assert str(problem)


# --- formats with readers of their own


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Readers have 3 s of a processor and little memory, and find `hostile_readers`."""
    monkeypatch.setattr(foreign, "_SECONDS", 3.0)
    monkeypatch.setattr(foreign, "_MEMORY", 400_000_000)
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    yield


@pytest.mark.parametrize(
    ("function", "said"),
    [
        ("crash", "the program that reads this format crashed over it"),
        ("never_end", "did not end within 3 s of processor time"),
        pytest.param("eat", "takes more than 0.4 GB of memory", marks=needs_posix("a limit of memory")),
        ("leave", "the program that reads this format crashed over it, got 'exit status 3'"),
    ],
)
def test_a_reader_that_crashes_or_hangs_gives_an_error_message(
    tmp_path: Path, hurried: None, function: str, said: str
) -> None:
    path = tmp_path / "log.mf4"
    path.write_bytes(b"MDF")
    with pytest.raises(RigctlError, match=said.replace("(", r"\(")):
        foreign.open_in_process(path, Options(), "hostile_readers", function)


def test_a_good_file_is_not_refused_because_the_computer_is_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit of time is for endless loops: importing its libraries takes a reader up to 10 s."""
    allowed: list[float] = []
    monkeypatch.setattr(foreign, "_start", lambda task: allowed.append(task["seconds"]) or 1)
    path = tmp_path / "log.mf4"
    for size in (3, 10_000_000):
        path.write_bytes(b"MDF" + bytes(size))
        with pytest.raises(RigctlError, match="crashed"):
            foreign.open_in_process(path, Options(), "hostile_readers", "crash")
    assert allowed[0] >= 60.0
    assert allowed[1] >= 100.0


def mdf() -> bytearray:
    """A sound file of 50 samples."""
    times = np.arange(50) * 0.01
    stream = io.BytesIO()
    with MDF(version="4.10") as made:
        made.append([Signal(np.sin(times), times, name="position", unit="mm")], common_timebase=True)
        made.save(stream)
    return bytearray(stream.getvalue())


def test_a_file_whose_blocks_form_a_cycle_is_refused_within_its_time_or_memory_limit(
    tmp_path: Path, rig: Rig, hurried: None
) -> None:
    content = mdf()
    block = content.find(b"##DG")
    content[block + 24 : block + 32] = struct.pack("<Q", block)  # its successor is itself
    path = tmp_path / "log.mf4"
    path.write_bytes(content)
    said = refusal(path, rig)
    assert "did not end within 3 s" in said or "of memory" in said


def test_a_truncated_file_is_refused_and_leaves_no_temporary_files(
    tmp_path: Path, rig: Rig, hurried: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "temporary"  # other tests import at the same time
    own.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(own))
    content = mdf()
    path = tmp_path / "log.mf4"
    path.write_bytes(content[: len(content) // 2])
    assert "log.mf4: " in refusal(path, rig)
    assert not list(own.glob("rigctl-import-*"))


def test_a_mat_file_that_crashes_scipy_is_reported_as_an_error(tmp_path: Path, rig: Rig) -> None:
    """Found by changing bytes of a valid file: SciPy crashes the interpreter with signal 7 or 11."""
    path = tmp_path / "log.mat"
    path.write_bytes((HERE / "crashes_scipy.mat").read_bytes())
    assert "log.mat: the file is" in refusal(path, rig)


@given(changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=6))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_parquet_file_with_changed_bytes_is_imported_or_refused_with_one_message(
    rig: Rig, changes: list[tuple[int, int]]
) -> None:
    stream = io.BytesIO()
    times = np.arange(50) * 0.01
    pq.write_table(pa.table({"time [s]": times, "position [mm]": np.sin(times)}), stream)
    content = bytearray(stream.getvalue())
    for place, byte in changes:
        content[place % len(content)] = byte
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.parquet"
        path.write_bytes(content)
        try:
            import_file(path, rig, Path(folder) / "runs", options=Options(resample="20 ms"))
        except RigctlError as problem:
            assert str(problem)
