"""A textbook family without effects, and a log of a bench with a hidden effect: the diagnosis names it.

The logs are made by SciPy from equations written out here, which share nothing with the engine.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import answer, told

#: the contribution of a hidden effect to the rates, as a function of state and input
Hidden = Callable[[Sequence[float], float], Sequence[float]]


@dataclass(frozen=True)
class Bench:
    """A family, its channels with their noise, and the true rates without anything hidden.

    `records` are the input and the start of each; an input that is constant has no switch to be unsure of.
    """

    family: str
    rig: str
    fitted: str
    columns: tuple[str, ...]
    noise: tuple[float, ...]
    rates: Hidden
    records: tuple[tuple[float, tuple[float, ...]], ...]
    period: float
    read: Callable[[Any], Any] = lambda states: states


MOTOR = Bench(
    family="""
family: motor
states:
  current: {start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - kt*speed)/inductance}
  speed: {start: 0 rad/s, scale: 0.1 rad/s, rate: (kt*current - damping*speed)/inertia}
inputs:
  voltage: {value: 0 V}
parameters:
  resistance: {value: 1.8 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {value: 0.045 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
  damping: {value: 2e-4 N*m*s/rad, bounds: [0 N*m*s/rad, 0.1 N*m*s/rad]}
constants: {inertia: 2e-4 kg*m^2, inductance: 20 mH}
outputs:
  current: {unit: A, formula: current}
  speed: {unit: rad/s, formula: speed}
""",
    rig="""
name: motor
model: family.yaml
channels:
  current: {unit: A, quantity: current, noise: 10 mA}
  speed: {unit: rad/s, quantity: other, noise: 0.3 rad/s}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
safe_state: {voltage: 0 V}
""",
    fitted="""
parameters:
  resistance: {value: 1.8 ohm, fit: true}
  kt: {value: 0.045 N*m/A, fit: true}
  damping: {value: 2e-4 N*m*s/rad, fit: true}
""",
    columns=("voltage [V]", "current [A]", "speed [rad/s]"),
    noise=(0.01, 0.3),
    rates=lambda y, u: [(u - 2.0 * y[0] - 0.05 * y[1]) / 20e-3, (0.05 * y[0] - 1e-4 * y[1]) / 2e-4],
    records=(
        (3.0, (0.0, 0.0)),
        (6.0, (0.0, 0.0)),
        (12.0, (0.0, 0.0)),
        (-9.0, (0.0, 0.0)),
        (4.0, (0.0, -60.0)),
        (0.0, (0.0, 100.0)),
    ),
    period=5e-3,
)

TANK = Bench(
    family="""
family: tank
states:
  level: {start: 100 mm, scale: 1 mm, rate: (inflow - outflow)/base}
inputs:
  inflow: {value: 0 l/min}
parameters:
  area: {value: 25 mm^2, bounds: [1 mm^2, 500 mm^2]}
constants: {base: 0.02 m^2, gravity: 9.81 m/s^2}
definitions:
  outflow: {unit: l/min, formula: "area*sqrt(2*gravity*positive_part(level, 1 mm))"}
outputs:
  level: {unit: mm, formula: level}
""",
    rig="""
name: tank
model: family.yaml
channels:
  level: {unit: mm, quantity: position, noise: 0.3 mm}
actuators:
  inflow: {kind: level, unit: l/min, low: 0 l/min, high: 10 l/min}
safe_state: {inflow: 0 l/min}
""",
    fitted="""
parameters:
  area: {value: 25 mm^2, fit: true}
""",
    columns=("inflow [l/min]", "level [mm]"),
    noise=(0.3e-3,),
    rates=lambda y, u: [(u / 60e3 - 28e-6 * np.sqrt(2 * 9.81 * max(y[0], 0.0))) / 0.02],
    records=((2.0, (0.3,)), (3.0, (0.1,)), (4.0, (0.1,)), (5.0, (0.1,)), (6.0, (0.2,)), (1.0, (0.5,))),
    period=4.0,
    read=lambda states: 1000.0 * states,
)

PENDULUM = Bench(
    family="""
family: pendulum
states:
  angle: {start: 0 rad, scale: 1 mrad, rate: rotation}
  rotation: {start: 0 rad/s, scale: 0.01 rad/s, rate: -(gravity/length)*sin(angle) - damping*rotation}
parameters:
  length: {value: 0.5 m, bounds: [0.1 m, 2 m]}
  damping: {value: 0.05 1/s, bounds: [0 1/s, 10 1/s]}
constants: {gravity: 9.81 m/s^2}
outputs:
  angle: {unit: rad, formula: angle}
""",
    rig="""
name: pendulum
model: family.yaml
channels:
  angle: {unit: rad, quantity: angle, noise: 2 mrad}
actuators: {}
safe_state: {}
""",
    fitted="""
parameters:
  length: {value: 0.5 m, fit: true}
  damping: {value: 0.05 1/s, fit: true}
""",
    columns=("angle [rad]",),
    noise=(2e-3,),
    rates=lambda y, u: [y[1], -9.81 / 0.52 * np.sin(y[0]) - 0.03 * y[1]],
    records=tuple((0.0, (angle, 0.0)) for angle in (0.2, 0.5, 0.9, 1.3, 1.7, 2.2)),
    period=0.05,
    read=lambda states: states[:1],
)


def nothing(y: Sequence[float], u: float) -> Sequence[float]:
    return [0.0] * len(y)


def write(bench: Bench, folder: Path, hidden: Hidden, seed: int) -> None:
    """The files of the bench and its log."""
    (folder / "family.yaml").write_text(bench.family, encoding="utf-8")
    (folder / "rig.yaml").write_text(bench.rig, encoding="utf-8")
    (folder / "model.yaml").write_text(f"model: family.yaml\nrig: rig.yaml\n{bench.fitted}", encoding="utf-8")
    rng = np.random.default_rng(seed)
    times = np.arange(150) * bench.period
    commanded = len(bench.columns) > len(bench.noise)
    with (folder / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "record", *bench.columns])
        for record, (given, start) in enumerate(bench.records, start=1):

            def rates(t: float, y: Any, given: float = given) -> list[float]:
                return [a + b for a, b in zip(bench.rates(y, given), hidden(y, given), strict=True)]

            found = solve_ivp(
                rates, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-10, max_step=bench.period
            )
            states = np.asarray(found.y)
            noise = np.array(bench.noise)[:, None] * rng.standard_normal((len(bench.noise), times.size))
            read = bench.read(states + noise if len(noise) == len(states) else states) + (
                noise if len(noise) != len(states) else 0.0
            )
            for time, values in zip(times, read.T, strict=True):
                shown = [f"{value:.7g}" for value in values]
                rows.writerow([f"{time:.6g}", record, *([given] if commanded else []), *shown])


HIDDEN: dict[str, tuple[Bench, Hidden, set[str]]] = {
    "dry friction of a motor": (
        MOTOR,
        lambda y, u: [0.0, -30.0 * np.tanh(y[1] / 0.2)],
        {"coulomb_on_speed"},
    ),
    "overflow of a tank": (
        TANK,
        lambda y, u: [-0.02 * max(y[0] - 0.35, 0.0)],
        {"threshold_on_level"},
    ),
    "drag of a pendulum": (
        PENDULUM,
        lambda y, u: [0.0, -0.05 * y[1] * abs(y[1])],
        {"quadratic_drag_on_rotation"},
    ),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_the_hidden_effect_or_its_class_is_named(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, hidden, right = HIDDEN[name]
    monkeypatch.chdir(tmp_path)
    write(bench, tmp_path, hidden, seed=5)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    found = answer("diagnose", run, "--model", "model.yaml", "--max-effects", "1")
    assert found["verdict"] in ("missing_effect", "ambiguous"), found["statement"]
    assert right & {one for names in found["classes"] for one in names}


@pytest.mark.parametrize("bench", [MOTOR, TANK, PENDULUM], ids=["motor", "tank", "pendulum"])
def test_the_model_of_a_bench_without_a_hidden_effect_is_adequate(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(bench, tmp_path, nothing, seed=6)
    run = answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    assert answer("diagnose", run, "--model", "model.yaml")["verdict"] == "adequate"


def test_the_list_of_generic_effects_has_those_that_apply_to_each_slot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(MOTOR, tmp_path, nothing, seed=6)
    slots = {one["slot"]: one for one in answer("effects", "list", "--family", "family.yaml")["generic"]}
    assert "coulomb_on_speed" in slots["speed_rate"]["effects"]
    assert slots["current_rate"]["why_not"] == "no friction: it is not a speed"
    assert slots["voltage_delay"]["effects"] == ["dead_time_of_voltage"]
    assert "w = −F·sign(speed)" in told("effects", "show", "coulomb_on_speed", "--family", "family.yaml")
