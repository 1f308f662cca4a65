"""The same measurement twice in one import, which would count twice and be held out of a fit to itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset.importing import Options, import_files
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

BOARD = Path(__file__).parents[3] / "rigs" / "heater-board.yaml"


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(BOARD)


def rows(seed: int, start: float = 0.0, *, still: bool = False) -> str:
    noise = np.random.default_rng(seed).normal(0.0, 0.0 if still else 0.1, 40)
    return "".join(f"{start + k},{20.0 + value:.2f},0\n" for k, value in enumerate(noise))


HEAD = "time [s],temperature_1 [degC],heater_1 [%]\n"


def test_two_files_with_the_same_samples_are_refused(tmp_path: Path, board: Rig) -> None:
    paths = [tmp_path / "mon.csv", tmp_path / "tue.csv"]
    for path, start in zip(paths, (0.0, 500.0), strict=True):
        path.write_text(HEAD + rows(1, start), encoding="utf-8")
    with pytest.raises(RigctlError, match=r"record tue has the same samples as record mon.*--keep-good"):
        import_files(paths, board, tmp_path / "runs", Options())
    done = import_files(paths, board, tmp_path / "runs", Options(), keep_good=True)
    assert any("record tue has the same samples as record mon" in note for note in done.notes)
    paths[1].write_text(HEAD + rows(2), encoding="utf-8")
    assert import_files(paths, board, tmp_path / "runs", Options()).records == 2


def test_a_log_that_was_appended_to_itself_is_reported(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(1) + rows(1), encoding="utf-8")
    done = import_files([path], board, tmp_path / "runs", Options(times="split"))
    assert any("record 1 has the same samples as record 0" in note for note in done.notes)


def test_records_in_which_nothing_changes_are_no_copies(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "log.csv"
    path.write_text(HEAD + rows(1, still=True) + rows(1, still=True), encoding="utf-8")
    done = import_files([path], board, tmp_path / "runs", Options(times="split"))
    assert not any("same samples" in note for note in done.notes)
