"""Export and import of a run of a shipped rig: same samples, same verdict."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from commands import answer, told
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run

pytestmark = pytest.mark.usefixtures("shared_results")

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
def test_every_sample_of_a_run_survives_export_and_import_in_every_format(strokes: Path, ending: str) -> None:
    """Samples between records are included; two of them share a time where the rate changes."""
    before, after = samples(strokes), samples(came_back(strokes, ending, "hl32-bench"))
    assert len(after) == len(before)
    assert list(after["record"]) == list(before["record"])
    for column in before.columns:
        if column in after.columns and column not in ("record", "time"):
            assert np.allclose(after[column], before[column], rtol=1e-9, atol=1e-9, equal_nan=True), column
    for _, rows in after.groupby("record"):
        assert np.all(np.diff(rows["time"]) >= 0.0)


STEPS = (
    "procedures/heater-board-steps.yaml",
    *("-a", "powers=20 %, 80 %, 50 %, 10 %", "-a", "second=30 %", "-a", "dwell=6 min"),
)
#: the second of two strokes starts at the pressure that the closed valve has trapped in the first one
TWO_STROKES = ("procedures/campaign.yaml", "-a", "temperatures=40 degC", "-a", "pressures=50 bar, 20 bar")
ONE_STROKE = (*TWO_STROKES[:-1], "pressures=50 bar")
LOADED = "constant_load:force=300 N"


@pytest.mark.parametrize(
    ("rig", "steps", "ending", "hidden"),
    [
        ("heater-board", STEPS, "mat", None),
        ("heater-board", STEPS, "xlsx", "radiation"),
        ("tclab-board", STEPS, "csv", "heater_coupling"),
        ("hl32-bench-instrumented", TWO_STROKES, "mf4", None),
        ("hl32-bench-instrumented", ONE_STROKE, "parquet", LOADED),
    ],
)
def test_a_verdict_survives_export_and_import(
    rig: str, steps: tuple[str, ...], ending: str, hidden: str | None
) -> None:
    """All rigs with all formats: ``python -m benchmarks.round_trips``."""
    model = "heater-board" if steps is STEPS else "hl32-textbook"
    hide = ("--with", hidden) if hidden else ()
    run = Path(answer("simulate", *steps, "--rig", f"rigs/{rig}.yaml", "--seed", "3", *hide)["path"])
    paths = (run, came_back(run, ending, rig))
    ask = ("--model", f"models/{model}.yaml", "--max-effects", "1")
    found = [answer("diagnose", str(path), *ask) for path in paths]
    for one in found:
        assert (one["verdict"] == "adequate") == (hidden is None), one["statement"]
        assert one["effects"] == ([hidden.partition(":")[0]] if hidden else []), one["statement"]
    assert found[0]["verdict"] == found[1]["verdict"]


def test_an_inadequate_model_has_the_same_chi2_on_a_run_and_on_its_export() -> None:
    rig, hide = "hl32-bench-uno", ("--with", LOADED)
    run = Path(answer("simulate", *ONE_STROKE, "--rig", f"rigs/{rig}.yaml", "--seed", "3", *hide)["path"])
    paths = (run, came_back(run, "tdms", rig))
    found = [answer("compare", str(path), "--model", "models/hl32-textbook.yaml") for path in paths]
    assert not any(one["adequate"] for one in found)
    # the switching times are now known only to within a sample, and absorb part of the misfit
    assert found[1]["chi2_reduced"] == pytest.approx(found[0]["chi2_reduced"], rel=0.3)
