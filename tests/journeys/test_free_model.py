"""What a free model reaches on a log: nothing where the model is right, the noise where something is missing.

The bench is integrated here, and the truth does not come from the product.
"""

from __future__ import annotations

from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, told
from rigctl.analysis.agreement.achievable_error import achievable_errors
from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.comparison import compare
from rigctl.answers.blocks import Sentence
from rigctl.answers.comparison import comparison_answer
from rigctl.dataset import open_run
from rigctl.model.load import load_model

Floats = NDArray[np.float64]
FAMILY = """
family: lag
states:
  level: {start: 0 V, scale: 10 mV, rate: (gain*drive - level)/lag}
inputs:
  drive: {value: 0 V}
parameters:
  lag: {value: 2 s, bounds: [0.1 s, 100 s]}
  gain: {value: 1, bounds: [0.1, 100]}
outputs:
  level: {unit: V, formula: level}
"""
RIG = """
name: lag
model: ../families/lag.yaml
channels:
  level: {unit: V, quantity: voltage, noise: NOISE V}
actuators:
  drive: {kind: level, unit: V, low: -9 V, high: 9 V}
safe_state: {drive: 0 V}
"""
MODEL = """
model: ../families/lag.yaml
rig: ../rigs/lag.yaml
parameters: {lag: {value: 2 s, fit: true}, gain: {value: 1, fit: true}}
"""
NOISE = 0.02


def measured(
    folder: Path,
    seed: int,
    *,
    bend: float = 0.0,
    stated: float = NOISE,
    slow: float = 0.0,
    loop: float = 0.0,
) -> str:
    """Import the log of a lag of 2 s behind ``2·u + bend·u²``, with white noise and a slow one; its run.

    With `loop`, the drive is that many times the reading's distance from the set-point, at irregular times.
    """
    for name in ("families", "rigs", "models"):
        (folder / name).mkdir(exist_ok=True)
    random = np.random.default_rng(seed)
    drives = np.repeat(random.uniform(0.0, 3.0, 60), 50)
    level, wander, time, rows = 0.0, 0.0, 0.0, []
    for drive in drives:
        wander = 0.99 * wander + random.normal(0.0, slow * np.sqrt(1.0 - 0.99**2))
        read = level + wander + random.normal(0.0, NOISE)
        given = float(np.clip(loop * (drive - read), -9.0, 9.0)) if loop else float(drive)
        rows.append(f"{time:.4f},{given:.6f},{read:.6f}")
        step = 0.1 + (random.uniform(-0.02, 0.02) if loop else 0.0)
        aim = 2.0 * given + bend * given**2
        level = aim + (level - aim) * np.exp(-step / 2.0)
        time += step
    (folder / "log.csv").write_text("\n".join(["time [s],drive [V],level [V]", *rows]) + "\n", "utf-8")
    (folder / "families/lag.yaml").write_text(FAMILY, "utf-8")
    (folder / "rigs/lag.yaml").write_text(RIG.replace("NOISE", f"{stated:g}"), "utf-8")
    (folder / "models/lag.yaml").write_text(MODEL, "utf-8")
    with chdir(folder):
        return told("import", "log.csv", "--rig", "rigs/lag.yaml").split()[0]


def compared(folder: Path) -> dict[str, Any]:
    with chdir(folder):
        return answer("compare", "latest", "--model", "models/lag.yaml")


def test_a_missing_term_is_within_reach_of_a_free_model(tmp_path: Path) -> None:
    measured(tmp_path, 1, bend=0.2)
    found = compared(tmp_path)
    (one,) = found["achievable"]
    assert found["adequate"] is False
    assert one["beats"]
    assert one["model"] == pytest.approx(found["channels"]["level"]["rmse"], rel=0.01)
    assert one["share"] > 0.7
    assert NOISE < one["free"] < 0.5 * one["model"]
    with chdir(tmp_path):
        printed = " ".join(told("compare", "latest", "--model", "models/lag.yaml").split())
    assert "free model reaches 0.0" in printed


def test_a_model_that_every_test_passes_is_contradicted(tmp_path: Path) -> None:
    run = open_run(tmp_path / "runs" / measured(tmp_path, 1, bend=0.2))
    found = compare([run], [load_model(tmp_path / "models/lag.yaml")])
    blind = {name: replace(test, p_value=1.0) for name, test in found.models[0].adequacy.tests.items()}
    (model,) = (replace(one, adequacy=Adequacy(blind)) for one in found.models)
    assert model.adequate
    assert model.contradicted
    assert model.document()["contradicted"]
    given = comparison_answer(replace(found, models=(model,)))
    assert (given.tone, given.title) == ("open", "Cannot tell")
    said = [block.text for block in given.remarks if isinstance(block, Sentence)]
    assert any("A free model contradicts this: from the inputs it predicts 8" in text for text in said)


@pytest.mark.parametrize(
    ("slow", "loop"), [(0.0, 0.0), (0.05, 0.0), (0.0, 3.0)], ids=["white", "slow", "in a closed loop"]
)
def test_a_right_model_is_beaten_by_chance_in_no_log(tmp_path: Path, slow: float, loop: float) -> None:
    """Rate 1e-3 for each log; of eight none, which a rate of 0.31 gives in 5 % of such tests."""
    beaten = []
    for seed in range(10, 18):
        run = open_run(tmp_path / "runs" / measured(tmp_path, seed, slow=slow, loop=loop))
        (model,) = compare([run], [load_model(tmp_path / "models/lag.yaml")]).models
        (one,) = achievable_errors(model.fit)
        assert one.free > 0.7 * one.model  # slow noise is followed a little, by chance
        beaten += [one.p_value] if one.beats else []
    assert beaten == []


def test_a_log_of_few_readings_and_a_table_have_none(tmp_path: Path) -> None:
    measured(tmp_path, 3)
    log = tmp_path / "log.csv"
    log.write_text("\n".join(log.read_text("utf-8").splitlines()[:200]) + "\n", "utf-8")
    with chdir(tmp_path):
        told("import", "log.csv", "--rig", "rigs/lag.yaml")
    assert compared(tmp_path)["achievable"] == []
