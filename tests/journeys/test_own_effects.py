"""From the verdict "outside the library" to a user's own effect, which a diagnosis then names."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

import flywheel
from commands import answer, textbook_copy, told
from rigctl.cli.commands.init import create_project

pytestmark = pytest.mark.usefixtures("inside")

#: of the shipped campaign that another program made with a leaking valve: those of test_diagnose.py
RECORDS = {"001", "019", "025", "028"}

BRAKE = """
effect: brake
family: ../flywheel.yaml
summary: The bearing drags with a constant torque.
slot: drag
term: torque*tanh(speed/width)
parameters:
  torque: {null_value: 0 N*m, start: 0.01 N*m, bounds: [0 N*m, 1 N*m]}
  width: {start: 1 rad/s, bounds: [0.1 rad/s, 10 rad/s]}
confused_with: [fan]
"""

MODEL = flywheel.model(("effects/brake.yaml", "effects/fan.yaml"), "flywheel-rig.yaml", damped=True)
FAN = flywheel.FAN.replace("family: ", "family: ../") + "confused_with: [brake]\n"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the cylinder's records, and with those of a flywheel whose bearing drags."""
    folder = tmp_path_factory.mktemp("own-effects")
    create_project(folder)
    with chdir(folder):
        for name, text in {
            "flywheel.yaml": flywheel.family(damped=True),
            "flywheel-rig.yaml": flywheel.rig(0.05),
            "flywheel-model.yaml": MODEL,
            "effects/brake.yaml": BRAKE,
            "effects/fan.yaml": FAN,
        }.items():
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).write_text(text, encoding="utf-8", newline="\n")
        write_flywheel(Path("flywheel.csv"), torque=0.04, seed=3)
    return folder


def write_flywheel(path: Path, torque: float, seed: int) -> None:
    """With the damping of the family, and a bearing that the family lacks."""

    def drag(speed: float) -> float:
        return 1e-3 * speed + torque * float(np.tanh(speed))

    flywheel.write_log(path, drag, seed=seed, noise=0.05, volts=flywheel.FAST, step=0.05)


def test_a_user_s_effect_of_a_user_s_family_is_found_and_added() -> None:
    run = answer("import", "flywheel.csv", "--rig", "flywheel-rig.yaml")["run"]
    compared = answer("compare", run, "--model", "flywheel-model.yaml")
    assert not compared["models"][0]["adequate"]
    found = answer("diagnose", run, "--model", "flywheel-model.yaml", "--apply")
    assert "brake" in {name for names in found["classes"] for name in names}
    assert found["steps"][0]["effects"] == ["brake"]
    assert found["ended"] == "adequate"
    values = {one["name"]: one for one in answer("model", "show", "flywheel-model.yaml")["parameters"]}
    assert values["brake.torque"]["value"] == pytest.approx(0.04, rel=0.02)
    told("report", run, "--model", "flywheel-model.yaml", "-o", "flywheel.html")

    # data generated with a width of 1 rad/s: the fit starts from 3 rad/s, with the file unchanged
    Path("models/by-hand.yaml").write_text(
        MODEL.replace("model: flywheel", "model: ../flywheel")
        .replace("rig: flywheel", "rig: ../flywheel")
        .replace("own_effects: [effects/brake.yaml, effects/fan.yaml]\n", ""),
        encoding="utf-8",
    )
    first, *rest = told(
        "model", "add", "models/by-hand.yaml", "effects/brake.yaml:width=3 rad/s", run, "--fit-shapes"
    ).splitlines()
    assert first == "models/by-hand.yaml is now version 2, with brake."
    assert [line.split()[0] for line in rest[:3]] == ["error", "fitted", "-v"]
    assert "brake.width" in rest[1] and "█" not in "".join(rest)
    assert '"../effects/brake.yaml"' in Path("models/by-hand.yaml").read_text("utf-8")
    values = {one["name"]: one for one in answer("model", "show", "models/by-hand.yaml")["parameters"]}
    assert values["brake.width"]["fit"]
    assert values["brake.width"]["value"] == pytest.approx(1.0, rel=0.1)


def test_an_effect_with_no_value_at_its_typical_size_is_added_from_a_smaller_one() -> None:
    """A gust that grows with the square of the speed: at its typical size the speed is soon infinite."""
    gust = {"effect: brake": "effect: gust", "torque*tanh(speed/width)": "-torque*(speed*(1 s/rad))^2"}
    text = BRAKE
    for old, new in gust.items():
        text = text.replace(old, new)
    start = text.index("  width:")
    text = text[:start].replace("start: 0.01 N*m, bounds: [0 ", "start: 0.0003 N*m, bounds: [-1 ")
    Path("effects/gust.yaml").write_text(text, encoding="utf-8")
    run = answer("import", "flywheel.csv", "--rig", "flywheel-rig.yaml")["run"]
    Path("own.yaml").write_text(MODEL, encoding="utf-8")
    found = answer("model", "add", "own.yaml", "effects/gust.yaml", run)
    before, after = (found[when]["rmse"]["speed"] for when in ("before", "after"))
    assert after <= before * (1.0 + 1e-6)


def test_records_outside_the_valid_range_of_an_effect_are_reported() -> None:
    learned = (
        BRAKE.replace("effect: brake", "effect: slow_brake").replace("confused_with: [fan]", "")
        + "valid: {speed: [0 rad/s, 60 rad/s], drive: [-1 V, 20 V]}\n"
        + "provenance: {runs: [early], date: 2026-11-22, tier: B}\n"
    )
    Path("effects/slow-brake.yaml").write_text(learned, encoding="utf-8")
    Path("slow.yaml").write_text(MODEL.replace("effects/brake.yaml, effects/fan.yaml", ""), encoding="utf-8")
    run = answer("import", "flywheel.csv", "--rig", "flywheel-rig.yaml")["run"]
    added = answer("model", "add", "slow.yaml", "effects/slow-brake.yaml:width=1 rad/s", run)
    (left,) = added["outside_validity"]
    assert (left["effect"], left["over"], left["unit"]) == ("slow_brake", "speed", "rad/s")
    assert left["value"] == pytest.approx(556.0, rel=0.01)  # at 12 V: (0.05·12 − 0.04)/1e-3·(1 − e⁻⁵)
    assert left["record"] == f"{run}/4"  # the fifth
    assert left["time"] == pytest.approx(9.95)
    assert left["records"] == 5  # 2 V lead to 60 rad/s
    shown = answer("model", "show", "slow.yaml")["effects"][0]
    assert shown["valid"][0]["over"] == "speed"
    assert shown["provenance"]["runs"] == ["early"]
    document = answer("compare", run, "--model", "slow.yaml", "--no-fit", "-o", "slow.html")
    (again,) = document["outside_validity"]
    assert (again["record"], again["time"]) == (left["record"], left["time"])
    said = told("compare", run, "--model", "slow.yaml", "--no-fit")
    assert f"warning: {again['statement']}" in said
    assert "Warning" in Path("slow.html").read_text("utf-8")
    diagnosed = answer("diagnose", run, "--model", "slow.yaml")
    assert [one["record"] for one in diagnosed["outside_validity"]] == [left["record"]]


def test_a_user_s_effect_of_the_cylinder_is_a_candidate() -> None:
    lines = Path("data/unknown-bench.csv").read_text("utf-8").splitlines(keepends=True)
    kept = [line for line in lines[1:] if line.split(",")[1] in RECORDS]
    Path("few.csv").write_text("".join([lines[0], *kept]), "utf-8")
    run = answer("import", "few.csv", "--rig", "rigs/hl32-bench.yaml")["run"]
    Path("effects/grip.yaml").write_text(
        "effect: grip\nsummary: The seals grip.\nslot: friction\nterm: force*tanh(velocity/(2 mm/s))\n"
        "parameters: {force: {null_value: 0 N, start: 100 N, bounds: [0 N, 2 kN]}}\n",
        encoding="utf-8",
    )
    model = textbook_copy("with-grip", ("effects: {}", "own_effects: [../effects/grip.yaml]\neffects: {}"))
    found = answer("diagnose", run, "--model", model, "--max-effects", "1")
    assert "valve_leakage" in {name for names in found["classes"] for name in names}
    assert "grip" in {one["effect"] for one in found["ranking"]}
