"""Record-level unknowns are reported, and are evidence if they exceed their prior."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import answer, told
from rigctl.analysis.agreement.record_level import RecordQuantity, record_level
from rigctl.answers.findings.agreement import prior_text
from rigctl.cli.commands.init import create_project
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import fit
from rigctl.model.fit.problem import make_problem
from rigctl.model.load import load_model
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import ChannelNoise, NoiseModel

Floats = NDArray[np.float64]
CHANNELS = ("temperature_1", "temperature_2")
NOISE = NoiseModel(
    tuple(ChannelNoise(name, 0.1, source="rig", guessed=False, statement="") for name in CHANNELS), 5.0, ""
)


def quantities(room: Callable[[float], float], seed: int) -> dict[str, RecordQuantity]:
    """Eight records of two lumps, solved analytically, at 23 degC ambient plus `room` K per mean command."""
    model = load_model(Path(str(shipped("models", "heater-board.yaml"))))
    generator = np.random.default_rng(seed)
    times, records = np.arange(0.0, 900.0, 5.0), []
    for number in range(8):
        powers = generator.uniform(0.0, 1.0, 2)
        ambient = 296.15 + room(float(powers.mean()))
        gains, loss, capacity = np.array([1.05, 0.96]), 0.0152, 2.0
        rise = 1.0 - np.exp(-loss / capacity * np.clip(times - 30.0, 0.0, None))
        values = ambient + rise[:, None] * gains * powers / loss
        records.append(
            MeasuredRecord(
                run="made",
                index=number,
                label=f"made/{number + 1}",
                times=times,
                switch_times=np.array([0.0, 30.0]),
                switch_half=np.zeros(2),
                inputs=np.array([[0.0, 0.0, 296.15], [*powers, 296.15]]),
                values=values + generator.normal(0.0, 0.1, values.shape),
                condition={"heater_1": float(powers[0]), "heater_2": float(powers[1])},
                group=number,
                phase=np.zeros(times.size, dtype=np.intp),
                phases=("all",),
            )
        )
    inputs = tuple(item.name for item in model.family.inputs)
    data = Measurements(CHANNELS, ("degC", "degC"), inputs, tuple(records), model.rig, ("made",))
    found = fit(make_problem(model, data, NOISE, [record.here for record in records]))
    return {one.name: one for one in record_level(found)}


def test_an_ambient_temperature_that_rises_with_the_heaters_is_evidence() -> None:
    room = quantities(lambda power: 25.0 * power, 1)["room"]
    assert room.exceeds
    assert room.follows
    assert "the model lacks" in room.statement
    assert room.over in ("heater_1", "heater_2")
    document = room.document()
    assert document["evidence"]
    assert document["highest"] - document["lowest"] > 10.0
    (first, *_) = room.rows()
    assert (first["record"], first["unit"], first["prior_mean"], first["prior_std"]) == (
        "made/1",
        "K",
        0.0,
        1.0,
    )
    assert 0.0 < first["std"] < 0.1


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_ambient_temperatures_that_scatter_within_their_prior_are_not_evidence(seed: int) -> None:
    generator = np.random.default_rng(seed)
    found = quantities(lambda _: float(generator.normal(0.0, 1.0)), seed)
    assert not any(one.evident for one in found.values())
    assert np.isnan(found["temperature_1"].p_value), "a start that was read is evidence of nothing"
    assert prior_text(found["temperature_1"]) == "free"


FAMILY = """
family: wall
states:
  body: {{start: 20 degC, scale: 10 mK, rate: (wall - body)/body_time}}
  wall: {{start: {start}, scale: 10 mK, rate: (room - wall)/wall_time}}
inputs:
  room: {{value: 20 degC}}
parameters:
  body_time: {{value: 60 s, bounds: [1 s, 1000 s]}}
  wall_time: {{value: 500 s, bounds: [1 s, 10000 s]}}
outputs:
  body: {{unit: degC, formula: body}}
"""
RIG = """
name: wall
model: families/wall.yaml
channels:
  body: {unit: degC, quantity: temperature, noise: 0.02 K}
constants: {room: 20 degC}
backend: {kind: simulated}
monitor_rate: 1 Hz
"""
MODEL = """
model: families/wall.yaml
rig: rigs/wall.yaml
parameters:
  body_time: {value: 60 s, fit: true}
  wall_time: {value: 500 s, fit: true}
"""


def wall_project(folder: Path, start: str) -> None:
    """A body in front of an unmeasured wall, whose temperature starts differently in every record."""
    create_project(folder)
    for name, text in (("families", FAMILY.format(start=start)), ("rigs", RIG), ("models", MODEL)):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "wall.yaml").write_text(text, encoding="utf-8")
    generator = np.random.default_rng(6)
    times = np.arange(0.0, 600.0, 3.0)
    lines = ["time [s],record,body [degC]"]
    for number, wall in enumerate((26.0, 17.0, 22.0, 14.0), start=1):
        slow, fast = 1.0 / 450.0, 1.0 / 70.0
        share = (wall - 20.0) * fast / (fast - slow)
        body = 20.0 + share * np.exp(-slow * times) + (1.0 - share) * np.exp(-fast * times)
        read = body + generator.normal(0.0, 0.02, times.size)
        lines += [f"{t:g},{number},{y:.5f}" for t, y in zip(times, read, strict=True)]
    (folder / "log.csv").write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize("known", [True, False])
def test_an_unmeasured_state_may_start_anywhere_within_its_prior(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    wall_project(tmp_path, "{value: 20 degC, std: 5 K}" if known else "20 degC")
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/wall.yaml")
    found = answer("compare", "latest", "--model", "models/wall.yaml")
    assert found["adequate"] is known
    if known:
        starts = [row for row in found["record_level"] if row["name"] == "wall"]
        assert [row["value"] for row in starts] == pytest.approx([26.0, 17.0, 22.0, 14.0], abs=0.3)
        assert {(row["unit"], row["prior_std"]) for row in starts} == {("degC", 5.0)}
        assert found["parameters"]["wall_time"]["value"] == pytest.approx(450.0, rel=0.03)
