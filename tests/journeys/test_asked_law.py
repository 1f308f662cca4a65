"""An effect with a wrong exponent is named and corrected by following only the suggested commands.

The bench is a flywheel that SciPy integrates; its air drags with the speed to the power 1.6, and the library
that its user wrote knows the square.
"""

from __future__ import annotations

import re
import shlex
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from commands import answer, refusal, told
from flywheel import drag, write_bench


def stalling(speed: float) -> float:
    """Quadratic drag, until a part of the blades stalls."""
    return drag(speed, 2.0) * (1.0 - 0.15 * float(np.exp(-(((abs(speed) - 120.0) / 40.0) ** 2))))


def next_command(printed: str) -> list[str]:
    """The words behind ``Next: rigctl``."""
    said = re.findall(r"^Next: rigctl (.*)$", printed, re.MULTILINE)
    assert said, printed
    return shlex.split(said[-1])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_wrong_exponent_is_corrected_by_the_suggested_commands(folder: Path) -> None:
    write_bench(folder, partial(drag, exponent=1.6), seed=4)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    document = answer("diagnose", run, "--model", "model.yaml")
    assert document["effects"] == ["fan"]
    assert ": :" not in f": {document['statement']}"  # the file does not reveal the law
    assert not document["levels"][0]["law"]["sure"]
    (law,) = document["laws"]
    assert (law["effect"], law["driver"], law["unit"], law["slot"]) == ("fan", "speed", "rad/s", "drag")
    exponent = law["exponent"]
    assert exponent["assumed"] == 2.0
    assert abs(exponent["value"] - 1.6) < 3.0 * exponent["std"]
    assert exponent["high"] < 2.0
    assert law["differs"]
    assert law["follows"]
    assert law["statement"].startswith("fan grows as speed^(1.")
    assert law["statement"].count("not as speed^2") == 1
    x, asked, low, high = (np.array(law[name]) for name in ("x", "asked", "low", "high"))
    truth = np.array([drag(speed, 1.6) for speed in x])
    inside = (low <= truth) & (truth <= high)
    assert inside[np.abs(x) > 20.0].mean() > 0.8  # all of a band that holds in 95 of 100 cases is together
    assert np.abs(asked - truth).max() < 0.25 * np.abs(np.array(law["assumed"]) - truth).max()
    assert law["file"] is None

    printed = told("diagnose", run, "--model", "model.yaml", "-o", "page.html")
    assert law["statement"] in printed
    page = Path("page.html").read_text("utf-8")
    assert "Laws of the effects" in page
    assert "fan over speed: the assumed law, and the one estimated from the data" in page

    printed = told(*next_command(printed))  # diagnose … --laws effects
    written = Path("effects/fan_power.yaml")
    assert f"written: {written.as_posix()}" in printed
    shown = " ".join(told("effects", "show", str(written), "--no-picture").split())
    assert "a law of the library in another shape" in shown
    assert f"from {run} beside model" in shown
    assert "valid over: speed from" in shown

    added = told(*next_command(printed), "--hold-out", "drive == 0.9 V")  # model add model.yaml effects/…
    assert "held out" in added
    told(*next_command(added))  # compare
    after = answer("compare", run, "--model", "model.yaml", "--no-fit", "--hold-out", "drive == 0.9 V")
    assert after["adequate"]
    assert after["outside_validity"] == []
    channel = after["channels"]["speed"]
    assert channel["heldout_rmse"] < 1.1 * channel["noise"]
    values = {one["name"]: one for one in answer("model", "show", "model.yaml")["parameters"]}
    fitted = values["fan_power.exponent"]
    assert fitted["value"] == pytest.approx(1.6, abs=3.0 * fitted["std"])

    again = answer("diagnose", run, "--model", "model.yaml", "--laws", "effects")
    assert again["verdict"] == "adequate"
    assert [(one["differs"], one["file"]) for one in again["laws"]] == [(False, None)]
    assert sorted(path.name for path in Path("effects").iterdir()) == ["fan_power.yaml"]


def test_the_law_of_an_effect_added_earlier_is_corrected_too(folder: Path) -> None:
    write_bench(folder, partial(drag, exponent=1.6), seed=4)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    told("diagnose", run, "--model", "model.yaml", "--apply")
    printed = told("diagnose", run, "--model", "model.yaml", "--laws", "effects")
    assert "fan grows as speed^(1." in printed
    (add,) = re.findall(r"^      rigctl (.*)$", printed, re.MULTILINE)
    told(*next_command(printed))
    told(*shlex.split(add))
    document = answer("compare", run, "--model", "model.yaml", "--no-fit")
    assert document["adequate"]
    (effect,) = answer("model", "show", "model.yaml")["effects"]
    assert effect["effect"] == "fan_power"
    assert effect["provenance"]["tier"] == "law"
    assert effect["valid"][0]["over"] == "speed"


def test_a_right_exponent_is_not_corrected(folder: Path) -> None:
    write_bench(folder, partial(drag, exponent=2.0), seed=4)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    Path("notes").write_text("mine", "utf-8")
    refused = refusal("diagnose", "no-such-run", "--model", "model.yaml", "--laws", "notes")
    assert (
        refused == "notes: --laws: a file is there; expected the name of a folder"
    )  # before the run is opened
    document = answer("diagnose", run, "--model", "model.yaml", "--laws", "effects")
    assert document["effects"] == ["fan"]
    (law,) = document["laws"]
    assert not law["differs"]
    assert law["formula"] is None
    assert abs(law["exponent"]["value"] - 2.0) < 3.0 * law["exponent"]["std"]
    assert law["statement"].startswith("the data do not distinguish the law of fan from speed^2")
    assert not Path("effects").exists()


def test_a_law_that_is_not_a_power_is_exported_as_a_curve(folder: Path) -> None:
    write_bench(folder, stalling, seed=4)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    document = answer("diagnose", run, "--model", "model.yaml")
    assert document["effects"] == ["fan"]
    (law,) = document["laws"]
    assert law["differs"]
    assert not law["follows"]
    assert "see the curve" in law["statement"]
    printed = told(*next_command(told("diagnose", run, "--model", "model.yaml")))  # --laws effects
    assert "written: effects/fan_curve.yaml" in printed.replace("\\", "/")
    added = next_command(printed)
    assert "--fit-shapes" not in added
    told(*added)
    document = answer("compare", run, "--model", "model.yaml", "--no-fit")
    assert document["adequate"]
    assert document["curve_bands"][0]["channel"] == "speed"
    values = {one["name"]: one for one in answer("model", "show", "model.yaml")["parameters"]}
    factor = values["fan_curve.factor"]
    assert factor["value"] == pytest.approx(1.0, abs=0.02)
