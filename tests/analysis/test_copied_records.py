"""A record that was measured once and is there twice: fitted once, and never held out of a fit to itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rigctl
from rigctl.analysis.fitting import Data, read_runs
from rigctl.dataset import Run
from rigctl.dataset.importing import Options, import_file, import_files
from rigctl.dataset.importing.formats import formats
from rigctl.errors import RigctlError
from rigctl.model import Model
from rigctl.rig import load_rig

RIG = Path(__file__).parents[2] / "rigs" / "heater-board.yaml"
MODEL = f"""
model: heater_board
rig: {RIG.as_posix()}
parameters:
  heater_gain_1: {{value: 1.33 W, fit: true}}
"""
TIMES = np.arange(0.0, 200.0, 5.0)


def frame(seed: int, start: float = 0.0) -> pd.DataFrame:
    """A log of one heater being switched on, with the noise of `seed`."""
    rng = np.random.default_rng(seed)
    warm = 30.0 * (1.0 - np.exp(-np.maximum(TIMES - 40.0, 0.0) / 150.0))
    return pd.DataFrame(
        {
            "time [s]": start + TIMES,
            "temperature_1 [degC]": np.round(23.0 + warm + 0.1 * rng.standard_normal(TIMES.size), 2),
            "temperature_2 [degC]": np.round(23.0 + 0.1 * rng.standard_normal(TIMES.size), 2),
            "heater_1 [%]": np.where(TIMES < 40.0, 0.0, 60.0),
            "heater_2 [%]": 0.0,
        }
    )


class Logs:
    """Imports logs as runs of one project."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "board.yaml").write_text(MODEL, encoding="utf-8")
        self.model: Model = rigctl.load_model(folder / "board.yaml")

    def run(self, *logs: pd.DataFrame, kind: str = "csv", keep_good: bool = False, **options: str) -> Run:
        number = len(list(self.folder.iterdir()))
        paths = [self.folder / f"log{number}-{k}.{kind}" for k in range(len(logs))]
        for path, log in zip(paths, logs, strict=True):
            match kind:
                case "csv":
                    log.to_csv(path, index=False)
                case "xlsx":
                    log.to_excel(path, index=False)
                case _:
                    log.to_parquet(path)
        done = import_files(
            paths, load_rig(RIG), self.folder / "runs", Options(**options), keep_good=keep_good
        )
        return rigctl.open_run(done.path)

    def data(self, *runs: Run, hold_out: str | None = None, only: str | None = None) -> Data:
        return read_runs(self.model, runs, hold_out=hold_out, only=only)


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Logs:
    monkeypatch.setattr(formats, "isolated", False)
    return Logs(tmp_path)


def labels(data: Data) -> list[str]:
    return [record.label for record in data.measurements.records]


@pytest.mark.parametrize("kind", ["csv", "xlsx", "parquet"])
def test_a_record_of_two_runs_is_fitted_once_and_not_held_out(logs: Logs, kind: str) -> None:
    first = logs.run(frame(1), frame(2), frame(3))
    again = logs.run(frame(2, start=500.0), frame(4), kind=kind)
    data = logs.data(first, again, hold_out="record > 3")
    assert labels(data) == [f"{first.id}/0", f"{first.id}/1", f"{first.id}/2", f"{again.id}/1"]
    assert data.held_out == (3,)
    said = f"{again.id}/0 has the same samples as {first.id}/1: it is not held out, as the fit has seen them"
    assert said in map(str, data.measurements.notes)
    data = logs.data(first, again)
    assert len(labels(data)) == 4
    counted = f"{again.id}/0 has the same samples as {first.id}/1: it counts once"
    assert counted in map(str, data.measurements.notes)


def test_the_copy_that_is_fitted_is_kept_whichever_comes_first(logs: Logs) -> None:
    first, again = logs.run(frame(1), frame(2)), logs.run(frame(2), frame(3))
    data = logs.data(first, again, hold_out="record <= 2")
    assert labels(data) == [f"{first.id}/0", f"{again.id}/0", f"{again.id}/1"]
    assert data.held_out == (0,)
    # among the records that are selected
    data = logs.data(first, again, only="record > 2", hold_out="record == 2")
    assert labels(data) == [f"{again.id}/0", f"{again.id}/1"]
    assert data.held_out == (1,)


def test_holding_out_nothing_but_copies_is_refused(logs: Logs) -> None:
    run = logs.run(frame(1), frame(1), keep_good=True)
    with pytest.raises(RigctlError, match="nothing that is held out is unseen") as caught:
        logs.data(run, hold_out="record == 1")
    assert f"{run.id}/0 has the same samples as {run.id}/1" in str(caught.value)
    assert len(labels(logs.data(run))) == 1


def test_a_copy_without_one_of_the_channels_is_a_copy(logs: Logs) -> None:
    first = logs.run(frame(1), frame(2))
    again = logs.run(frame(2).drop(columns="temperature_2 [degC]"), frame(3))
    assert len(labels(logs.data(first, again))) == 3


def test_repeated_measurements_are_no_copies(logs: Logs) -> None:
    data = logs.data(logs.run(frame(1), frame(2), frame(3)))
    assert len(labels(data)) == 3
    assert not any("same samples" in str(note) for note in data.measurements.notes)


def test_a_copy_of_which_a_value_was_edited_is_a_copy(logs: Logs) -> None:
    edited = frame(1)
    edited.loc[20, "temperature_1 [degC]"] += 0.01
    assert len(labels(logs.data(logs.run(frame(1), frame(2)), logs.run(edited)))) == 2


def seen(data: Data) -> list[int]:
    """Numbers of samples of each record that count."""
    return [int(record.here.any(axis=1).sum()) for record in data.measurements.records]


@pytest.mark.parametrize("hold_out", [None, "record == 1", "record == 2"])
def test_two_exports_that_overlap_count_their_common_samples_once(logs: Logs, hold_out: str | None) -> None:
    """The end of the earlier one is left out, so that the later one keeps its initial values."""
    log = frame(1)
    earlier, later = logs.run(log.iloc[:30]), logs.run(log.iloc[8:])
    data = logs.data(earlier, later, hold_out=hold_out)
    assert seen(data) == [8, 32]
    said = f"{earlier.id}/0 has 22 samples, from 40 s to 145 s, that are in {later.id}/0 too: they count once"
    assert said in map(str, data.measurements.notes)


def test_a_part_of_a_record_is_no_unseen_record(logs: Logs) -> None:
    log = frame(1)
    whole, part = logs.run(log, frame(2)), logs.run(log.iloc[5:30])
    data = logs.data(whole, part)
    assert labels(data) == [f"{whole.id}/0", f"{whole.id}/1"]
    with pytest.raises(RigctlError, match="nothing that is held out is unseen"):
        logs.data(whole, part, hold_out="record == 3")
    # the other way round, the part is fitted, and the rest of the record is unseen
    data = logs.data(whole, part, hold_out="record == 1")
    assert (seen(data), data.held_out) == ([15, 40, 25], (0,))


def test_three_exports_count_every_sample_once(logs: Logs) -> None:
    log = pd.concat([frame(1), frame(2, start=200.0), frame(3, start=400.0)], ignore_index=True)
    runs = [logs.run(log.iloc[:60]), logs.run(log.iloc[30:90]), logs.run(log.iloc[60:])]
    assert sum(seen(logs.data(*runs))) == len(log)


def test_records_that_are_alike_for_a_while_are_no_copies(logs: Logs) -> None:
    """Without noise, as in a simulation, equal beginnings give equal readings."""
    one, other = frame(1), frame(2)
    other.iloc[:30] = one.iloc[:30]
    assert seen(logs.data(logs.run(one), logs.run(other))) == [40, 40]


def test_equal_readings_after_other_commands_are_no_copies(logs: Logs) -> None:
    other = frame(1)
    other["heater_2 [%]"] = 20.0
    assert len(labels(logs.data(logs.run(frame(1)), logs.run(other)))) == 2


def test_a_whole_run_that_was_imported_twice_counts_once(logs: Logs) -> None:
    path = logs.folder / "log.csv"
    frame(1).to_csv(path, index=False)
    runs = [rigctl.open_run(import_file(path, load_rig(RIG), logs.folder / "runs").path) for _ in range(2)]
    data = logs.data(*runs)
    assert labels(data) == [f"{runs[0].id}/0"]
    said = f"{runs[1].id}/0 has the same samples as {runs[0].id}/0: it counts once"
    assert said in map(str, data.measurements.notes)
    with pytest.raises(RigctlError, match="nothing that is held out is unseen"):
        logs.data(*runs, hold_out="record == 2")


def test_rows_of_a_table_that_was_imported_twice_count_once(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    table = (root / "data" / "hl32-strokes.csv").read_text(encoding="utf-8").splitlines()
    again = tmp_path / "more.csv"
    head = next(at for at, line in enumerate(table) if line.startswith("oil_temperature"))
    again.write_text("\n".join([*table[: head + 1], *table[head + 3 : head + 15]]), encoding="utf-8")
    rig = load_rig(root / "rigs" / "hl32-bench.yaml")
    model = rigctl.load_model(root / "models" / "hl32-textbook.yaml")
    runs = [
        rigctl.open_run(import_file(path, rig, tmp_path / "runs").path)
        for path in (root / "data" / "hl32-strokes.csv", root / "data" / "hl32-strokes.csv", again)
    ]
    assert len(labels(read_runs(model, runs))) == len(labels(read_runs(model, runs[:1])))
