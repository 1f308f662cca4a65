"""Measured and unrecorded inputs, on benches made with only NumPy and SciPy."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rigctl
from commands import answer, refusal, told
from rigctl.cli.commands.init import create_project
from rigctl.model.load import load_model

Floats = NDArray[np.float64]

ROOM = """
family: {name}
states:
  body: {{start: 20 degC, scale: 10 mK, rate: (room - body)/lag}}
inputs:
  room: {{value: 20 degC{hold}}}
  pressure: {{value: 0 bar}}
parameters:
  lag: {{value: 200 s, bounds: [1 s, 10000 s]}}
  opening: {{value: 0.08 l/(min*bar), bounds: [0.001 l/(min*bar), 10 l/(min*bar)]}}
outputs:
  body: {{unit: degC, formula: body}}
  flow: {{unit: l/min, formula: opening*pressure}}
"""
RIG = """
name: {name}
model: families/{name}.yaml
channels:
  body: {{unit: degC, quantity: temperature, noise: 0.02 K}}
  flow: {{unit: l/min, quantity: other, noise: 0.02 l/min}}
  room: {{unit: degC, quantity: temperature}}
  pressure: {{unit: bar, quantity: pressure}}
backend: {{kind: simulated}}
monitor_rate: 1 Hz
"""
MODEL = """
model: families/{name}.yaml
rig: rigs/{name}.yaml
parameters:
  lag: {{value: 200 s, fit: true}}
  opening: {{value: 0.08 l/(min*bar), fit: true}}
"""


def project(folder: Path, name: str, rows: list[str], hold: str = "") -> None:
    create_project(folder)
    for kind, text in (("families", ROOM), ("rigs", RIG), ("models", MODEL)):
        (folder / kind).mkdir(exist_ok=True)
        (folder / kind / f"{name}.yaml").write_text(text.format(name=name, hold=hold), encoding="utf-8")
    head = "time [s],record,body [degC],flow [l/min],room [degC],pressure [bar]"
    (folder / "log.csv").write_text("\n".join([head, *rows]), encoding="utf-8")


def lagging(times: Floats, room: Floats, lag: float, steps: bool) -> Floats:
    """What follows a piecewise linear, or a held, input with one lag: exact from sample to sample."""
    found = np.empty_like(times)
    found[0] = room[0]
    for k in range(times.size - 1):
        step = times[k + 1] - times[k]
        slope = 0.0 if steps else (room[k + 1] - room[k]) / step
        settled = room[k + 1] if not steps else room[k]
        decay = np.exp(-step / lag)
        found[k + 1] = settled - slope * lag + (found[k] - room[k] + slope * lag) * decay
    return found


def rows_of(steps: bool, pressure_noise: float = 0.0, seed: int = 1) -> list[str]:
    generator = np.random.default_rng(seed)
    rows = []
    for record in range(1, 5):
        times = (np.arange(400) * 7.5 + generator.uniform(0.0, 6.0, 400)).round(2)
        knots = np.linspace(0.0, 3000.0, 16)
        room = np.interp(times, knots, 20.0 + generator.uniform(-5.0, 5.0, 16)).round(3)
        if steps:
            room = np.round(room)
        pressure = 20.0 + 10.0 * np.sin(times / 300.0 + record)
        body = lagging(times, room, 310.0, steps) + generator.normal(0.0, 0.02, 400)
        flow = 0.1 * pressure + generator.normal(0.0, 0.02, 400)
        read = pressure + generator.normal(0.0, 1.0, 400) * pressure_noise
        for k in range(400):
            cells = [f"{room[k]:g}" if k % 37 != 5 or steps else "", f"{read[k]:.5f}"]
            rows.append(f"{times[k]:.2f},{record},{body[k]:.5f},{flow[k]:.5f},{cells[0]},{cells[1]}")
    return rows


@pytest.mark.parametrize("steps", [False, True])
def test_measured_inputs_drive_the_model_as_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: bool
) -> None:
    project(tmp_path, "bench", rows_of(steps), ", hold: previous" if steps else "")
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/bench.yaml")
    found = answer("compare", "latest", "--model", "models/bench.yaml")
    assert found["adequate"], found["statement"]
    assert found["channels"]["flow"]["r2"] > 0.999
    assert found["parameters"]["lag"]["value"] == pytest.approx(310.0, rel=0.01)
    assert found["parameters"]["opening"]["value"] == pytest.approx(0.1 / 60e3 / 1e5, rel=1e-3)
    lines = [note for note in found["notes"] if "acts as it was measured" in note]
    assert len(lines) == (1 if steps else 2)
    assert steps or any("44 readings of room are missing" in note for note in found["notes"])


def test_the_noise_of_a_measured_input_adds_to_the_noise_of_the_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project(tmp_path, "bench", rows_of(False, pressure_noise=0.5))
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/bench.yaml")
    found = answer("compare", "latest", "--model", "models/bench.yaml")
    assert found["adequate"], found["statement"]
    # smoothing the input avoids bias (errors in variables); the slow part of its noise still counts
    assert 0.3 < found["channels"]["flow"]["nrmse"] < 1.0
    assert found["parameters"]["opening"]["value"] == pytest.approx(0.1 / 60e3 / 1e5, rel=2e-3)
    assert any("smoothed over" in note for note in found["notes"])
    assert found["channels"]["body"]["rmse"] == pytest.approx(0.02, rel=0.2)
    assert any("noise of the measured inputs moves flow" in note for note in found["notes"])


def board(folder: Path, second: Floats, *, recorded: bool, seed: int = 3, duration: float = 900.0) -> None:
    """Records of the shipped board's own equations, solved by hand; heater 2 constant in each."""
    create_project(folder)
    generator = np.random.default_rng(seed)
    times = np.arange(0.0, duration, 2.0)
    head = "time [s],record,heater_1 [%]," + "heater_2 [%]," * recorded
    lines = [head + "temperature_1 [degC],temperature_2 [degC]"]
    for number, power in enumerate(second, start=1):
        steps = np.where(times >= 60.0, 20.0 * (1 + (number - 1) % 4), 0.0)
        first, other = 23.0, 23.0
        for k, time in enumerate(times):
            read = np.array([first, other]) + generator.normal(0.0, 0.1, 2)
            own = f"{power:g}," * recorded
            lines.append(f"{time:g},{number},{steps[k]:g},{own}{read[0]:.4f},{read[1]:.4f}")
            decay = np.exp(-0.0152 / 2.0 * 2.0)
            ends = [23.0 + 1.05 * steps[k] / 100.0 / 0.0152, 23.0 + 0.96 * power / 100.0 / 0.0152]
            first, other = ends[0] + (first - ends[0]) * decay, ends[1] + (other - ends[1]) * decay
    (folder / "log.csv").write_text("\n".join(lines), encoding="utf-8")


def test_unrecorded_inputs_are_unknown_and_not_zero(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board(tmp_path, np.array([10.0, 35.0, 20.0, 5.0]), recorded=False)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    asked = ("compare", "latest", "--model", "models/heater-board.yaml")
    found = answer(*asked)
    assert found["adequate"], found["statement"]
    (note,) = [note for note in found["notes"] if note.startswith("not recorded: heater_2")]
    assert "in 4 of 4 records" in note
    off = answer(*asked, "--assume", "heater_2=0")
    assert not off["adequate"]
    assert any("assumed" in note and "heater_2 0 %" in note for note in off["notes"])


@pytest.fixture
def half_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Two runs, of which only the first recorded heater 2; their ids."""
    board(tmp_path, np.array([40.0, 60.0, 80.0, 0.0]), recorded=True, seed=4)
    board(tmp_path / "other", np.array([30.0, 50.0, 10.0, 70.0]), recorded=False, seed=3)
    monkeypatch.chdir(tmp_path)
    ids = []
    for log in ("log.csv", "other/log.csv"):
        told("import", log, "--rig", "rigs/heater-board.yaml")
        ids.append(answer("runs", "show", "latest")["id"])
    return ids


def test_an_input_recorded_in_some_records_is_used_there_and_unknown_in_the_others(
    half_recorded: list[str],
) -> None:
    model = load_model("models/heater-board.yaml")
    found = rigctl.fit([rigctl.open_run(run) for run in half_recorded], model)
    problem = found.problem
    assert [bool(record.unrecorded) for record in problem.records] == [False] * 4 + [True] * 4
    # the same point, with the common value of the unrecorded input among the unknowns or not
    free = problem.simulate(found.values, found.local).require()
    base = problem.base.copy()
    for unknown, value in zip(problem.shared, found.values, strict=True):
        base[problem.compiled.system.parameter_names.index(unknown.name)] = value
    held = problem.with_shared((), base).simulate(np.empty(0), found.local, ["record.heater_2"]).require()
    for one, other in zip(free.outputs, held.outputs, strict=True):
        np.testing.assert_array_equal(one, other)
    moved = [bool(np.any(slopes)) for slopes in held.sensitivities]
    assert moved == [False] * 4 + [True] * 4


def test_records_with_and_without_an_input_are_diagnosed_together(half_recorded: list[str]) -> None:
    found = answer("diagnose", *half_recorded, "--model", "models/heater-board.yaml")
    assert found["verdict"] == "adequate", found["statement"]
    (note,) = [note for note in found["notes"] if note.startswith("not recorded: heater_2")]
    assert "in 4 of 8 records" in note


def test_a_heater_off_in_all_records_is_estimated_as_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each short record hardly determines its heater power; all of them together do."""
    board(tmp_path, np.zeros(40), recorded=False, duration=70.0)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    found = answer("compare", "latest", "--model", "models/heater-board.yaml")
    assert found["adequate"], found["statement"]
    (heater,) = [one for one in found["record_level_summary"] if one["name"] == "heater_2"]
    assert abs(heater["mean"]) < 2.0
    rows = [one for one in found["record_level"] if one["name"] == "heater_2"]
    assert 0.2 < float(np.std([one["value"] for one in rows])) / rows[0]["std"] < 2.0


def test_assumed_inputs_are_used_and_refused_without_a_unit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board(tmp_path, np.array([0.0, 0.0, 0.0, 0.0]), recorded=False)
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    asked = ("compare", "latest", "--model", "models/heater-board.yaml")
    assert answer(*asked, "--assume", "heater_2=0 %")["adequate"]
    fitted = answer("model", "fit", *asked[3:], "latest", "--assume", "heater_2=0 %")
    assert fitted["assume"] == ["heater_2=0 %"]
    _, version = answer("model", "history", *asked[3:])["versions"]
    assert version["assume"] == ["heater_2=0 %"]
    assert "did you mean 'heater_2'" in refusal(*asked, "--assume", "heater2=0")
    assert "out of range" in refusal(*asked, "--assume", "heater_2=120")
    assert "not a value for a name" in refusal(*asked, "--assume", "heater_2")
    said = refusal(*asked, "--assume", "ambient_temperature=21")
    assert "ambient_temperature: the unit is missing" in said
    assert "21 degC" in said


def test_an_unrecorded_input_is_noted_with_the_value_assumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a range in the rig file the family's value is used; the report must state this."""
    project(tmp_path, "bench", rows_of(False))
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/bench.yaml", "--columns", "room=-")
    asked = ("compare", "latest", "--model", "models/bench.yaml", "--no-fit")
    line = "not recorded: room; taken as 20 degC, '--assume room=…' says otherwise"
    assert line in answer(*asked)["notes"]
    assert line not in answer(*asked, "--assume", "room=21 degC")["notes"]


HEATED = """
family: heated
states:
  body: {start: 20 degC, scale: 10 mK, rate: (power - loss*(body - room))/capacity}
inputs:
  power: {value: 0 W, role: heat}
  room: {value: 20 degC}
parameters:
  loss: {value: 2 W/K, bounds: [0 W/K, 100 W/K]}
  capacity: {value: 500 J/K, bounds: [1 J/K, 10000 J/K]}
outputs:
  body: {unit: degC, formula: body}
"""
HEATED_RIG = """
name: heated
model: families/heated.yaml
channels:
  body: {unit: degC, quantity: temperature, noise: 0.02 K}
actuators:
  oven: {kind: level, unit: W}
roles: {heat: {actuator: oven, channel: body, hysteresis: 1 K}}
safe_state: {oven: 0 W}
backend: {kind: simulated}
monitor_rate: 1 Hz
"""


def test_an_unrecorded_heater_without_a_range_must_be_assumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create_project(tmp_path)
    model = (
        "model: families/heated.yaml\nrig: rigs/heated.yaml\nparameters: {loss: {value: 2 W/K, fit: true}}\n"
    )
    for kind, text in (("families", HEATED), ("rigs", HEATED_RIG), ("models", model)):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / "heated.yaml").write_text(text, encoding="utf-8")
    rows = [f"{k},{20.0 + 0.01 * (k % 7):.2f}" for k in range(60)]
    (tmp_path / "log.csv").write_text("\n".join(["time [s],body [degC]", *rows]), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/heated.yaml")
    asked = ("compare", "latest", "--model", "models/heated.yaml", "--no-fit")
    assert "--assume oven=" in refusal(*asked)
    known = answer(*asked, "--assume", "oven=0 W")
    assert known["channels"]["body"]["rmse"] < 0.05
    assert "not recorded: room; taken as 20 degC, '--assume room=…' says otherwise" in known["notes"]

    said = ("--assume", "oven=0 W", "--assume", "room=20.1 degC")
    for verb in ("compare", "diagnose"):
        found = answer(verb, "latest", "--model", "models/heated.yaml", *said)
        (note,) = [note for note in found["notes"] if note.startswith("assumed of")]
        assert note.endswith("oven 0 W, room 20.1 degC")
        assert not any("not recorded: room" in note for note in found["notes"])
    shown = told("compare", "latest", "--model", "models/heated.yaml", *said)
    assert '--model models/heated.yaml --assume "oven=0 W" --assume "room=20.1 degC"' in shown
    told("report", "latest", "--model", "models/heated.yaml", *said, "-o", "page.html")
    page = re.sub(r"\s+", " ", (tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "not recorded: oven 0 W, room 20.1 " in page
    assert "no model was named" in refusal("report", "latest", *said)


def test_conditions_are_the_commands_and_not_the_initial_readings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command is the same in every record; initial readings that differ by noise are no condition."""
    board(tmp_path, np.zeros(4), recorded=True)
    text = (tmp_path / "log.csv").read_text(encoding="utf-8")
    for level in (20, 60, 80):
        text = text.replace(f",{level},0,", ",40,0,")
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    told("import", "log.csv", "--rig", "rigs/heater-board.yaml")
    found = answer("compare", "latest", "--model", "models/heater-board.yaml")
    assert "start_temperature" not in str(found)


PUMP = {
    "families": """
family: {name}
inputs:
  flow: {{value: 5 m^3/h}}
  suction: {{value: 1 m}}
parameters:
  height: {{value: 22 m, bounds: [1 m, 100 m]}}
  resistance: {{value: 1.2e6 s^2/m^5, bounds: [1e4 s^2/m^5, 1e8 s^2/m^5]}}
outputs:
  head: {{unit: m, formula: suction + height - resistance*flow^2}}
""",
    "rigs": """
name: {name}
model: families/{name}.yaml
channels:
  head: {{unit: m, quantity: position}}
  flow: {{unit: m^3/h, quantity: flow, range: [0 m^3/h, 15 m^3/h]}}
  suction: {{unit: m, quantity: other, {range}}}
""",
    "models": """
model: families/{name}.yaml
rig: rigs/{name}.yaml
parameters:
  height: {{value: 22 m}}
  resistance: {{value: 1.2e6 s^2/m^5, fit: true}}
""",
}


@pytest.mark.parametrize("known", [True, False])
def test_an_input_missing_from_a_table_is_unknown_or_assumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    for kind, text in PUMP.items():
        (tmp_path / kind).mkdir(exist_ok=True)
        said = text.format(name="stand", range="range: [0.5 m, 3 m]" if known else "noise: 1 mm")
        (tmp_path / kind / "stand.yaml").write_text(said, encoding="utf-8")
    generator = np.random.default_rng(6)
    flow = np.linspace(1.0, 12.0, 24)
    head = 2.4 + 22.0 - 1.2e6 * (flow / 3600.0) ** 2 + generator.normal(0.0, 0.02, flow.size)
    rows = [f"{q:.4f},{h:.4f}" for q, h in zip(flow, head, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["flow [m^3/h],head [m]", *rows]), encoding="utf-8")
    told("import", "log.csv", "--rig", "rigs/stand.yaml")
    found = answer("compare", "latest", "--model", "models/stand.yaml")
    (note,) = [note for note in found["notes"] if "not recorded: suction" in note]
    assert found["adequate"] is known
    assert ("between 0.5 m and 3 m" in note) is known
    assert ("taken as 1 m" in note) is not known
    said = answer("compare", "latest", "--model", "models/stand.yaml", "--assume", "suction=2.4 m")
    assert said["adequate"]
    assert any("suction 2.4 m" in note for note in said["notes"])
