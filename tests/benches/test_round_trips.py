"""A run of a shipped rig that goes out to a file and comes in again: same samples, same judgement."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from commands import answer, told
from rigctl.cli.init import create_project
from rigctl.dataset import open_run

FORMATS = ("csv", "parquet", "tdms", "mf4", "mat")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("round-trips") / "project"
    create_project(folder)
    return folder


@pytest.fixture(autouse=True)
def here(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)


@pytest.fixture(scope="module")
def strokes(project: Path) -> Path:
    """Two strokes of the cylinder with the textbook model as the truth."""
    with chdir(project):
        arguments = ["procedures/quick-check.yaml", "--plant", "models/hl32-textbook.yaml", "--seed", "2"]
        return Path(answer("simulate", *arguments)["path"])


def samples(run: Path) -> pd.DataFrame:
    return open_run(run).samples().reset_index(drop=True)


def came_back(run: Path, ending: str, rig: str) -> Path:
    told("export", str(run), "-o", f"out.{ending}", "--overwrite")
    return Path(answer("import", f"out.{ending}", "--rig", f"rigs/{rig}.yaml")["path"])


@pytest.mark.parametrize("ending", FORMATS)
def test_every_format_gives_back_every_sample_of_a_run(strokes: Path, ending: str) -> None:
    """Also those between the records, of which two share a time where the rate changes."""
    before, after = samples(strokes), samples(came_back(strokes, ending, "hl32-bench"))
    assert len(after) == len(before)
    assert list(after["record"]) == list(before["record"])
    for column in before.columns:
        if column in after.columns and column not in ("record", "time"):
            assert np.allclose(after[column], before[column], rtol=1e-9, atol=1e-9, equal_nan=True), column
    for _, rows in after.groupby("record"):
        assert np.all(np.diff(rows["time"]) >= 0.0)


STEPS = ("-a", "powers=20 %, 80 %, 50 %, 10 %", "-a", "second=30 %", "-a", "dwell=6 min", "--seed", "3")


@pytest.mark.parametrize("hidden", [None, "radiation"])
def test_a_heater_boards_verdict_is_the_same_after_the_way_through_a_file(hidden: str | None) -> None:
    hide = ("--with", hidden) if hidden else ()
    run = Path(answer("simulate", "procedures/heater-board-steps.yaml", *STEPS, *hide)["path"])
    paths = (run, came_back(run, "mat", "heater-board"))
    found = [answer("diagnose", str(path), "--model", "models/heater-board.yaml") for path in paths]
    for one in found:
        assert (one["verdict"] == "adequate") == (hidden is None), one["statement"]
        assert one["effects"] == ([hidden] if hidden else []), one["statement"]
    assert found[0]["verdict"] == found[1]["verdict"]


def test_the_true_model_agrees_with_strokes_that_went_through_a_file(strokes: Path) -> None:
    found = answer(
        "compare", str(came_back(strokes, "mf4", "hl32-bench")), "--model", "models/hl32-textbook.yaml"
    )
    assert found["adequate"], found["statement"]
