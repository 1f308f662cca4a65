"""README's lines for a bench of one's own, as typed, on logs with the headings of some forty loggers."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from commands import answer, refusal, told
from logger_headings import LOGS, ROWS, STEP
from rigctl.cli.commands.family.first_fit import FirstFit
from rigctl.dataset import open_run
from rigctl.units import parse_unit

README = Path(__file__).parents[2] / "README.md"
#: logs that do not tell when their rows were taken: the user is asked
ASKED = ("sample number", "no heading")


def own_bench_lines() -> list[list[str]]:
    """The words of README's lines for a log of one's own."""
    (block,) = re.findall(
        r"```console\n(\$ rigctl init lab .*?)```", README.read_text(encoding="utf-8"), re.DOTALL
    )
    lines = [line.removeprefix("$ ").partition(" #")[0].strip() for line in block.splitlines()]
    assert lines[0] == "rigctl init lab --minimal && cd lab"
    return [shlex.split(line)[1:] for line in lines[1:]]


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    told("init", "lab", "--minimal")
    monkeypatch.chdir("lab")
    return tmp_path


@pytest.fixture
def without_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first fit is the same for all headings, and is left out."""
    monkeypatch.setattr(
        "rigctl.cli.commands.family.first_fit.first_fit", lambda *_, **__: FirstFit(None, problem="left out")
    )


def write(lab: Path, name: str) -> None:
    (lab / "log.csv").write_text(LOGS[name].text, encoding="utf-8")


def draft_and_import(name: str, *more: str) -> None:
    """README's lines for the draft and the import; see that the run has the log's rows in the right units."""
    draft, bring_in, _ = own_bench_lines()
    done = answer(*draft, *more)
    roles = [column["role"] for column in done["columns"] if column["role"] != "left out"]
    assert roles == ["input", "output"]
    told(*bring_in)
    require_values(name)


def require_values(name: str) -> None:
    """See that the latest run has the times, the voltage and the speed of the log, in SI."""
    record = open_run("latest").record(0)
    assert np.allclose(np.diff(record.time), STEP, atol=2e-3)
    assert len(record.time) == ROWS
    (u,), (y,) = record.commands.values(), record.channels.values()
    written = LOGS[name].readings
    for values, shown, unit in zip((u, y), written, LOGS[name].units, strict=True):
        factor = parse_unit(unit or "1").factor
        assert np.allclose(values, factor * np.array(shown), atol=1e-3 * factor)


@pytest.mark.parametrize("name", [name for name in LOGS if name not in ASKED])
def test_the_lines_of_readme_draft_and_import_a_log_of_any_heading(
    lab: Path, without_fit: None, name: str
) -> None:
    write(lab, name)
    draft_and_import(name)
    drafted = shown_units()
    stated = [unit or "1" for unit in LOGS[name].units]
    assert drafted == stated


def shown_units() -> list[str]:
    """The units of voltage and speed in the drafted rig file."""
    from rigctl.rig import load_rig

    rig = load_rig("rigs/motor.yaml")
    units = [actuator.display_unit for actuator in rig.actuators.values()]
    return units + [channel.unit for channel in rig.channels.values()]


@pytest.mark.parametrize("name", ASKED)
def test_a_log_that_does_not_tell_its_times_asks_for_them(lab: Path, without_fit: None, name: str) -> None:
    write(lab, name)
    message = refusal(*own_bench_lines()[0])
    assert not list(Path("families").glob("*")) if Path("families").exists() else True
    asked = re.search(r'--unit "([^"]+)"', message)
    assert asked is not None
    draft_and_import(name, "--unit", asked.group(1))


def test_a_later_log_is_read_by_its_own_heading(lab: Path, without_fit: None) -> None:
    write(lab, "parentheses")
    told(*own_bench_lines()[0])
    text = LOGS["brackets"].text.replace("time [s],voltage [V]", "Time (s),Voltage (V)")
    (lab / "log.csv").write_text(text.replace("speed [rad/s]", "Speed (rad/s)"), encoding="utf-8")
    told(*own_bench_lines()[1])
    require_values("brackets")


def test_a_later_log_does_not_take_the_units_of_the_first(lab: Path, without_fit: None) -> None:
    write(lab, "plain names")
    told(*own_bench_lines()[0], "--unit", "voltage=V", "--unit", "speed=rpm")
    text = LOGS["plain names"].text.replace("time,voltage,speed", "time,voltage,speed [rad/s]")
    (lab / "log.csv").write_text(text, encoding="utf-8")
    assert "speed: its heading states [rad/s]" in refusal(*own_bench_lines()[1])


def test_columns_without_units_are_named_with_the_command_that_states_them(
    lab: Path, without_fit: None
) -> None:
    write(lab, "plain names")
    text = " ".join(told(*own_bench_lines()[0]).split())
    assert "states no unit for voltage, speed" in text
    again = text.partition("drafts it again: rigctl ")[2].partition(" Edit these")[0]
    units = again.replace("voltage=UNIT", "voltage=V").replace("speed=UNIT", "speed=rpm")
    told(*shlex.split(units), "--template", "motor")
    assert "unit: rpm" in Path("rigs/motor_2.yaml").read_text(encoding="utf-8")


def test_a_template_that_needs_units_asks_for_them(lab: Path, without_fit: None) -> None:
    write(lab, "plain names")
    message = refusal(*own_bench_lines()[0], "--template", "motor")
    command = message.partition("for UNIT: rigctl ")[2].partition("; or leave out")[0]
    told(*shlex.split(command.replace("voltage=UNIT", "voltage=V").replace("speed=UNIT", "speed=rpm")))
    told(*own_bench_lines()[1])
    assert open_run("latest").record(0).channels


def test_an_unknown_unit_is_said_and_not_guessed(lab: Path, without_fit: None) -> None:
    (lab / "log.csv").write_text(
        LOGS["plain names"].text.replace("voltage,speed", "voltage [V],speed [gizmo]"), encoding="utf-8"
    )
    assert "('gizmo' is no unit)" in told(*own_bench_lines()[0])
    told(*own_bench_lines()[1])


@pytest.mark.parametrize("name", ["commented notes", "labview comma"])
def test_the_last_line_of_readme_gives_a_verdict(lab: Path, name: str) -> None:
    write(lab, name)
    *first, diagnose = own_bench_lines()
    for words in first:
        told(*words)
    done = answer(*diagnose)
    assert done["verdict"] in ("adequate", "missing_effect", "ambiguous", "undecided", "outside_library")


def test_the_command_that_asks_for_units_can_be_typed_whatever_the_names(
    lab: Path, without_fit: None
) -> None:
    (lab / "log.csv").write_text(
        LOGS["plain names"].text.replace("time,voltage,speed", "time,$U,speed"), encoding="utf-8"
    )
    draft = ["family", "new", "my motor", *own_bench_lines()[0][3:]]
    message = refusal(*draft, "--template", "motor")
    assert "--template None" not in message
    command = message.partition("for UNIT: rigctl ")[2].partition("; or leave out")[0]
    words = shlex.split(command.replace("=UNIT", "=V", 1).replace("=UNIT", "=rpm"))
    assert words[2] == "my motor"
    assert "$U=V" in words
    told(*words)
