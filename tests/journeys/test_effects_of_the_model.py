"""A model that has an effect already, on a bench that follows another law: integrated by SciPy alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import answer, told
from rigctl_validation.benches.bench import USER_FILES
from rigctl_validation.benches.register import find_bench

LEAK = """
effects:
  leak_on_heat_middle: {coefficient: {value: 0.4 W/K, fit: true}}
"""
HEAD = "time [s],record,power [W],room [degC],hot [degC],middle [degC],cold [degC]"
ROOM, ON = 21.0, 30.0  # degC, s


def write_log(path: Path, bend: float, ripple: float) -> None:
    """The chain's middle leaks by a law that is bent by a share, and something warms its end now and then."""
    rng, times, rows = np.random.default_rng(1), np.arange(0.0, 1500.1, 4.0), [HEAD]
    for number, power in enumerate((20.0, 35.0, 40.0, 30.0), start=1):

        def rates(t: float, y: list[float], power: float = power) -> list[float]:
            one, two, over = 0.8 * (y[0] - y[1]), 0.7 * (y[1] - y[2]), y[1] - ROOM
            lost = 0.4 * over * (1.0 + bend * (over / 20.0 - 1.0))
            end = two - 0.9 * (y[2] - ROOM) + ripple * np.sin(t / 40.0)
            return [(power - one) / 120.0, (one - two - lost) / 120.0, end / 120.0]

        warm = times[times >= ON]
        made = solve_ivp(rates, (ON, 1501.0), [ROOM] * 3, t_eval=warm, rtol=1e-9, atol=1e-9, max_step=5.0).y.T
        states = np.vstack([np.full((times.size - warm.size, 3), ROOM), made])
        for t, read in zip(times, states + rng.normal(0.0, 0.02, states.shape), strict=True):
            given = power if t >= ON else 0.0
            rows.append(f"{t:g},{number},{given:g},{ROOM},{read[0]:.5f},{read[1]:.5f},{read[2]:.5f}")
    path.write_text("\n".join(rows), encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A chain whose model leaks."""
    for name in USER_FILES:
        shutil.copyfile(find_bench("chain").file(name), tmp_path / name)
    with (tmp_path / "model.yaml").open("a", encoding="utf-8") as file:
        file.write(LEAK)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_deviation_within_the_shape_tolerance_of_a_law_is_not_named_as_an_effect(folder: Path) -> None:
    write_log(folder / "log.csv", bend=0.1, ripple=0.5)
    told("import", "log.csv", "--rig", "rig.yaml")
    found = answer("diagnose", "latest", "--model", "model.yaml")
    assert (found["verdict"], found["effects"]) == ("outside_library", [])
    assert "within 10 % of the law of leak_on_heat_middle" in found["statement"]
    assert "but such deviations explain all but" in found["statement"]


def test_no_formula_is_accepted_for_a_drift_in_time(folder: Path) -> None:
    """Pairs of temperatures correlate with it weakly; none is exported as the missing term."""
    write_log(folder / "log.csv", bend=0.0, ripple=1.0)
    told("import", "log.csv", "--rig", "rig.yaml")
    found = answer("discover", "latest", "--model", "model.yaml", "-o", "effects")
    assert "no formula describes" in found["statement"]
    assert found["formulas"]
    assert not any(one["accepted"] or one["file"] for one in found["formulas"])
    assert found["formulas"][0]["share_left"] > 0.5
    assert not (folder / "effects").exists()
