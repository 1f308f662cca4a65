"""What a plain `uncertainty` brings to the numbers of a model that agrees, with its sensors taken for exact.

The covariance is compared with that of a fit with these errors among its unknowns, where a kind is stated.
"""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import answer, told

FAMILY = """
family: lag
states:
  level: {start: 0 V, scale: 10 V, rate: (gain*drive + offset - level)/lag}
inputs:
  drive: {value: 0 V, hold: linear}
parameters:
  lag: {value: 2 s, bounds: [0.1 s, 100 s]}
  gain: {value: 2, bounds: [0.1, 100]}
  offset: {value: 1 V, bounds: [-10 V, 10 V]}
outputs:
  level: {unit: V, formula: level}
"""
MODEL = (
    "model: ../families/lag.yaml\nrig: ../rigs/lag.yaml\nparameters: {lag: {value: 2 s, fit: true}, "
    "gain: {value: 2, fit: true}, offset: {value: 1 V, fit: true}}\n"
)
#: standard deviation of the noise of each reading, and the stated uncertainty of both channels, 95 %
NOISE, STATED = 0.02, 0.4
NUMBERS = ("lag", "gain", "offset")


def compared(folder: Path, *, level: str = "", drive: str = "", noise: float = NOISE) -> dict[str, Any]:
    """The comparison of a lag of 2 s with its own log, each channel with this calibration."""
    for name in ("families", "rigs", "models"):
        (folder / name).mkdir(parents=True)
    times = np.arange(2000) * 0.1
    drives = np.interp(times, np.arange(0.0, 201.0, 10.0), np.random.default_rng(2).uniform(0.0, 5.0, 21))
    course, value, fine = [], 0.0, 20
    for time in times:
        course.append(value)
        for step in range(fine):
            now = np.interp(time + 0.1 * step / fine, times, drives)
            value += 0.1 / fine * (2.0 * now + 1.0 - value) / 2.0
    read = np.array(course) + np.random.default_rng(3).normal(0.0, noise, times.size)
    rows = [f"{t:.1f},{u:.6f},{y:.6f}" for t, u, y in zip(times, drives, read, strict=True)]
    with chdir(folder):
        Path("log.csv").write_text("\n".join(["time [s],drive [V],level [V]", *rows]) + "\n", "utf-8")
        Path("families/lag.yaml").write_text(FAMILY, "utf-8")
        Path("models/lag.yaml").write_text(MODEL, "utf-8")
        Path("rigs/lag.yaml").write_text(
            "name: lag\nmodel: ../families/lag.yaml\nchannels:\n"
            f"  level: {{unit: V, quantity: other, noise: {noise} V{_calibration(level)}}}\n"
            f"  drive: {{unit: V, quantity: other{_calibration(drive)}}}\n",
            "utf-8",
        )
        told("import", "log.csv", "--rig", "rigs/lag.yaml")
        return answer("compare", "latest", "--model", "models/lag.yaml")


def _calibration(kind: str) -> str:
    if not kind:
        return ""
    return f", calibration: {{uncertainty: {STATED} V{'' if kind == 'plain' else f', kind: {kind}'}}}"


def stds(found: dict[str, Any]) -> dict[str, float]:
    return {name: found["parameters"][name]["std"] for name in NUMBERS}


@pytest.mark.parametrize("channel", ["level", "drive"])
def test_it_counts_in_every_number_as_a_stated_kind_does(tmp_path: Path, channel: str) -> None:
    exact = stds(compared(tmp_path / "exact"))
    plain = compared(tmp_path / "plain", **{channel: "plain"})
    free = stds(compared(tmp_path / "free", **{channel: "data_sheet"}))
    assert plain["adequate"] is True
    assert plain["explained_by"] is None
    assert stds(plain)["gain"] > 5.0 * exact["gain"]
    assert stds(plain) == pytest.approx(free, rel=0.1)
    first = {one["parameter"]: next(iter(one["shares"])) for one in plain["uncertainty_budget"]}
    assert first["gain"] == f"calibration of {channel}"


def test_more_readings_do_not_make_a_number_more_certain_than_its_sensor(tmp_path: Path) -> None:
    noisy = stds(compared(tmp_path / "noisy", level="plain"))
    quiet = stds(compared(tmp_path / "quiet", level="plain", noise=0.1 * NOISE))
    assert quiet["gain"] == pytest.approx(noisy["gain"], rel=0.1)
