"""An actuator that acts at another time or level each time is not taken for missing physics if its rig file
says so.

The bench is a first-order lag, whose response to steps is written down exactly.
"""

from __future__ import annotations

import csv
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import answer, refusal, told

FAMILY = """
family: duct
states:
  flow: {start: 0 m/s, scale: 0.1 m/s, rate: (gain*damper - flow)/lag}
inputs:
  damper: {value: 0 %}
parameters:
  gain: {value: 1.8 m/s, bounds: [0.1 m/s, 10 m/s]}
  lag: {value: 0.3 s, bounds: [10 ms, 10 s]}
outputs:
  flow: {unit: m/s, formula: flow}
"""
RIG = """
name: duct
model: family.yaml
channels:
  flow: {{unit: m/s, quantity: speed, noise: 0.01 m/s}}
actuators:
  damper: {{kind: level, unit: "%", low: 0 %, high: 100 %{stated}}}
safe_state: {{damper: 0 %}}
"""
MODEL = """
model: family.yaml
rig: rig.yaml
parameters:
  gain: {value: 1.8 m/s, fit: true}
  lag: {value: 0.3 s, fit: true}
"""
GAIN, LAG, NOISE = 2.0, 0.4, 0.01
#: standard deviation of the times at which the damper acts, s
JITTER = 0.03
#: relative standard deviation of a level that is set anew
REPEATABILITY = 0.05


def write_duct(
    stated: str,
    records: int,
    switches: int,
    *,
    late: float = 0.0,
    jitter: float = JITTER,
    repeats: float = 0.0,
) -> None:
    """Steps of a damper, each of which acts `late` and a random time later or earlier than recorded. Levels
    of one record are wrong by one random factor."""
    Path("family.yaml").write_text(FAMILY, "utf-8")
    Path("rig.yaml").write_text(RIG.format(stated=stated), "utf-8")
    Path("model.yaml").write_text(MODEL, "utf-8")
    rng, rows = np.random.default_rng(5), []
    for record in range(records):
        recorded = 0.5 + 0.9 * np.arange(switches)
        acted = recorded + late + jitter * rng.standard_normal(switches)
        levels = rng.choice([0.2, 0.5, 0.8, 1.0, 0.0], switches)
        times = np.arange(0.0, recorded[-1] + 2.0, 0.02)
        # each step of the input adds its own exponential: y = Σ gain·Δu·(1 − exp(−(t − t_k)/lag))
        since = np.clip(times[:, None] - acted, 0.0, None)
        factor = 1.0 + repeats * rng.standard_normal()
        flow = GAIN * factor * (1.0 - np.exp(-since / LAG)) @ np.diff(levels, prepend=0.0)
        flow += NOISE * rng.standard_normal(times.size)
        # a command is recorded with the sample that follows it
        commands = np.concatenate([[0.0], levels])[np.searchsorted(recorded, times, side="right")]
        rows += [(f"{t:.3f}", record, 100.0 * u, y) for t, u, y in zip(times, commands, flow, strict=True)]
    with Path("log.csv").open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([["time [s]", "record", "damper [%]", "flow [m/s]"], *rows])
    told("import", "log.csv", "--rig", "rig.yaml")


def judged(command: str = "compare") -> dict[str, Any]:
    return answer(command, "latest", "--model", "model.yaml")


def fitted(found: dict[str, Any], name: str) -> tuple[float, float]:
    one = found["parameters"][name]
    return float(one["value"]), float(one["std"])


@pytest.mark.parametrize(("records", "switches"), [(5, 4), (1, 30)], ids=["few switches", "many switches"])
def test_stated_jitter_explains_what_exact_times_cannot(tmp_path: Path, records: int, switches: int) -> None:
    with chdir(tmp_path):
        write_duct("", records, switches)
        exact = judged()
        write_duct(", jitter: 30 ms", records, switches)
        found = judged()
    assert not exact["adequate"]
    assert found["adequate"]
    assert any("scatter by ±60 ms" in note for note in found["notes"])
    for name, truth in (("gain", GAIN), ("lag", LAG)):
        value, std = fitted(found, name)
        assert abs(value - truth) < 3.0 * std < 0.03 * truth


@pytest.mark.parametrize(("records", "switches"), [(5, 4), (1, 30)], ids=["few switches", "many switches"])
def test_a_dead_time_far_beyond_the_jitter_is_an_effect(tmp_path: Path, records: int, switches: int) -> None:
    """What is the same at every switch is no scatter."""
    with chdir(tmp_path):
        write_duct(", jitter: 30 ms", records, switches, late=0.15)
        found = judged("diagnose")
    assert found["effects"] == ["dead_time_of_damper"]


def test_a_stated_repeatability_explains_levels_that_differ_from_record_to_record(tmp_path: Path) -> None:
    with chdir(tmp_path):
        write_duct("", 6, 4, jitter=0.0, repeats=REPEATABILITY)
        exact = judged()
        write_duct(", repeatability: 5 %", 6, 4, jitter=0.0, repeats=REPEATABILITY)
        found = judged()
    assert not exact["adequate"]
    assert found["adequate"]
    value, std = fitted(found, "gain")
    assert abs(value - GAIN) < 3.0 * std
    # what six settings can tell of their mean, however many readings each record has
    assert std == pytest.approx(GAIN * REPEATABILITY / 6**0.5, rel=0.1)


def test_a_negative_jitter_is_refused(tmp_path: Path) -> None:
    with chdir(tmp_path):
        Path("rig.yaml").write_text(RIG.format(stated=", jitter: -30 ms"), "utf-8")
        message = refusal("check", "rig.yaml")
    assert "jitter" in message
