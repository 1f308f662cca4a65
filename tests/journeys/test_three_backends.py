"""One procedure on three benches: simulated, with the board's firmware, and replayed.

The campaign is the shipped one with its own arguments: a temperature one kelvin above the bench's and two
pressures instead of seven and four, since the emulated board passes through the heating at no more than ten
times real time.
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from commands import answer
from rigctl.dataset import Run, open_run
from rigctl.files.shipped import shipped
from systems import own_state

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")

PROCEDURES = {
    "quick-check": (),
    "campaign": ("--arg", "temperatures=21 degC", "--arg", "pressures=20 bar, 40 bar"),
}
#: standard deviation of a reading: noise of the sensor and resolution of the converter, in the channel's unit
SIGMA = {
    "oil_temperature": np.hypot(0.1, 0.1955 / 12**0.5),
    "supply_pressure": np.hypot(0.08, 0.1222 / 12**0.5),
    "position": np.hypot(0.1, 0.2933 / 12**0.5),
}


@pytest.mark.parametrize("name", PROCEDURES)
def test_a_procedure_gives_the_same_records_on_three_benches(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for variable, value in own_state(tmp_path / "state").items():
        monkeypatch.setenv(variable, value)
    simulated = carried_out(name, "--backend", "simulated", "--seed", "3")
    emulated = carried_out(name, "--backend", "emulated", "--seed", "4")
    replayed = carried_out(name, "--backend", "replay", emulated.id)
    assert list(simulated.records["name"]) == list(emulated.records["name"]) == list(replayed.records["name"])
    for record in range(len(simulated.records)):
        agree(simulated, emulated, record)
        is_the_same(emulated, replayed, record)


def carried_out(name: str, *bench: str) -> Run:
    procedure, rig = shipped("procedures", f"{name}.yaml"), shipped("rigs", "hl32-bench-uno.yaml")
    how = ("--rig", str(rig), "--speed", "max")
    done = answer("run", str(procedure), *bench[2:], *bench[:2], *PROCEDURES[name], *how)
    assert (done["status"], done["exit_code"]) == ("finished", 0), done["reason"]
    return open_run(Path(done["path"]))


def phases(run: Run, record: int) -> list[pd.DataFrame]:
    """A record's samples from each switch of the valve to the next; time counts from the switch."""
    samples = run.samples()
    rows = samples[samples["record"] == record]
    first, last = rows["time"].iloc[0], rows["time"].iloc[-1]
    switched = [
        row.time
        for row in run.events.itertuples()
        if row.kind == "command" and json.loads(row.data)["actuator"] == "valve" and first < row.time < last
    ]
    cut = [(a, rows[(rows["time"] > a) & (rows["time"] < b)]) for a, b in pairwise([*switched, last])]
    return [phase.assign(time=phase["time"] - a) for a, phase in cut if len(phase) > 10]


def agree(one: Run, other: Run, record: int) -> None:
    """Two traces differ by their noise: the mean square of the difference is that of two independent
    readings, and the means differ no more than so many readings and a switch known to a millisecond let
    them."""
    for mine, theirs in zip(phases(one, record), phases(other, record), strict=True):
        times = mine["time"][mine["time"].between(theirs["time"].iloc[0], theirs["time"].iloc[-1])]
        assert len(times) > 0.97 * max(len(mine), len(theirs))
        for channel, sigma in SIGMA.items():
            off = np.interp(times, mine["time"], mine[channel]) - np.interp(
                times, theirs["time"], theirs[channel]
            )
            assert np.mean((off / sigma) ** 2) < 2.0 * 1.5, f"{channel} of record {record}"
            assert abs(np.mean(off / sigma)) < 0.8, f"{channel} of record {record}"


def is_the_same(one: Run, other: Run, record: int) -> None:
    """A played recording is the recording, sample by sample."""
    for mine, theirs in zip(phases(one, record), phases(other, record), strict=True):
        both = pd.merge_asof(mine, theirs, on="time", direction="nearest", tolerance=1e-3).dropna(
            subset="position_y"
        )
        assert len(both) > 0.97 * len(mine)
        for channel in SIGMA:
            assert (both[f"{channel}_x"] == both[f"{channel}_y"]).all()
