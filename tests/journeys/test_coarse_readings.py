"""A sensor with coarse resolution is reported, and deviations within one step are not named as an effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commands import answer, told

FILES = {
    "family.yaml": """
family: heated
states:
  body: {start: 20 degC, scale: 10 mK, rate: (power - loss*(body - room))/capacity}
inputs:
  power: {value: 0 W}
  room: {value: 20 degC}
parameters:
  loss: {value: 2 W/K, bounds: [0 W/K, 100 W/K]}
  capacity: {value: 200 J/K, bounds: [1 J/K, 10000 J/K]}
outputs:
  body: {unit: degC, formula: body}
""",
    "rig.yaml": """
name: heated
model: family.yaml
channels:
  body: {unit: degC, quantity: temperature}
actuators:
  power: {kind: level, unit: W, low: 0 W, high: 100 W}
safe_state: {power: 0 W}
""",
    "model.yaml": """
model: family.yaml
rig: rig.yaml
parameters:
  loss: {value: 2 W/K, fit: true}
  capacity: {value: 200 J/K, fit: true}
""",
}


@pytest.mark.parametrize("step", [1.0, 0.05])
def test_a_coarse_converter_is_noted_and_not_taken_for_an_effect(
    step: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told("init", str(tmp_path / "mine"), "--minimal")
    monkeypatch.chdir(tmp_path / "mine")
    for name, text in FILES.items():
        Path(name).write_text(text, encoding="utf-8")
    generator = np.random.default_rng(5)
    times = np.arange(600.0)
    lines = ["time [s],record,power [W],body [degC]"]
    for record, power in enumerate((20.0, 40.0, 60.0, 80.0)):
        body = 20.0 + power / 2.0 * -np.expm1(-np.maximum(times - 30.0, 0.0) / 120.0)
        read = np.round((body + generator.normal(0.0, 0.05, 600)) / step) * step
        on = np.where(times >= 30.0, power, 0.0)
        lines += [f"{t:g},{record},{p:g},{b:.6g}" for t, p, b in zip(times, on, read, strict=True)]
    Path("log.csv").write_text("\n".join(lines), encoding="utf-8")
    told("import", "log.csv", "--rig", "rig.yaml", "--assume", "room=20 degC")
    found = answer("compare", "latest", "--model", "model.yaml")
    # rounding to steps far larger than the noise is as slow as the signal: a small effect would look the same
    assert found["adequate"] is (None if step == 1.0 else True), found["statement"]
    assert ("as large as the steps of 1 K make it" in found["statement"]) == (step == 1.0)
    assert any("in finer steps" in one for one in found["decided_by"]) == (step == 1.0)
    assert found["channels"]["body"]["step"] == pytest.approx(step, rel=0.01)
    coarse = [note for note in found["notes"] if "read in steps of 1 K, coarser than its noise" in note]
    assert bool(coarse) == (step == 1.0)
    assert any(note.endswith("room 20 degC") for note in found["notes"])
    diagnosis = answer("diagnose", "latest", "--model", "model.yaml")
    assert diagnosis["verdict"] == ("undecided" if step == 1.0 else "adequate")
    assert not diagnosis["effects"]
