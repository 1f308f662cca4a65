"""What a plain `uncertainty` brings to the numbers of a model that agrees, with its sensors taken for exact.

It is compared with what the same fit finds in logs whose readings are off by each part of what is stated.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, told
from rigctl.model.fit import stated_errors

Floats = NDArray[np.float64]
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
#: of a standard deviation, so that the fit of a log that is off agrees too
SHARE = 0.1
#: each part of an error, over the position between the lowest and the highest reading, -1 to 1
PARTS: dict[str, Callable[[Floats], Floats]] = {
    "zero": np.ones_like,
    "gain": lambda x: x,
    "curvature": lambda x: 1.5 * x**2 - 0.5,
}
NUMBERS = ("lag", "gain", "offset")


def compared(
    folder: Path,
    *,
    level: str = "",
    drive: str = "",
    noise: float = NOISE,
    wrong: tuple[str, str] | None = None,
) -> dict[str, Any]:
    """The comparison of a lag of 2 s with its own log, each channel with this calibration; one of them
    `wrong` by a share of a standard deviation of one part of it."""
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
    if wrong is not None:
        channel, part = wrong
        off = drives if channel == "drive" else read
        off += SHARE * 0.5 * STATED * PARTS[part](2.0 * (off - off.min()) / np.ptp(off) - 1.0)
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


def numbers(found: dict[str, Any], what: str = "std") -> Floats:
    return np.array([found["parameters"][name][what] for name in NUMBERS])


@pytest.mark.parametrize("channel", ["level", "drive"])
def test_it_brings_to_each_number_what_such_errors_do(tmp_path: Path, channel: str) -> None:
    exact = compared(tmp_path / "exact")
    variance = numbers(exact) ** 2
    for part in PARTS:
        off = compared(tmp_path / part, wrong=(channel, part))
        variance += ((numbers(off, "value") - numbers(exact, "value")) / SHARE) ** 2
    plain = compared(tmp_path / "plain", **{channel: "plain"})  # type: ignore[arg-type]
    assert plain["adequate"] is True
    assert plain["explained_by"] is None
    assert numbers(plain, "value") == pytest.approx(numbers(exact, "value"))
    assert numbers(plain)[1] > 5.0 * numbers(exact)[1]
    assert numbers(plain) == pytest.approx(np.sqrt(variance), rel=0.1)
    budgets = {one["parameter"]: one["shares"] for one in plain["uncertainty_budget"]}
    assert next(iter(budgets["gain"])) == f"calibration of {channel}"
    for shares in budgets.values():
        assert sum(shares.values()) == pytest.approx(1.0)


def test_a_number_added_to_the_model_file_has_it_too(tmp_path: Path) -> None:
    plain = compared(tmp_path, level="plain")
    with chdir(tmp_path):
        told("model", "fit", "models/lag.yaml", "latest")
        stored = answer("model", "show", "models/lag.yaml")
    of_gain = next(one for one in stored["parameters"] if one["name"] == "gain")
    assert of_gain["std"] == pytest.approx(plain["parameters"]["gain"]["std"], rel=0.01)


def test_a_smaller_step_is_tried_where_the_model_has_no_value_beside_an_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = numbers(compared(tmp_path / "plain", drive="plain"))
    difference = stated_errors._difference

    def refused(*arguments: Any) -> Any:
        return None if arguments[-1] > 0.05 * STATED else difference(*arguments)

    monkeypatch.setattr(stated_errors, "_difference", refused)
    assert numbers(compared(tmp_path / "smaller", drive="plain")) == pytest.approx(plain, rel=0.01)


def test_a_number_whose_sensor_cannot_be_accounted_for_has_no_standard_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stated_errors, "_difference", lambda *_: None)
    plain = compared(tmp_path, drive="plain")
    assert [plain["parameters"][name]["std"] for name in NUMBERS] == [None] * len(NUMBERS)
    assert plain["uncertainty_budget"] == []


def test_more_readings_do_not_make_a_number_more_certain_than_its_sensor(tmp_path: Path) -> None:
    noisy = numbers(compared(tmp_path / "noisy", level="plain"))
    quiet = numbers(compared(tmp_path / "quiet", level="plain", noise=0.1 * NOISE))
    assert quiet[1] == pytest.approx(noisy[1], rel=0.1)
