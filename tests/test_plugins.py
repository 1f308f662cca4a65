"""What other packages add by entry points: a backend, a reader, a writer, and one that is broken."""

from __future__ import annotations

import json
import sys
from contextlib import chdir
from pathlib import Path

import pytest

import own_process
from commands import call, refusal
from doc_page import blocks
from patience import patient

PACKAGE = """
import json
from pathlib import Path

from rigctl.backends.registry import create_backend
from rigctl.dataset.importing.formats.csv_file import open_csv


class backend:
    @staticmethod
    def create(rig, clock, options):
        return create_backend(rig, "simulated", clock, {"plant": "roles", "seed": 1, **options})


def read_log(path, options):
    return open_csv(path, options)


def write_lines(path, table, names, title):
    Path(path).write_text("\\n".join(map(json.dumps, table.column_names)), encoding="utf-8")
"""

POINTS = """\
[rigctl.backends]
tally = tally_plugin:backend
[rigctl.importers]
.tally = tally_plugin:read_log
.torn = tally_plugin:no_such_thing
[rigctl.exporters]
.lines = tally_plugin:write_lines
"""

RIG = """\
name: tally
backend: {kind: tally}
channels:
  oil_temperature: {unit: degC, quantity: temperature}
actuators:
  heater: {kind: switch, power: 2000 W}
roles:
  heat: {actuator: heater, channel: oil_temperature}
safe_state: {heater: off}
simulation: {initial: {oil_temperature: 20 degC}, ambient_temperature: 20 degC}
"""

STEP = """\
procedure: step
rig: rig.yaml
steps:
  - set: {heater: on}
  - wait: 0.5 s
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project, with the package installed as an installer leaves it behind."""
    site = tmp_path / "site"
    metadata = site / "tally_plugin-1.2.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: tally-plugin\nVersion: 1.2\n", "utf-8")
    (metadata / "entry_points.txt").write_text(POINTS, encoding="utf-8")
    (site / "tally_plugin.py").write_text(PACKAGE, encoding="utf-8")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")
    for name, text in (("rigctl.toml", ""), ("rig.yaml", RIG), ("step.yaml", STEP)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_a_run_on_a_foreign_backend_is_exported_by_a_foreign_writer(project: Path) -> None:
    with chdir(project):
        done = call("run", "step.yaml", "--json", "--answer-in-browser")
        assert done.exit_code == 0, done.exception
        assert call("export", "latest", "-o", "run.lines").exit_code == 0
        columns = [json.loads(line) for line in (project / "run.lines").read_text("utf-8").splitlines()]
        assert any(name.startswith("oil_temperature") for name in columns)


def test_doctor_does_not_say_that_a_backend_with_a_protocol_of_its_own_is_in_order(project: Path) -> None:
    """It has no address either; a class of its own that is named Options is nothing that rigctl reads."""
    package = project / "site" / "tally_plugin.py"
    text = PACKAGE.replace("class backend:\n", "class backend:\n    class Options:\n        speed = 3\n\n")
    package.write_text(text, encoding="utf-8")
    sys.modules.pop("tally_plugin", None)
    with chdir(project):
        said = call("doctor", "--rig", "rig.yaml").output
    (line,) = [line for line in said.splitlines() if "a bench of the plug-in 'tally'" in line]
    assert "✓" not in line


def test_a_file_is_imported_by_a_foreign_reader(project: Path) -> None:
    (project / "log.tally").write_text(
        "time [s],oil_temperature [degC]\n0,20\n1,21\n2,22\n", encoding="utf-8"
    )
    with chdir(project):
        done = call("import", "log.tally", "--rig", "rig.yaml", "--json")
        assert done.exit_code == 0, done.exception


def test_a_broken_plugin_is_one_line_of_doctor_and_breaks_nothing_else(project: Path) -> None:
    with chdir(project):
        (line,) = [line for line in call("doctor").output.splitlines() if ".torn (plug-in)" in line]
        assert "a reader of files of tally-plugin 1.2" in line
        assert "no_such_thing" in line
        assert call("check", "step.yaml").exit_code == 0
        (project / "log.torn").write_text("time [s],pressure [bar]\n0,1\n", encoding="utf-8")
        assert "registered by the package tally-plugin 1.2 cannot be loaded" in refusal("import", "log.torn")


def test_an_unknown_kind_names_the_nearest_of_all(project: Path) -> None:
    (project / "rig.yaml").write_text(RIG.replace("kind: tally", "kind: taly"), encoding="utf-8")
    with chdir(project):
        assert "did you mean 'tally'" in refusal("check", "step.yaml").casefold().replace('"', "'")


HOW_TO = Path(__file__).parents[1] / "docs" / "how-to" / "write-a-plugin.md"

#: a library as the page has one; it keeps what was set
LIBRARY = """
from pathlib import Path


class connect:
    def __init__(self, url, timeout):
        self._held = {1: 25.0}
        self._log = Path(__file__).with_name("set.txt")

    def get(self, address):
        return self._held.get(address, 0.0)

    def set(self, address, value):
        self._held[address] = value
        with self._log.open("a", encoding="utf-8") as log:
            log.write(f"{address} {value}\\n")

    def close(self):
        pass
"""

OPTIONS = """\
backend:
  kind: mybench
  port: 192.168.0.50
  options:
    timeout: 1 s
    channels: {oil_temperature: 1}
    actuators: {heater: {address: 2}}
stale_after: 2 s
"""


def test_the_backend_of_the_how_to_drives_a_bench(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a package of its own, in this process and in that of the guard."""
    (module,) = (
        block.text
        for block in blocks(HOW_TO.read_text("utf-8"))
        if block.kind == "python" and "PluginBackend(" in block.text
    )
    site = project / "site"
    (site / "mybench.py").write_text(module, encoding="utf-8")
    (site / "mylibrary.py").write_text(LIBRARY, encoding="utf-8")
    points = site / "tally_plugin-1.2.dist-info" / "entry_points.txt"
    points.write_text("[rigctl.backends]\nmybench = mybench:BACKEND\n", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(site))
    rig = project / "rig.yaml"
    rig.write_text(patient(RIG.replace("backend: {kind: tally}\n", OPTIONS), wake="60 s"), encoding="utf-8")
    code, out, err = own_process.rigctl(project, "run", "step.yaml", "--json")
    assert code == 0, out + err
    lines = (site / "set.txt").read_text("utf-8").splitlines()
    assert "2 1.0" in lines
    assert lines[-1] == "2 0.0"
    rig.write_text(rig.read_text("utf-8").replace("address: 2", "adress: 2"), encoding="utf-8")
    with chdir(project):
        assert "did you mean 'address'" in refusal("check", "step.yaml")
