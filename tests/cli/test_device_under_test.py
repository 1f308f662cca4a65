"""A device under test from the procedure to the reports that others read."""

from __future__ import annotations

import io
import json
from contextlib import chdir
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from junitparser import Error, Failure, JUnitXml

import rigctl
from commands import call, refusal, told
from rigctl.cli.commands.init import create_project
from rigctl.cli.options.identity import identified
from rigctl.cli.plans import open_plan
from rigctl.errors import RigctlError
from rigctl.procedure import parse_procedure

PROCEDURE = """\
procedure: acceptance
rig: rigs/heater-board.yaml
identity:
  serial_number: {required: true, pattern: "HB-[0-9]{4}"}
  part: two heaters
  operator: {required: true}
steps:
  - for: {level: [10 %, 60 %]}
    do:
      - record: {name: warm, rate: 2 Hz}
        do:
          - set: {heater_1: $level}
          - wait: 5 s
          - measure: {name: top, value: max(temperature_1), unit: degC, high: 23.5 degC, missed: continue}
          - measure: {name: rows, value: duration, unit: s, low: 4 s}
          - measure: {name: unjudged, value: mean(temperature_2), unit: degC}
          - prompt: {question: Which?, name: typed, unit: "1", low: "1", high: "3"}
"""
SAID = ("--serial-number", "HB-0042", "--operator", "Ada", "--notes", "after repair")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with one run whose second record misses a limit."""
    folder = tmp_path_factory.mktemp("acceptance")
    create_project(folder)
    (folder / "procedures" / "acceptance.yaml").write_text(PROCEDURE, encoding="utf-8")
    with chdir(folder):
        done = call(
            "run", "procedures/acceptance.yaml", "--backend", "simulated", "--speed", "max", "--json", *SAID
        )
        assert done.exit_code == 1
        assert json.loads(done.stdout)["test"] == {"result": "fail", "passed": 3, "missed": 1}
    return folder


@pytest.mark.usefixtures("project")
def test_the_device_of_a_run_is_stored_and_listed(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    info = json.loads(told("runs", "show", "latest", "--json"))
    assert info["device"] == {"serial_number": "HB-0042", "part": "two heaters", "notes": "after repair"}
    assert info["operator"] == "Ada"
    listed = told("runs", "list")
    assert "HB-0042" in listed
    assert "fail" in listed
    assert "fail, 1 of 4 measures outside their limits" in told("runs", "show")
    asked = "SELECT serial_number, part, operator, device_notes, test, passed, missed FROM runs"
    answer = json.loads(told("runs", "sql", asked, "--json"))
    assert answer["rows"] == [["HB-0042", "two heaters", "Ada", "after repair", "fail", 3, 1]]
    told("report", "latest", "-o", "page.html")
    assert "HB-0042" in Path("page.html").read_text("utf-8")


def test_junit_xml_is_read_by_junitparser(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    told("export", "latest", "-o", "results.xml")
    (suite,) = JUnitXml.fromfile("results.xml")
    assert (suite.name, suite.tests, suite.failures, suite.errors) == ("acceptance", 5, 1, 0)
    facts = {one.name: one.value for one in suite.properties()}
    assert facts["serial_number"] == "HB-0042"
    failed = [case for case in suite if case.result]
    (failure,) = failed[0].result
    assert (len(failed), type(failure)) == (1, Failure)
    assert failed[0].classname == "acceptance.warm"
    assert "expected at most 23.5 degC" in failure.message
    # the schema of Ant's JUnit task requires these attributes and parts of a suite, in this order
    root = ET.parse("results.xml").getroot()
    parts = [child.tag for child in root[0]]
    assert parts == ["properties", *["testcase"] * 5, "system-out", "system-err"]
    required = {"name", "timestamp", "hostname", "tests", "failures", "errors", "time", "package", "id"}
    assert required <= set(root[0].attrib)
    names = [(case.get("classname"), case.get("name")) for case in root.iter("testcase")]
    assert len(set(names)) == len(names)
    assert "unknown form" in refusal("export", "latest", "--to", "junt")


def test_an_incomplete_run_is_an_error_in_junit_xml(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    text = PROCEDURE.replace("required: true", "required: false").replace("60 %]", "20 %]")
    Path("procedures/broken.yaml").write_text(
        text.replace("procedure: acceptance", "procedure: broken").replace("high: 23.5", "high: 60")
        + "  - hold: {for: 1 s, channel: temperature_1, at: 90 degC, within: 1 K}\n",
        encoding="utf-8",
    )
    done = call("simulate", "procedures/broken.yaml", "--json")
    answer = json.loads(done.stdout)
    assert answer["test"] == {"result": "incomplete", "passed": 4, "missed": 0}
    told("export", answer["run"], "-o", "broken.xml")
    (suite,) = JUnitXml.fromfile("broken.xml")
    assert suite.errors == 1
    assert [type(found) for case in suite for found in case.result] == [Error]


def test_a_required_identity_is_prompted_for_until_it_is_valid(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(project)
    text = refusal("run", "procedures/acceptance.yaml", "--backend", "simulated")
    assert "--serial-number and --operator" in text
    plan = open_plan(Path("procedures/acceptance.yaml"))
    with pytest.raises(RigctlError, match="does not match the procedure's pattern"):
        identified(plan, {"serial_number": "HB-0042x"})
    monkeypatch.setattr("rigctl.cli.attended_run.typing_possible", lambda: True)
    monkeypatch.setattr("sys.stdin", io.StringIO("HB-42\nHB-0007\nAda\n"))
    found = identified(plan, {})
    assert (found.serial_number, found.operator, found.part) == ("HB-0007", "Ada", "two heaters")
    assert "got 'HB-42'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('serial_number: {pattern: "HB-["}', "not a regular expression"),
        ('serial_number: {pattern: "HB-[0-9]", default: HX}', "does not match the pattern"),
        ("serial: {required: true}", "serial_number"),
        ("serial_number: 0042", "text"),
        ("serial_number: {required: perhaps}", "true or false"),
    ],
)
def test_a_wrong_identity_is_refused_at_its_place(line: str, said: str) -> None:
    written = PROCEDURE.partition("identity:\n")[0] + f"identity:\n  {line}\nsteps:\n  - wait: 1 s\n"
    with pytest.raises(RigctlError, match=said) as caught:
        parse_procedure(written)
    assert caught.value.where.line == 4


def test_every_command_enforces_the_required_identity(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    known = {"person": "Ada", "device": {"serial_number": "HB-0042"}}
    for said in ({}, {**known, "person": ""}, {**known, "device": {}}):
        with pytest.raises(RigctlError, match="the procedure requires"):
            rigctl.run("procedures/acceptance.yaml", backend="emulated", **said)  # type: ignore[arg-type]
    with pytest.raises(RigctlError, match="does not match"):
        rigctl.run("procedures/acceptance.yaml", backend="emulated", device={"serial_number": "x"})


def test_a_serial_number_pattern_cannot_take_exponential_time() -> None:
    """A backtracking matcher would need centuries for this pattern."""
    text = PROCEDURE.replace("HB-[0-9]{4}", "(a+)+b")
    demands = parse_procedure(text).identity
    assert not demands.serial_number.matches("a" * 200)


@pytest.mark.parametrize("text", ["", "   "])
def test_an_empty_serial_number_is_refused_instead_of_replaced_by_the_default(
    project: Path, text: str
) -> None:
    """It used to be recorded under the default serial number, that of another device."""
    path = project / "procedures" / "default.yaml"
    path.write_text(
        PROCEDURE.replace("{required: true, pattern", "{default: HB-0001, pattern"), encoding="utf-8"
    )
    with chdir(project):
        said = refusal("simulate", "procedures/default.yaml", "--serial-number", text)
    number = "the serial number" if text else "--serial-number"
    assert said.startswith(f"{number} is empty; expected")
