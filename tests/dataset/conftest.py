"""A small bench and its runs, for the tests of the dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dataset.strokes import LAYOUT, STARTED, measure_strokes
from rigctl.dataset import RunHeader, RunWriter, Source

HeaderMaker = Callable[..., RunHeader]
RunMaker = Callable[..., Path]


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return tmp_path / "runs"


@pytest.fixture
def make_header() -> HeaderMaker:
    def make(run_id: str = "20261121-093000-stroke", **facts: object) -> RunHeader:
        known = {
            "procedure": Source("stroke", "procedure: stroke\n", path="procedures/stroke.yaml"),
            "rig": Source("bench", "name: bench\n", path="rigs/bench.yaml"),
            "layout": LAYOUT,
            "started": STARTED,
            "backend": {"kind": "simulated", "firmware": "1.2"},
            "operator": "Ada",
            "clock": "virtual",
            "seed": 7,
            "calibrations": {"position": {"quantity": "position", "date": "2026-01-02"}},
        }
        return RunHeader(id=run_id, **{**known, **facts})  # type: ignore[arg-type]

    return make


@pytest.fixture
def writer(runs: Path, make_header: HeaderMaker) -> Iterator[RunWriter]:
    """A run that has just begun; its files are released even after a failed test."""
    made = RunWriter.create(runs, make_header())
    yield made
    for part in (made._journal, made._log):
        part.close()
    made._lock.release()


@pytest.fixture
def make_run(runs: Path, make_header: HeaderMaker) -> RunMaker:
    """A finished run on disk."""

    def make(run_id: str = "20261121-093000-stroke", records: int = 3, rows: int = 20) -> Path:
        writer = RunWriter.create(runs, make_header(run_id))
        measure_strokes(writer, records, rows)
        return writer.close("finished")

    return make
