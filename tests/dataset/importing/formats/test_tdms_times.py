"""Times of LabVIEW's waveforms: parts that were appended, and channels with their own starts and rates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

BOARD = Path(__file__).parents[4] / "rigs" / "heater-board.yaml"
NINE = np.datetime64("2026-06-01T09:00:00", "us")


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(BOARD)


def channel(name: str, values: np.ndarray, start: float | None, step: float = 1.0) -> ChannelObject:
    properties: dict[str, Any] = {"wf_increment": step, "wf_start_offset": 0.0, "unit_string": UNITS[name]}
    if start is not None:
        properties["wf_start_time"] = NINE + np.timedelta64(round(1e6 * start), "us")
    return ChannelObject("run", name, values, properties)


UNITS = {"temperature_1": "degC", "heater_1": "%"}


def written(path: Path, *segments: list[ChannelObject]) -> Path:
    for number, segment in enumerate(segments):
        with TdmsWriter(str(path), mode="a" if number else "w") as writer:
            writer.write_segment(segment)
    return path


def imported(file: Path, board: Rig, **options: Any) -> tuple[Run, tuple[str, ...]]:
    done = import_file(file, board, file.parent / "runs", options=Options(**options))
    return open_run(done.path), done.notes


def part(start: float | None, count: int = 30) -> list[ChannelObject]:
    return [
        channel("temperature_1", 20.0 + np.arange(count) / 8, start),
        channel("heater_1", np.zeros(count), start),
    ]


def test_a_part_appended_after_a_stop_keeps_its_time(tmp_path: Path, board: Rig) -> None:
    file = written(tmp_path / "log.tdms", part(0.0), part(200.0))
    run, notes = imported(file, board)
    times = run.samples()["time"].to_numpy()
    assert times.tolist() == [*np.arange(30.0), *(200.0 + np.arange(30.0))]
    assert run.info["started"].startswith("2026-06-01T09:00:00")
    assert any("gaps in time in 1 of 1 records" in note for note in notes)
    assert len(imported(file, board, split="gap")[0].records) == 2


def test_parts_written_one_after_the_other_are_one(tmp_path: Path, board: Rig) -> None:
    """A program may write the start of each piece although it never stopped, or only with the first."""
    for later in (30.0, 0.0):
        run, _ = imported(written(tmp_path / "log.tdms", part(0.0), part(later)), board)
        assert run.samples()["time"].to_numpy().tolist() == list(range(60))
    run, _ = imported(written(tmp_path / "log.tdms", part(None), part(None)), board)
    assert run.samples()["time"].to_numpy().tolist() == list(range(60))


def test_a_part_that_begins_before_the_last_one_ended_is_refused(tmp_path: Path, board: Rig) -> None:
    with pytest.raises(RigctlError, match="does not increase"):
        imported(written(tmp_path / "log.tdms", part(0.0), part(10.0)), board)


def test_resampling_brings_channels_with_their_own_clocks_together(tmp_path: Path, board: Rig) -> None:
    """One channel starts half a minute later, or has another rate and so another number of samples."""
    times = np.arange(0.0, 60.0, 0.5)
    slow = channel("temperature_1", 20.0 + np.arange(30) / 8, 10.0, 2.0)
    fast = channel("heater_1", np.where(times < 30.0, 0.0, 60.0), 0.0, 0.5)
    for first, second in ((slow, fast), (fast, slow)):
        file = written(tmp_path / "log.tdms", [first, second])
        with pytest.raises(RigctlError, match=r"--resample|different lengths"):
            imported(file, board)
        run, _ = imported(file, board, resample="1 s")
        samples = run.samples()
        assert run.info["started"].startswith("2026-06-01T09:00:00")
        at = samples["time"].to_numpy()
        inside = (at >= 10.0) & (at <= 68.0)
        assert np.allclose(samples["temperature_1"][inside], 20.0 + (at[inside] - 10.0) / 16.0)
        assert samples["temperature_1"][~inside].isna().all()
        assert np.all(samples["heater_1"][at < 60.0] == np.where(at[at < 60.0] < 30.0, 0.0, 60.0))


def test_channels_that_start_at_other_times_name_the_option(tmp_path: Path, board: Rig) -> None:
    late = [channel("temperature_1", np.arange(30.0), 30.0), channel("heater_1", np.zeros(30), 0.0)]
    file = written(tmp_path / "log.tdms", late)
    with pytest.raises(RigctlError, match=r"start at different times.*--resample '1 s'"):
        imported(file, board)
    samples = imported(file, board, resample="1 s")[0].samples()
    assert samples["temperature_1"].isna().sum() == 30
