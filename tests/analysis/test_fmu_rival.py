"""FMUs beside a model, run by FMPy on records of the simulated heater board."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from scipy.stats import binomtest

from commands import answer, refusal, told
from foreign_fmus import lag_fmu
from rigctl.analysis.fitting import fit_to_data, read_runs
from rigctl.analysis.fmu_rival import judge_fmu
from rigctl.analysis.fmu_rival.judge import sign_test
from rigctl.answers.fmu_rival import rival_blocks
from rigctl.cli.blocks import show
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.errors import ExitCode, RigctlError
from rigctl.model import load_model
from rigctl.model.fit.fit import FitResult
from rigctl.model.fmu import export_fmu
from rigctl.model.fmu.export import _compiled
from systems import needs_compiler, needs_signals

STEPS = """\
procedure: eight
rig: rigs/heater-board.yaml
steps:
  - for: {level: {from: 20 %, to: 90 %, step: 10 %}}
    do:
      - record: {name: warm, rate: 1 Hz}
        do:
          - set: {heater_1: $level}
          - wait: 30 s
          - set: {heater_1: 0 %}
          - wait: 10 s
"""


pytestmark = needs_compiler


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of eight records, the model that it obeys and one that it does not, and an FMU of each."""
    folder = tmp_path_factory.mktemp("rivals")
    create_project(folder)
    (folder / "procedures" / "eight.yaml").write_text(STEPS, encoding="utf-8")
    text = (folder / "models" / "heater-board.yaml").read_text(encoding="utf-8").replace(", fit: true", "")
    for name, loss in (("right", "16 mW/K"), ("wrong", "40 mW/K")):
        path = folder / "models" / f"{name}.yaml"
        path.write_text(text.replace("12 mW/K", loss), encoding="utf-8")
        export_fmu(load_model(path), folder / f"{name}.fmu")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        told("simulate", "procedures/eight.yaml", "--seed", "3")
    return folder


@pytest.fixture(scope="module")
def fits(project: Path) -> dict[str, FitResult]:
    """Both models on the run, with only the record-level unknowns fitted."""
    run = open_run("latest", project / "runs")
    found = {}
    for name in ("right", "wrong"):
        model = load_model(project / "models" / f"{name}.yaml")
        found[name] = fit_to_data(model, read_runs(model, [run]))
    return found


def test_the_fmu_of_the_true_model_is_nearer_in_every_record(
    project: Path, fits: dict[str, FitResult]
) -> None:
    found = judge_fmu(project / "right.fmu", fits["wrong"], "wrong")
    assert (found.nearer, found.further, found.records) == (8, 0, 8)
    assert "right.fmu is nearer than wrong in 8 of 8 records" in found.statement
    wrong = judge_fmu(project / "wrong.fmu", fits["right"], "right")
    assert (wrong.nearer, wrong.further, wrong.decided) == (0, 8, True)


def test_a_model_is_not_distinguished_from_its_own_fmu(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fitting record-level unknowns does not make a model better than its own FMU."""
    monkeypatch.chdir(project)
    (found,) = answer("compare", "latest", "-m", "models/right.yaml", "--rival", "right.fmu")["rivals"]
    assert "do not show which of the two is better" in found["statement"]
    assert found["channels"]["temperature_1"]["nrmse"] == pytest.approx(1.0, abs=0.1)


def with_text(source: Path, target: Path, name: str, change: Callable[[bytes], bytes]) -> None:
    """A copy of an archive with one of its files changed."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            new.writestr(entry, change(content) if entry.filename == name else content)


def test_channels_that_start_from_the_own_value_of_the_fmu_are_named(
    project: Path, fits: dict[str, FitResult], capsys: pytest.CaptureFixture[str]
) -> None:
    with_text(
        project / "right.fmu",
        project / "fixed.fmu",
        "modelDescription.xml",
        lambda text: text.replace(b'name="state.temperature_1"', b'name="hidden"'),
    )
    found = judge_fmu(project / "fixed.fmu", fits["right"], "right")
    assert found.own_initial_values == ("temperature_1",)
    assert found.document()["begins_elsewhere"] == ["temperature_1"]
    show(rival_blocks(found))
    shown = capsys.readouterr().out
    assert "the initial value of temperature_1 cannot be set in fixed.fmu: its own is used" in shown


def test_outputs_are_converted_from_the_units_declared_by_the_fmu(
    project: Path, fits: dict[str, FitResult]
) -> None:
    def celsius(text: bytes) -> bytes:
        head, output = text.rsplit(b'name="temperature_1"', 1)
        defined = head.replace(b"<UnitDefinitions>", b'<UnitDefinitions><Unit name="degC"/>')
        return defined + b'name="temperature_1"' + output.replace(b'unit="K"', b'unit="degC"', 1)

    with_text(project / "right.fmu", project / "celsius.fmu", "modelDescription.xml", celsius)
    found = judge_fmu(project / "celsius.fmu", fits["right"], "right")
    assert found.channels["temperature_1"].nrmse > 5.0


def test_an_fmu_that_crashes_or_does_not_match_the_data_is_reported(
    project: Path, fits: dict[str, FitResult]
) -> None:
    source = project / "right.fmu"
    with zipfile.ZipFile(source) as archive:
        (library,) = (name for name in archive.namelist() if name.startswith("binaries/"))
        files = {name: archive.read(name) for name in archive.namelist()}
    files["sources/slave.c"] = files["sources/slave.c"].replace(b"s->time = at;", b"abort();", 1)
    broken = _compiled(files, Path(library).name)
    with_text(source, project / "crashing.fmu", library, lambda _: broken)
    with_text(
        source,
        project / "other.fmu",
        "modelDescription.xml",
        lambda text: text.replace(b'name="heater_1"', b'name="heater_7"'),
    )
    for name, said in (
        ("crashing", r"crashing\.fmu: the FMU has crashed"),
        (
            "other",
            r"other\.fmu: the FMU needs an input that the data do not have, got 'heater_7'.*"
            r"did you mean 'heater_\d'\?",
        ),
    ):
        with pytest.raises(RigctlError, match=said):
            judge_fmu(project / f"{name}.fmu", fits["right"], "right")


def test_a_file_that_is_no_fmu_is_refused_before_any_work(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to be refused after the comparison: here not even the run exists."""
    monkeypatch.chdir(project)
    Path("text.fmu").write_text("no archive", encoding="utf-8")
    with zipfile.ZipFile("bare.fmu", "w") as archive:
        archive.writestr("model.txt", "no description")
    with zipfile.ZipFile("double.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    for name, said in (
        ("text", "it is not a zip archive"),
        ("bare", "it has no modelDescription.xml"),
        ("double", "it has 2 files modelDescription.xml"),
    ):
        words = ("compare", "no-such-run", "-m", "models/right.yaml", "--rival", f"{name}.fmu")
        assert refusal(*words) == f"{name}.fmu: --rival: this is not an FMU: {said}"


def hanging(project: Path, where: bytes) -> Path:
    """An FMU that prints forever and never returns from a step."""
    source = project / "right.fmu"
    with zipfile.ZipFile(source) as archive:
        (library,) = (name for name in archive.namelist() if name.startswith("binaries/"))
        files = {name: archive.read(name) for name in archive.namelist()}
    code = files["sources/slave.c"].replace(where, b'for (;;) puts("7 of 9\\n");', 1)
    files["sources/slave.c"] = b"#include <stdio.h>\n" + code
    broken = _compiled(files, Path(library).name)
    with_text(source, project / "hanging.fmu", library, lambda _: broken)
    return project / "hanging.fmu"


def test_an_fmu_that_never_returns_is_stopped_at_its_timeout(
    project: Path, fits: dict[str, FitResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to block the command for ten minutes without a message and to leave temporary files."""
    temporary = project / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    progress: list[str] = []
    fmu = hanging(project, b"s->time = at;")
    with pytest.raises(RigctlError, match=r"not finished simulation 1 of \d+ in 3 s.* '--rival-timeout'"):
        judge_fmu(fmu, fits["right"], "right", progress.append, 3.0)
    assert progress
    assert {line.partition(" of ")[0] for line in progress} == {"Running hanging.fmu: simulation 1"}
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(("version", "kind"), [("2.0", "ModelExchange"), ("3.0", "CoSimulation")])
def test_a_foreign_fmu_is_compared(
    project: Path, monkeypatch: pytest.MonkeyPatch, version: str, kind: str
) -> None:
    """Its temperature only rises, unlike the board's, but begins where the readings do."""
    monkeypatch.chdir(project)
    slow = "m->on * m->u / 100.0"
    lag_fmu(Path("lag.fmu"), version, kind, rate=slow, names=("heater_1", "temperature_1"))
    (found,) = answer("compare", "latest", "-m", "models/right.yaml", "--rival", "lag.fmu")["rivals"]
    assert (found["nearer"], found["further"]) == (0, 8)
    assert found["begins_elsewhere"] == []
    assert "temperature_2" in found["missing"]


@needs_signals
def test_ctrl_c_ends_a_comparison_with_an_fmu_that_never_returns(project: Path) -> None:
    hanging(project, b"s->time = at;")
    words = ["compare", "latest", "-m", "models/right.yaml", "--rival", "hanging.fmu"]
    with subprocess.Popen(
        [sys.executable, "-m", "rigctl", *words], cwd=project, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        while "simulation 1 of" not in (line := process.stderr.readline()):
            assert line, "it ended by itself"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=600.0)
    assert process.returncode == ExitCode.INTERRUPTED
    assert "Stopped; nothing was saved" in said
    assert "Traceback" not in said


def test_a_hostile_archive_is_refused_before_it_is_unpacked(
    project: Path, fits: dict[str, FitResult]
) -> None:
    source, about = project / "right.fmu", "modelDescription.xml"

    def entity(text: bytes) -> bytes:
        declared = b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
        return text.replace(b"<fmiModelDescription", declared + b"<fmiModelDescription", 1)

    with_text(source, project / "entity.fmu", about, entity)
    with_text(source, project / "bomb.fmu", "none", bytes)
    with zipfile.ZipFile(project / "bomb.fmu", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/zeros", bytes(110_000_000))
    with_text(source, project / "outside.fmu", "none", bytes)
    with zipfile.ZipFile(project / "outside.fmu", "a") as archive:
        archive.writestr("../outside.txt", "written")
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(project / "elsewhere.fmu", "w") as new:
        for entry in old.infolist():
            parts = entry.filename.split("/")
            name = "/".join([parts[0], "amiga68", *parts[2:]]) if parts[0] == "binaries" else entry.filename
            new.writestr(name, old.read(entry))
    for name, said in (
        ("entity", "declares a document type"),
        ("bomb", "unpacks to too much"),
        ("outside", "lies outside its folder"),
        ("elsewhere", "no program for this computer, got 'amiga68'"),
    ):
        with pytest.raises(RigctlError, match=said):
            judge_fmu(project / f"{name}.fmu", fits["right"], "right")


def test_nan_outputs_of_an_fmu_are_refused(project: Path, fits: dict[str, FitResult]) -> None:
    """NaN marks channels that an FMU does not have, which would count as exact."""
    source = project / "wrong.fmu"
    with zipfile.ZipFile(source) as archive:
        (library,) = (name for name in archive.namelist() if name.startswith("binaries/"))
        files = {name: archive.read(name) for name in archive.namelist()}
    change = (b"value[i] = outputs[", b"value[i] = s->time > 10.0 ? 0.0/0.0 : outputs[")
    assert change[0] in files["sources/slave.c"]
    files["sources/slave.c"] = files["sources/slave.c"].replace(*change)
    broken = _compiled(files, Path(library).name)
    with_text(source, project / "nan.fmu", library, lambda _: broken)
    with pytest.raises(RigctlError, match="temperature_1 is nan"):
        judge_fmu(project / "nan.fmu", fits["right"], "right")


@pytest.mark.parametrize(("nearer", "count"), [(0, 0), (4, 8), (1, 9), (8, 8), (0, 11), (20, 27)])
def test_the_sign_test_agrees_with_the_binomial_test(nearer: int, count: int) -> None:
    expected = binomtest(nearer, count, 0.5).pvalue if count else 1.0
    assert sign_test(nearer, count) == pytest.approx(expected, rel=1e-12)
