"""Where only the white floor of the noise is known, an error beyond it is never within the noise."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands import answer, told
from made_fit import made_fit, made_noise
from rigctl.answers.errors import error_text
from rigctl.answers.findings.systematic_error import falls, left_of_fit
from rigctl.noise import NoiseModel

FLOOR = 0.02


def dryer(path: Path) -> None:
    """A lag of second order behind a dead time and a slow lag, switched at random between two levels."""
    rng = np.random.default_rng(3)
    heater = np.repeat(rng.integers(0, 2, 60), 10) * 3.0 + 3.4
    late = np.concatenate([np.full(3, heater[0]), heater[:-3]])
    air, plate, wall = 5.0, 5.0, 0.0
    read = np.empty(heater.size)
    for i, u in enumerate(late):
        read[i] = plate + 0.4 * wall
        air += 0.35 * (u - air)
        plate += 0.25 * (air - plate)
        wall += 0.02 * (plate - 5.0 - wall)
    read += FLOOR * rng.standard_normal(read.size)
    rows = np.column_stack([0.08 * np.arange(read.size), heater, read])
    np.savetxt(path, rows, "%.6g", ",", header="time [s],heater [V],air [V]", comments="")


def test_an_error_of_several_floors_is_never_within_the_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own scale, in which χ² always fits, was read as the noise."""
    monkeypatch.chdir(tmp_path)
    told("init", "--minimal")
    dryer(tmp_path / "log.csv")
    done = answer("family", "new", "dryer", "--csv", "log.csv", "--template", "second-order")
    drafted = re.search(r"# noise: ([\d.]+) V", (tmp_path / done["rig"]).read_text(encoding="utf-8"))
    assert drafted is not None
    assert float(drafted[1]) == pytest.approx(FLOOR, rel=0.3)
    told("import", "log.csv", "--rig", done["rig"])
    text = told("diagnose", "latest", "--model", done["model"], "-o", "page.html")
    error, floor = map(float, re.search(r"error ([\d.]+) V, white noise ([\d.]+) V", text).groups())  # type: ignore[union-attr]
    assert error > 1.4 * floor
    for shown in (text, (tmp_path / "page.html").read_text(encoding="utf-8")):
        assert "within the noise" not in shown
        assert "times its white noise" in shown


def floor_alone(noise: NoiseModel, allowed: float = 0.0) -> NoiseModel:
    """The noise of made records, of which the floor alone is known."""
    channels = (
        replace(one, source="floor", guessed=False, floor=one.sigma, allowed=allowed)
        for one in noise.channels
    )
    return replace(noise, channels=tuple(channels))


def test_a_fall_to_several_floors_is_said_in_the_unit_and_in_floors() -> None:
    before = made_fit(floor_alone(made_noise()), 3, lambda place, times: np.full(times.size, 1.0))
    after = replace(before, outputs=tuple(one - np.array([0.6, 0.0]) for one in before.outputs))
    (position, pressure) = falls([before, after], [left_of_fit(before), left_of_fit(after)])
    assert position.changed
    assert not pressure.changed
    assert error_text([position]) == ("position from 1005 mm to 413 mm, 4.1 times its white noise of 100 mm")
    assert pressure.within(-1)


def test_an_error_is_compared_with_a_stated_noise() -> None:
    fit = made_fit(floor_alone(made_noise(), allowed=0.5), 3, lambda place, times: np.full(times.size, 1.0))
    (position, _) = falls([fit], [left_of_fit(fit)])
    assert position.sigmas(0) == "2 times its stated noise"
