"""The commands `rigctl check` and `rigctl schema`."""

from __future__ import annotations

import json
import sys
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from rigctl.cli.main import main

ROOT = Path(__file__).parents[2]
CAMPAIGN = str(ROOT / "procedures" / "campaign.yaml")


def call(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """The exit code of `rigctl` with these arguments."""
    monkeypatch.setattr(sys, "argv", ["rigctl", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    code = ended.value.code
    return code if isinstance(code, int) else 0


def test_check_prints_the_plan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(monkeypatch, "check", CAMPAIGN) == 0
    out = capsys.readouterr().out
    assert "28 records, 10500 samples, about" in out
    assert "6 more: oil=30 degC … oil=80 degC" in out


def test_check_prints_the_plan_as_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--arg", "repeats=1", "-a", "temperatures=20 degC, 60 degC", "--json")
    assert call(monkeypatch, "check", CAMPAIGN, *arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["records"] == 10
    assert document["arguments"]["temperatures"] == "20 degC, 60 degC"


def test_check_uses_the_rig_given_with_the_option(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = (ROOT / "rigs" / "hl32-bench-instrumented.yaml").as_posix()
    assert call(monkeypatch, "check", CAMPAIGN, "--rig", rig, "--json") == 0
    assert json.loads(capsys.readouterr().out)["rig_path"] == rig


def test_shipped_procedures_are_found_by_their_short_path(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "check", "procedures/quick-check.yaml", "--all") == 0
    assert "2 records" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "piece"),
    [
        (["nowhere.yaml"], "there is no such file"),
        ([CAMPAIGN, "--arg", "repeats"], "--arg: no assignment, got 'repeats'; expected name=value"),
        ([CAMPAIGN, "--arg", "repeat=1"], "did you mean 'repeats'?"),
        ([CAMPAIGN, "--arg", "pressures=60 bar"], "at most 50 bar"),
        ([CAMPAIGN, "--rig", CAMPAIGN], "this is a procedure file; expected a rig file"),
    ],
)
def test_mistakes_exit_with_2_and_a_message_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], piece: str
) -> None:
    assert call(monkeypatch, "check", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert piece in captured.err
    assert "Traceback" not in captured.err


@pytest.mark.parametrize("kind", ["rig", "model", "procedure"])
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "discharge_coefficient: 0.62",
            "discharge_coefficient: -0.62",
            "discharge_coefficient is out of bounds, got '-0.62'; expected 0.3 to 1",
        ),
        (
            "throttle_area: 3.3 mm^2",
            "throttle_area: -3.3 mm^2",
            "throttle_area is out of bounds, got '-3.3 mm^2'; expected 0.1 mm^2 to 100 mm^2",
        ),
        (
            "monitor_rate: 10 Hz",
            "monitor_rate: 1e12 Hz",
            "too large, got '1e12 Hz'; expected at most 1e+06 Hz",
        ),
    ],
)
def test_an_impossible_value_in_a_rig_file_is_refused_with_every_file_that_uses_it(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    kind: str,
    old: str,
    new: str,
    said: str,
) -> None:
    """A model with a negative flow coefficient was accepted if the rig file gave it."""
    text = (ROOT / "rigs" / "hl32-bench.yaml").read_text("utf-8")
    assert old in text
    (tmp_path / "rig.yaml").write_text(text.replace(old, new), encoding="utf-8")
    (tmp_path / "model.yaml").write_text("model: hydraulic_cylinder\nrig: rig.yaml\n", encoding="utf-8")
    procedure = "procedure: p\nrig: rig.yaml\nsteps: [wait: 1 s]\n"
    (tmp_path / "procedure.yaml").write_text(procedure, encoding="utf-8")
    line = text[: text.index(old)].count("\n") + 1
    assert call(monkeypatch, "check", str(tmp_path / f"{kind}.yaml")) == 2
    captured = capsys.readouterr().err
    assert f"rig.yaml:{line}:" in captured
    assert said in captured


@pytest.mark.parametrize("encoding", ["ascii", "cp437", "cp1252"])
def test_check_prints_to_a_terminal_with_a_limited_character_set(
    monkeypatch: pytest.MonkeyPatch, encoding: str
) -> None:
    written = BytesIO()
    stream = TextIOWrapper(written, encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    assert call(monkeypatch, "check", CAMPAIGN) == 0
    stream.flush()
    assert b"28 records" in written.getvalue()


@pytest.mark.parametrize("kind", ["procedure", "rig", "model", "effect", "family"])
def test_every_kind_of_file_has_a_json_schema(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    assert call(monkeypatch, "schema", kind) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["title"] == f"rigctl {kind}"
    assert schema["$schema"].startswith("https://json-schema.org/")


def test_a_schema_can_be_written_to_a_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    target = tmp_path / "rig.schema.json"
    assert call(monkeypatch, "schema", "rig", "-o", str(target)) == 0
    assert capsys.readouterr().out == ""
    assert json.loads(target.read_text(encoding="utf-8"))["title"] == "rigctl rig"
    assert call(monkeypatch, "schema", "procedur") == 2
    assert "did you mean 'procedure'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("rigs/heater-board.yaml", "is a rig: heater board\n  channels: temperature_1 [degC], temperature_2"),
        ("models/hl32-textbook.yaml", "is a model: hl32-textbook\n  family: hydraulic_cylinder"),
        ("models/families/water-tank.yaml", "is a family: water_tank"),
        ("models/effects/piston-leakage-eccentric.yaml", "is an effect: piston_leakage_eccentric"),
    ],
)
def test_check_identifies_the_kind_of_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], file: str, said: str
) -> None:
    assert call(monkeypatch, "check", str(ROOT / file)) == 0
    assert said in capsys.readouterr().out
    assert call(monkeypatch, "check", str(ROOT / file), "--json") == 0
    assert json.loads(capsys.readouterr().out)["kind"] in said


@pytest.mark.parametrize(
    ("channel", "family", "right"),
    [
        ("rpm", "rad/s", True),
        ("1/min", "1/s", True),
        ("1/min", "rad/s", False),
        ("rpm", "Hz", False),
    ],
)
def test_a_count_per_time_is_not_a_rotational_speed(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    channel: str,
    family: str,
    right: bool,
) -> None:
    """Both are 1/s to SI, and turns are 2π radians: a motor's model would be off by that."""
    rate = f"states: {{speed: {{start: 0 {family}, scale: 1 {family}, rate: -speed/lag}}}}\n"
    lag = "parameters: {lag: {value: 1 s, bounds: [0.1 s, 10 s]}}\n"
    outputs = f"outputs: {{speed: {{unit: {family}, formula: speed}}}}\n"
    (tmp_path / "family.yaml").write_text(f"family: wheel\n{rate}{lag}{outputs}", encoding="utf-8")
    (tmp_path / "rig.yaml").write_text(
        f"name: wheel\nmodel: family.yaml\nchannels: {{speed: {{unit: {channel}, quantity: other}}}}\n"
    )
    assert call(monkeypatch, "check", str(tmp_path / "rig.yaml")) == (0 if right else 2)
    assert right or "rad/s" in capsys.readouterr().err


def test_check_refuses_foreign_and_invalid_files(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "data.csv").write_text("time [s],a\n0,1\n", encoding="utf-8")
    assert call(monkeypatch, "check", str(tmp_path / "data.csv")) == 2
    assert "this is not a rigctl file" in capsys.readouterr().err
    (tmp_path / "list.yaml").write_text("- a\n", encoding="utf-8")
    assert call(monkeypatch, "check", str(tmp_path / "list.yaml")) == 2
    assert "got 'a list'" in capsys.readouterr().err  # it said 'nothing'
    assert call(monkeypatch, "check", str(tmp_path)) == 2
    assert "this is a folder; expected a YAML file" in capsys.readouterr().err
    (tmp_path / "rig.yaml").write_text("name: b\nchannels:\n  a: {unit: rpmm, quantity: other}\n")
    assert call(monkeypatch, "check", str(tmp_path / "rig.yaml")) == 2
    assert "rig.yaml:3:13: unit: unknown unit, got 'rpmm'; expected a unit such as" in capsys.readouterr().err
    assert call(monkeypatch, "check", str(ROOT / "rigs/heater-board.yaml"), "--arg", "a=1") == 2
