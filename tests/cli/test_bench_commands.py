"""The commands at the bench, on the simulated bench with the simple plant."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rigctl.cli.main import app
from rigctl.errors import RigctlError

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"
PROCEDURE = """\
procedure: one stroke
rig: rigs/bench.yaml
arguments:
  time: 0.5 s
steps:
  - prompt: {question: Room temperature?, name: room, unit: degC, low: 10 degC, high: 40 degC}
  - record: {name: stroke, rate: 100 Hz}
    do:
      - extend: {for: $time}
      - wait: 0.2 s
  - retract: {until: position < 1 mm, timeout: 5 s}
"""
Rigctl = Callable[..., Result]


@pytest.fixture
def rigctl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rigctl:
    """A command in a separate project, with a separate state folder."""
    text = RIG.read_text(encoding="utf-8").replace("model: hydraulic_cylinder", "")
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "bench.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "stroke.yaml").write_text(PROCEDURE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")

    def call(*arguments: str, typed: str = "") -> Result:
        return CliRunner().invoke(app, list(arguments), input=typed)

    return call


def told(result: Result) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(result.stdout)
    return answer


def test_simulate_prints_the_folder_of_the_run(rigctl: Rigctl) -> None:
    done = rigctl("simulate", "stroke.yaml", "--json", "--seed", "3", "--arg", "time=0.7 s")
    assert done.exit_code == 0, done.output
    answer = told(done)
    assert (answer["status"], answer["records"], answer["exit_code"]) == ("finished", 1, 0)
    info = json.loads((Path(answer["path"]) / "run.json").read_text(encoding="utf-8"))
    assert info["seed"] == 3
    assert info["arguments"]["time"] == "0.7 s"
    assert info["clock"] == "virtual"


def test_equal_seeds_give_identical_samples_and_others_do_not(rigctl: Rigctl) -> None:
    files = []
    for seed in ("7", "7", "8"):
        path = told(rigctl("simulate", "stroke.yaml", "--json", "--seed", seed))["path"]
        files.append((Path(path) / "samples.parquet").read_bytes())
    assert files[0] == files[1]
    assert files[0] != files[2]


def test_a_run_that_fails_by_a_fault_exits_with_1_and_prints_the_reason(rigctl: Rigctl) -> None:
    done = rigctl("simulate", "stroke.yaml", "--fault", "valve_stuck@0 s", "--fault", "samples_stop@0.5 s")
    assert done.exit_code == 1
    assert "failed" in done.stdout
    assert "no sample for 1 s" in done.stdout


def test_run_accepts_prepared_answers_and_replays(rigctl: Rigctl) -> None:
    first = rigctl(
        "run", "stroke.yaml", "--speed", "max", "--answer", "room=21 degC", "--json", "--operator", "Ada"
    )
    assert first.exit_code == 0, first.output
    info = json.loads((Path(told(first)["path"]) / "run.json").read_text(encoding="utf-8"))
    assert info["operator"] == "Ada"
    again = rigctl("run", "stroke.yaml", "latest", "--backend", "replay", "--speed", "max", "--json")
    assert again.exit_code == 0, again.output
    assert told(again)["records"] == 1


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        (["--answer", "room=99 degC"], "the answer to 'room' does not fit: out of range, got '99 degC'"),
        (["--answer", "room=3 bar"], "the answer to 'room' does not fit"),
        (["--answer", "rom=21 degC"], "no answer was given beforehand, got 'room'"),
        (["--answer", "room=21 degC", "--answer", "rooom=21 degC"], "did you mean 'room'"),
    ],
)
def test_prepared_answers_are_checked_before_a_run_begins(
    rigctl: Rigctl, tmp_path: Path, answers: list[str], message: str
) -> None:
    done = rigctl("run", "stroke.yaml", "--speed", "max", *answers)
    assert done.exit_code != 0
    assert message in str(done.exception) + done.output
    assert not list(tmp_path.glob("runs/*")), "a run was begun"


def test_a_dry_run_moves_nothing(rigctl: Rigctl) -> None:
    done = rigctl("run", "stroke.yaml", "--dry", "--speed", "max", "--json")
    assert told(done)["status"] == "finished"
    log = (Path(told(done)["path"]) / "log.jsonl").read_text(encoding="utf-8")
    assert '"kind":"command"' not in log


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "stroke.yaml", "--speed", "fast"], "not a speed"),
        (["simulate", "stroke.yaml", "--fault", "sensor_stick:position@1 s"], "did you mean 'sensor_stuck'"),
        (["simulate", "stroke.yaml", "--arg", "tme=1 s"], "did you mean 'time'"),
        (["simulate", "strok.yaml"], "no such file"),
        (["run", "stroke.yaml", "--backend", "simulate"], "did you mean 'simulated'"),
        (["run", "stroke.yaml", "--backend", "replay"], "which run is to be played"),
        (["run", "stroke.yaml", "--port", "COM3"], "takes no --port"),
        (["run", "stroke.yaml", "--answer", "room"], "name=value"),
        (["resume", "latest"], "there are no runs in"),
        (["pause"], "no run is in progress"),
        (["abort", "20990101"], "there are no runs in"),
        (["jog", "valv", "extend"], "did you mean 'valve'"),
        (["jog", "valve", "sideways"], "unknown position"),
        (["jog", "valve", "extend", "--speed", "max"], "its operator cannot answer at this speed"),
        (["jog", "heater", "on", "--for", "5 bar"], "wrong dimension"),
        (["monitor", "--for", "soon"], "--for: not a quantity"),
        (["monitor", "--for", "5 bar"], "expected a time in s, ms, min, h or day"),
        (["calibrate", "supply_pressure", "--valid-for", "1 bar"], "--valid-for: wrong dimension"),
        (["calibrate", "supply_pressure", "--valid-for=-1 day"], "--valid-for: too small"),
        (["monitor", "--for=-1 s"], "expected more than zero"),
    ],
)
def test_a_mistake_is_reported_without_a_traceback(
    rigctl: Rigctl, arguments: list[str], message: str
) -> None:
    done = rigctl(*arguments)
    assert done.exit_code != 0
    said = str(done.exception) + done.output
    assert message in said
    assert isinstance(done.exception, RigctlError | SystemExit), done.exception


def test_resume_refuses_a_finished_run(rigctl: Rigctl) -> None:
    rigctl("simulate", "stroke.yaml")
    done = rigctl("resume", "latest")
    assert isinstance(done.exception, RigctlError)
    assert "finished" in str(done.exception)


def test_resume_keeps_complete_records_and_repeats_the_failed_step(rigctl: Rigctl) -> None:
    text = PROCEDURE.replace("  - retract", "  - wait: {until: position > 200 mm, timeout: 1 s}\n  - retract")
    Path("stroke.yaml").write_text(text, encoding="utf-8")
    assert rigctl("simulate", "stroke.yaml").exit_code == 1
    done = rigctl("resume", "latest", "--json")
    assert done.exit_code == 1  # the same step fails again; the record stays as it is
    assert told(done)["records"] == 1
    assert "0 records left" in done.stderr


def test_resume_finishes_a_run_that_failed_by_a_fault(rigctl: Rigctl) -> None:
    assert rigctl("simulate", "stroke.yaml", "--fault", "samples_stop@0.5 s").exit_code == 1
    done = rigctl("resume", "latest", "--json")
    assert done.exit_code == 0, done.output
    assert (told(done)["status"], told(done)["records"]) == ("finished", 1)
    (run,) = told(rigctl("runs", "list", "--json"))["runs"]  # it continues in the same folder
    assert run["status"] == "finished"


def test_jog_and_off_leave_all_outputs_safe(rigctl: Rigctl) -> None:
    done = rigctl("jog", "valve", "extend", "--for", "0.5 s", "--speed", "max")
    assert done.exit_code == 0, done.output
    assert [line.split("  ")[-1] for line in done.stderr.splitlines()] == ["valve extend", "valve neutral"]
    assert "outputs are safe: heater off, valve neutral" in rigctl("off").stdout
    assert told(rigctl("off", "--json"))["rig"] == "HL32 bench"


def test_jog_without_an_operator_ends_at_once_with_the_output_off(rigctl: Rigctl) -> None:
    done = rigctl("jog", "heater", "on", "--json")
    assert done.exit_code == 1
    assert told(done)["reason"].startswith("nobody can answer 'heater is at on; Enter brings it back'")
    assert "heater off" in done.stderr


def test_jog_of_a_hand_operated_actuator_asks_the_simulated_operator(rigctl: Rigctl) -> None:
    done = rigctl("jog", "relief_valve", "30 bar", "--speed", "max", "--json")
    assert told(done)["status"] == "finished"


def test_the_rig_of_the_project_is_the_default(rigctl: Rigctl) -> None:
    Path("rigs/other.yaml").write_text("", encoding="utf-8")
    refused = str(rigctl("off").exception)
    assert "which rig?; expected --rig rigs/bench.yaml or --rig rigs/other.yaml" in refused
    Path("rigctl.toml").write_text('rig = "rigs/bench.yaml"', encoding="utf-8")
    assert told(rigctl("off", "--json"))["rig"] == "HL32 bench"


def test_a_measure_outside_its_limits_is_the_reported_reason(rigctl: Rigctl) -> None:
    limits = "low: 90 mm, missed: continue}"
    measure = f"      - measure: {{name: way, value: last(position) - first(position), unit: mm, {limits}\n"
    text = PROCEDURE.replace("  - retract", measure + "  - retract")
    Path("stroke.yaml").write_text(text, encoding="utf-8")
    reason = told(rigctl("simulate", "stroke.yaml", "--json", "--no-noise"))["reason"]
    assert reason.startswith("a measure lay outside its limits: way is ")
    assert reason.endswith("mm, expected at least 90 mm")


def test_jog_switches_the_output_off_on_enter(rigctl: Rigctl) -> None:
    done = rigctl("jog", "heater", "on", typed="\n")
    assert done.exit_code == 0, done.output
    assert "heater off" in done.stderr


def test_jog_stops_at_a_limit(rigctl: Rigctl) -> None:
    done = rigctl("jog", "valve", "extend", "--for", "5 s", "--speed", "max")
    assert done.exit_code == 1
    assert "failed: The piston is about to reach its end stop" in done.stdout


def test_jog_brings_a_level_there_at_its_max_rate(rigctl: Rigctl) -> None:
    text = (RIG.parent / "heater-board.yaml").read_text("utf-8")
    level = "heater_1: {kind: level, "
    assert level in text
    Path("slow.yaml").write_text(text.replace(level, f"{level}max_rate: 40 %/s, "), "utf-8")
    done = rigctl("jog", "heater_1", "60 %", "--for", "0.5 s", "--rig", "slow.yaml", "--speed", "max")
    assert done.exit_code == 0, done.output
    found = re.findall(r"([\d.]+) s +heater_1 ([\d.]+) %", done.stderr)
    times, levels = ([float(one[at]) for one in found] for at in (0, 1))
    assert (max(levels), levels[-1]) == (60.0, 0.0)
    rising = [*zip(times[:-1], levels[:-1], strict=True)]
    assert all(b - a <= 40.0 * (t - s) + 0.1 for (s, a), (t, b) in pairwise(rising))
    assert times[-1] - times[-2] == pytest.approx(0.5, abs=0.2)


def test_monitor_prints_text_or_one_json_object_per_sample(rigctl: Rigctl) -> None:
    done = rigctl("monitor", "--count", "3", "--json", "--speed", "max")
    assert done.exit_code == 0, done.output
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [set(line) >= {"time", "channels", "units", "commands"} for line in lines] == [True] * 3
    assert lines[0]["channels"]["supply_pressure"] == pytest.approx(20.0, abs=1.0)
    assert lines[0]["units"]["position"] == "mm"
    plain = rigctl("monitor", "--for", "1 s", "--speed", "max")
    assert len(plain.stdout.splitlines()) == 11
    assert "oil_temperature 20" in plain.stdout
    endless = rigctl("monitor", "--count", "99999999999999999999", "--for", "1 s", "--speed", "max")
    assert len(endless.stdout.splitlines()) == 11


@pytest.mark.parametrize("command", [["run", "still.yaml"], ["off", "--rig", "rig.yaml"]])
def test_a_rig_without_a_backend_is_simulated_only_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rig = "name: motor\nchannels: {speed: {unit: rpm, quantity: other}}\nactuators: {}\nsafe_state: {}\n"
    (tmp_path / "rig.yaml").write_text(rig, encoding="utf-8")
    steps = "procedure: still\nrig: rig.yaml\nsteps:\n  - wait: 1 s\n"
    (tmp_path / "still.yaml").write_text(steps, encoding="utf-8")
    with pytest.raises(RigctlError, match="does not say how its bench is reached") as refused:
        CliRunner().invoke(app, command, catch_exceptions=False)
    assert refused.value.exit_code == 2
    assert not (tmp_path / "runs").exists()
    asked = CliRunner().invoke(app, [*command, "--backend", "simulated"])
    assert asked.exit_code == 0, asked.output
