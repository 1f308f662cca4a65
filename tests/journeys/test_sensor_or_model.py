"""A sensor that reads wrongly is not taken for missing physics, within its stated calibration or beyond it.

The board is integrated here, and one thermometer distorted, so that the truth does not come from the product.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, refusal, told
from rigctl.cli.commands.init import create_project

Floats = NDArray[np.float64]
RIG, MODEL = Path("rigs/heater-board.yaml"), "models/heater-board.yaml"
DATA_SHEET = "\n      kind: data_sheet"
CAPACITY, LOSS, ROOM, SPREAD = 2.0, 0.016, 23.0, 0.1
#: what each error of 1 K adds to a reading, over its position between the lowest and the highest reading
ERRORS: dict[str, Callable[[Floats], Floats]] = {
    "zero": np.ones_like,
    "gain": lambda x: 0.5 * (x + 1.0),
    "curvature": lambda x: 1.0 - x**2,
}


def heated(levels: tuple[float, ...], radiation: float = 0.0) -> Floats:
    """The heater's temperature at each second, degC, each level of power for 400 s; Euler steps of 0.1 s."""
    temperature, course = ROOM, []
    for level in levels:
        for step in range(4000):
            if step % 10 == 0:
                course.append(temperature)
            rise = temperature - ROOM
            lost = LOSS * rise + radiation * ((temperature + 273.15) ** 4 - (ROOM + 273.15) ** 4)
            temperature += 0.1 * (level - lost) / CAPACITY
    return np.array(course)


def diagnosed(
    folder: Path, kind: str, size: float, *, stated: str | None = "", **physics: float
) -> dict[str, Any]:
    """The diagnosis of a board whose first thermometer has this error, both `stated` to 1 K or not at all."""
    create_project(folder)
    levels = (0.8, 0.2, 0.5, 0.0, 1.0, 0.3)
    true, random = heated(levels, **physics), np.random.default_rng(3)
    read = true + size * ERRORS[kind](2.0 * (true - true.min()) / np.ptp(true) - 1.0)
    other = np.full_like(true, ROOM)
    rows = zip(
        np.arange(true.size),
        read + random.normal(0.0, SPREAD, true.size),
        other + random.normal(0.0, SPREAD, true.size),
        np.repeat(100.0 * np.array(levels), 400),
        strict=True,
    )
    lines = [f"{t},{one:.3f},{two:.3f},{level:g},0" for t, one, two, level in rows]
    head = "time [s],temperature_1 [degC],temperature_2 [degC],heater_1 [%],heater_2 [%]"
    with chdir(folder):
        Path("log.csv").write_text("\n".join([head, *lines]) + "\n", "utf-8")
        known = "" if stated is None else "uncertainty: 1 K" + stated
        text = RIG.read_text("utf-8").replace("uncertainty: 1 K", known)
        text = text.replace("    raw: {bits: 10, low: 0, high: 1023, unit: count}\n", "")
        RIG.write_text(text.replace("[-50.0, 0.32258065]", "[0, 1]"), "utf-8")
        told("import", "log.csv", "--rig", str(RIG))
        return answer("diagnose", "latest", "--model", MODEL)


def sensor(found: dict[str, Any], channel: str) -> dict[str, Any]:
    return next(one for one in found["sensors"] if one["channel"] == channel)


@pytest.mark.parametrize("stated", ["", DATA_SHEET], ids=["uncertainty alone", "data sheet"])
@pytest.mark.parametrize("kind", ["zero", "curvature"])
def test_an_error_within_the_stated_calibration_is_no_missing_effect(
    tmp_path: Path, kind: str, stated: str
) -> None:
    found = diagnosed(tmp_path, kind, 0.8, stated=stated)
    assert found["verdict"] == "adequate"
    assert found["explained_by"] == "calibration"
    assert "temperature_1 reads" in found["statement"]
    assert "(stated ±1 K)" in found["statement"]
    assert found["with_exact_sensors"]["verdict"] != "adequate"
    one = sensor(found, "temperature_1")
    assert not one["beyond"]
    assert abs(one["error"] - 0.8) < 3.0 * one["std"]
    budgets = {one["parameter"]: one["shares"] for one in found["uncertainty_budget"]}
    assert budgets
    for shares in budgets.values():
        assert sum(shares.values()) == pytest.approx(1.0)
    # no number of readings makes a loss or a heater's power more certain than the thermometer
    assert any(next(iter(shares)) == "calibration of temperature_1" for shares in budgets.values())


def test_an_error_beyond_a_plain_uncertainty_is_not_taken_for_an_effect(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "zero", 1.5)
    assert found["effects"] == []
    assert found["verdict"] in ("undecided", "outside_library")


def test_an_error_beyond_the_stated_calibration_is_the_sensors(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "curvature", 3.0, stated=DATA_SHEET)
    assert found["effects"] == []
    assert found["explained_by"] == "calibration"
    assert sensor(found, "temperature_1")["beyond"]
    assert not sensor(found, "temperature_2")["beyond"]
    assert "temperature_1 reads" in found["statement"]
    assert "more than its calibration allows" in found["statement"]


@pytest.mark.parametrize(("kind", "size"), [("zero", 0.8), ("zero", -0.8), ("curvature", 0.8)])
def test_an_effect_beside_a_wrong_sensor_is_named_as_it_is(tmp_path: Path, kind: str, size: float) -> None:
    """With an exact thermometer the loss is taken for another law, or for none of the library."""
    found = diagnosed(tmp_path, kind, size, radiation=2e-11)
    assert (found["verdict"], found["effects"]) == ("missing_effect", ["radiation"])
    one = sensor(found, "temperature_1")
    assert abs(one["error"]) > 0.3
    assert not one["beyond"]
    with chdir(tmp_path):
        printed = " ".join(told("diagnose", "latest", "--model", MODEL).split())
    assert "beside it, temperature_1 reads" in printed


def test_a_weak_effect_that_a_wrong_sensor_blurs_is_not_named_alone(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "zero", 0.8, radiation=1e-11)
    assert found["verdict"] == "ambiguous"
    assert "radiation" in found["classes"][0]


def test_exact_sensors_need_no_calibration_to_agree(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "zero", 0.0)
    assert found["verdict"] == "adequate"
    assert found["explained_by"] is None
    assert found["with_exact_sensors"] is None


def test_errors_in_their_own_scale_are_not_adequate(tmp_path: Path) -> None:
    """An exact sensor leaves an error of three times its white noise: whatever its cause, it is not noise."""
    found = diagnosed(tmp_path, "zero", 0.8, stated=None)
    assert found["verdict"] != "adequate"


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("uncertainty: 1 bar", "uncertainty"),
        ("uncertainty: 500 K", "more than the whole range"),
        ("gain: 0.1 K", "gain"),
        ("linearity: -1 K", "no uncertainty is negative"),
    ],
)
def test_impossible_uncertainties_are_refused(tmp_path: Path, written: str, message: str) -> None:
    create_project(tmp_path)
    with chdir(tmp_path):
        RIG.write_text(RIG.read_text("utf-8").replace("uncertainty: 1 K", written), "utf-8")
        assert message in refusal("check", "procedures/heater-board-steps.yaml", "--rig", str(RIG))
