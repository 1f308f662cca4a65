"""Which inputs are smoothed: readings with a stated or visible noise, and never a command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, told
from rigctl.model.measured.input_floor import measured_noise

Floats = NDArray[np.float64]

FAMILY = """
family: lag
states:
  level: {start: 0 V, scale: 10 mV, rate: (drive - level)/lag}
inputs:
  drive: {value: 0 V, hold: HOLD}
parameters:
  lag: {value: 2 s, bounds: [0.1 s, 100 s]}
outputs:
  level: {unit: V, formula: level}
"""
RIG = """
name: lag
model: families/lag.yaml
channels:
  level: {unit: V, quantity: other}
"""
MODEL = "model: families/lag.yaml\nrig: rigs/lag.yaml\nparameters: {lag: {value: 2 s, fit: true}}\n"
AS_CHANNEL = "  drive: {unit: V, quantity: other}\n"
AS_ACTUATOR = "actuators:\n  drive: {kind: level, unit: V}\nsafe_state: {drive: 0 V}\n"
TIMES = np.arange(800) * 0.1


def switched(random: np.random.Generator, hold: int = 9) -> Floats:
    """A heater switched at random between two levels."""
    return np.repeat(random.integers(0, 2, 800 // hold + 1), hold)[:800] * 3.0 + 3.41


def multisine(random: np.random.Generator) -> Floats:
    """All frequencies up to two thirds of the Nyquist frequency, random phases."""
    phases = random.uniform(0.0, 2.0 * np.pi, 266)
    lines = np.arange(1, 267)[:, None] * TIMES[None, :] * (2.0 * np.pi / 80.0)
    return np.asarray(np.cos(lines + phases[:, None]).sum(axis=0) / np.sqrt(133.0))


def smooth(random: np.random.Generator) -> Floats:
    return np.asarray(5.0 * np.sin(TIMES / 6.0) + 2.0 * np.sin(TIMES / 2.3 + 1.0))


@pytest.mark.parametrize("signal", [switched, multisine])
def test_a_command_has_no_noise_although_it_never_rests(signal: object) -> None:
    random = np.random.default_rng(5)
    assert measured_noise([TIMES], [signal(random)]) is None  # type: ignore[operator]


def test_white_noise_alone_is_not_told_from_a_random_command() -> None:
    random = np.random.default_rng(6)
    assert measured_noise([TIMES], [random.normal(0.0, 1.0, 800)]) is None


@pytest.mark.parametrize("irregular", [False, True])
def test_the_noise_of_readings_is_found_below_their_motion(irregular: bool) -> None:
    random = np.random.default_rng(7)
    times = TIMES + (random.uniform(0.0, 0.08, 800) if irregular else 0.0)
    true = 5.0 * np.sin(times / 6.0) + 2.0 * np.sin(times / 2.3 + 1.0)
    sigma = measured_noise([times], [true + random.normal(0.0, 0.2, 800)])
    assert sigma == pytest.approx(0.2, rel=0.1)


def test_a_polyline_read_exactly_at_irregular_times_has_no_noise() -> None:
    random = np.random.default_rng(8)
    times = np.arange(400) * 7.5 + random.uniform(0.0, 6.0, 400)
    knots = np.linspace(0.0, 3000.0, 16)
    assert measured_noise([times], [np.interp(times, knots, random.uniform(15.0, 25.0, 16))]) is None


def notes_of(
    folder: Path, monkeypatch: pytest.MonkeyPatch, drive: Floats, rig: str, hold: str = "linear"
) -> list[str]:
    for kind, text in (("families", FAMILY.replace("HOLD", hold)), ("rigs", RIG + rig), ("models", MODEL)):
        (folder / kind).mkdir(exist_ok=True)
        (folder / kind / "lag.yaml").write_text(text, encoding="utf-8")
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    level = np.zeros(800)
    for k in range(799):
        level[k + 1] = drive[k] + (level[k] - drive[k]) * np.exp(-0.05)
    level += np.random.default_rng(9).normal(0.0, 0.01, 800)
    rows = [f"{t:.1f},{y:.5f},{u:.5f}" for t, y, u in zip(TIMES, level, drive, strict=True)]
    (folder / "log.csv").write_text("\n".join(["time [s],level [V],drive [V]", *rows]), encoding="utf-8")
    monkeypatch.chdir(folder)
    told("import", "log.csv", "--rig", "rigs/lag.yaml")
    found = answer("compare", "latest", "--model", "models/lag.yaml", "--no-fit")
    return [note for note in found["notes"] if "noise of" in note]


@pytest.mark.parametrize(
    ("signal", "rig"), [(switched, AS_CHANNEL), (multisine, AS_CHANNEL), (smooth, AS_ACTUATOR)]
)
def test_a_command_is_never_smoothed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signal: object, rig: str
) -> None:
    random = np.random.default_rng(5)
    drive = signal(random)  # type: ignore[operator]
    if rig is AS_ACTUATOR:  # what a controller computed from a noisy reading is a command all the same
        drive = drive + random.normal(0.0, 0.2, 800)
    assert notes_of(tmp_path, monkeypatch, drive, rig) == []


@pytest.mark.parametrize("stated", [False, True])
def test_a_measured_input_is_smoothed_with_a_stated_or_visible_noise_and_the_note_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stated: bool
) -> None:
    random = np.random.default_rng(5)
    rig = AS_CHANNEL.replace("other", "other, noise: 0.21 V") if stated else AS_CHANNEL
    (note, *_) = notes_of(tmp_path, monkeypatch, smooth(random) + random.normal(0.0, 0.2, 800), rig)
    assert ("as the rig file says" in note) is stated
    assert ("by its differences" in note) is not stated
    assert "it is smoothed over" in note
    assert "make it an actuator" in note
