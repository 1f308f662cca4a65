"""A sensor that was stuck for a while: named, and what it repeated is not taken for the bench's behaviour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from commands import answer, call, told
from rigctl.cli.commands.init import create_project

TIMES = 5.0 * np.arange(360)
MODEL = """
model: heater_board
rig: ../rigs/fine.yaml
parameters:
  heater_gain_1: {value: 1 W, fit: true}
  convection_1: {value: 16 mW/K, fit: true}
  ambient_temperature: {value: 23 degC, fit: true}
"""


def log(stuck: slice, channel: str = "temperature_1") -> pd.DataFrame:
    """A heater that is switched on after 200 s and off after 1000 s, with a time constant of 125 s."""
    on, off = np.clip(TIMES - 200.0, 0.0, 800.0), np.maximum(TIMES - 1000.0, 0.0)
    warm = 37.5 * (1.0 - np.exp(-on / 125.0)) * np.exp(-off / 125.0)
    noise = 0.06 * np.random.default_rng(5).standard_normal((2, TIMES.size))
    frame = pd.DataFrame(
        {
            "time [s]": TIMES,
            "temperature_1 [degC]": np.round(23.0 + warm + noise[0], 2),
            "temperature_2 [degC]": np.round(23.0 + noise[1], 2),
            "heater_1 [%]": np.where((TIMES >= 200.0) & (TIMES < 1000.0), 60.0, 0.0),
            "heater_2 [%]": 0.0,
        }
    )
    column = frame[f"{channel} [degC]"].to_numpy(copy=True)
    column[stuck] = column[stuck.start]
    frame[f"{channel} [degC]"] = column
    return frame


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _imported(frame: pd.DataFrame) -> str:
    frame.to_csv("log.csv", index=False)
    done = call("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    assert done.exit_code == 0, done.output
    return done.output


def test_it_is_named_and_what_it_repeated_counts_in_no_verdict(project: Path) -> None:
    said = "temperature_1 repeats one value exactly, "
    output = _imported(log(slice(215, 240)))
    assert said in output
    assert "from 1075 s to 1195 s (25 readings)" in output
    document = answer("compare", "latest", "--model", "models/heater-board.yaml")
    assert document["adequate"] is not False
    (note,) = (note for note in document["notes"] if note.startswith(said))
    assert "from 1075 s to 1195 s in " in note
    assert note.endswith("the sensor was stuck, and these readings are left out")
    assert document["channels"]["temperature_1"]["rmse"] < 0.1


def test_the_end_of_a_run_says_so_by_its_data_alone(project: Path) -> None:
    arguments = ("simulate", "procedures/quick-check.yaml", "--seed", "1")
    fault = ("--fault", "sensor_stuck:oil_temperature@8 s")
    assert "oil_temperature repeats one value exactly, 20 degC, from 8.15 s" in told(*arguments, *fault)
    assert answer(*arguments)["stuck"] == []
