"""Runs as a crate, read by the library of the authors of RO-Crate."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rocrate.rocrate import ROCrate

from commands import call, refusal, told
from dataset.forgery import sealed
from rigctl.dataset import RunWriter, calibrations_of, open_run
from rigctl.dataset.exporting import export_junit, export_ro_crate
from rigctl.dataset.storage import Store, upload
from rigctl.errors import ExitCode, RigctlError
from rigctl.testing import VirtualBench
from systems import needs_posix

STEPS = """\
identity: {serial_number: HC-0042, part: two chambers}
steps:
  - record: {name: stroke, rate: 100 Hz}
    do:
      - wait: 0.2 s
"""


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Two runs of one person on one bench, the first of a device."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    bench = VirtualBench(tmp_path, options={"plant": "roles"})
    folders = []
    for device in ({"serial_number": "HC-0042", "part": "HL32"}, {}):
        plan = bench.plan(STEPS)
        backend = bench.backend(plan.rig)
        header = bench.header(plan, backend)
        header = replace(
            header, operator="Ada Lovelace", device=device, calibrations=calibrations_of(plan.rig)
        )
        folder = bench.run(STEPS, backend=backend, writer=RunWriter.create(tmp_path / "runs", header))
        assert folder.result.folder is not None
        folders.append(folder.result.folder)
    return folders


def graph(text: str) -> dict[str, dict[str, Any]]:
    return {entity["@id"]: entity for entity in json.loads(text)["@graph"]}


def references(value: object) -> set[str]:
    """Everything that an entity refers to."""
    if isinstance(value, dict):
        here = {str(value["@id"])} if set(value) == {"@id"} else set()
        return here.union(*map(references, value.values()))
    return set().union(*map(references, value)) if isinstance(value, list) else set()


def test_a_crate_is_read_by_another_library(runs: list[Path]) -> None:
    names = [folder.name for folder in runs]
    told("export", *names, "--to", "ro-crate", "-o", "out", "--licence", "CC-BY-4.0", "--title", "strokes")
    crate = ROCrate("out")
    assert (crate.name, crate.license.id) == ("strokes", "https://spdx.org/licenses/CC-BY-4.0")
    assert [one["name"] for one in crate.root_dataset["author"]] == ["Ada Lovelace"]
    files = [entity for entity in crate.data_entities if entity.type == "File"]
    assert len(files) == 14
    for file in files:
        content = (Path("out") / file.id).read_bytes()
        assert file["sha256"] == hashlib.sha256(content).hexdigest()
        assert int(file["contentSize"]) == len(content)
    action = crate.dereference(f"#{names[0]}")
    assert action["result"].id == f"{names[0]}/"
    assert action["agent"]["name"] == "Ada Lovelace"
    made_with = {one["name"] for one in action["instrument"]}
    assert made_with == {"HL32 bench", "rigctl"}
    device = next(one for one in action["object"] if one.type == "IndividualProduct")
    assert (device["serialNumber"], device["model"]) == ("HC-0042", "HL32")
    measured = {one["name"]: one for one in crate.dereference(f"{names[0]}/")["variableMeasured"]}
    assert (measured["supply_pressure"]["unitText"], measured["supply_pressure"]["unitCode"]) == (
        "bar",
        "BAR",
    )
    assert "dead-weight tester" in measured["supply_pressure"]["measurementTechnique"]


def test_every_reference_is_valid_also_in_a_zip(runs: list[Path]) -> None:
    told("export", runs[0].name, "--to", "ro-crate", "-o", "out.zip")
    with zipfile.ZipFile("out.zip") as archive:
        entities = graph(archive.read("ro-crate-metadata.json").decode("utf-8"))
        names = set(archive.namelist())
    outward = {name for name in references(list(entities.values())) if name not in entities}
    assert outward == {"https://w3id.org/ro/crate/1.2", "http://schema.org/CompletedActionStatus"}
    assert {name for name, one in entities.items() if one["@type"] == "File"} == names - {
        "ro-crate-metadata.json"
    }
    assert entities["./"]["license"] == {"@id": "#no-licence"}
    assert ROCrate("out.zip").root_dataset["license"].id == "#no-licence"


def test_stored_and_local_runs_give_equal_crates(runs: list[Path]) -> None:
    store = Store(f"memory://crates-{id(runs)}/runs")
    upload(runs[0], store)
    for name, run in (("here", open_run(runs[0])), ("there", open_run(f"{store.address}/{runs[0].name}"))):
        assert export_ro_crate([run], Path(name)) == 7
        assert export_junit(run, Path(f"{name}.xml")) == 1
    for file in sorted(path for path in Path("here").rglob("*") if path.is_file()):
        assert (Path("there") / file.relative_to("here")).read_bytes() == file.read_bytes()
    assert Path("there.xml").read_bytes() == Path("here.xml").read_bytes()


def test_a_failed_export_leaves_nothing_behind(runs: list[Path]) -> None:
    names = [folder.name for folder in runs]
    assert "no licence" in refusal("export", names[0], "--to", "ro-crate", "-o", "a", "--licence", "my own")
    assert "several runs" in refusal("export", *names, "-o", "a.csv")
    assert "only a crate" in refusal("export", names[0], "-o", "a.csv", "--licence", "CC0-1.0")
    Path("there").mkdir()
    assert "the path exists already" in refusal("export", names[0], "--to", "ro-crate", "-o", "there")
    with (runs[1] / "events.parquet").open("ab") as file:
        file.write(b"x")
    said = refusal("export", *names, "--to", "ro-crate", "-o", "b", exit_code=1)  # type: ignore[arg-type]
    assert "changed since the run was closed" in said
    assert sorted(path.name for path in Path().iterdir()) == ["rigctl.toml", "runs", "there"]


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("files", {"../../outside.txt": {"bytes": 6, "sha256": ""}}, "names a file that is not in the run's"),
        ("files", {"C:x": {"bytes": 6, "sha256": ""}}, "names a file that is not in the run's"),
        ("files", None, "'files' is not what rigctl writes"),
        ("device", ["HC-0042"], "'device' is not what rigctl writes"),
        ("procedure", {"name": None, "text": ""}, "'procedure' is not what rigctl writes"),
        ("calibrations", {"position": None}, "'calibrations' is not what rigctl writes"),
        ("duration", None, "'duration' is not what rigctl writes"),
    ],
)
def test_a_forged_run_is_refused_and_hides_no_other(
    runs: list[Path], field: str, value: object, says: str
) -> None:
    """With a valid checksum, it used to end 'runs list', and a crate could include any file."""
    forged = runs[0].with_name("20260101-000000-forged")
    shutil.copytree(runs[0], forged)
    (runs[0].parent.parent / "outside.txt").write_text("SECRET", encoding="utf-8")
    if isinstance(value, dict) and field == "files":
        value = {name: {"bytes": 6, "sha256": hashlib.sha256(b"SECRET").hexdigest()} for name in value}
    info = {**json.loads((forged / "run.json").read_text(encoding="utf-8")), "id": forged.name, field: value}
    (forged / "run.json").write_text(sealed(info), encoding="utf-8")
    for to in ("ro-crate", "junit"):
        said = refusal("export", forged.name, "--to", to, "-o", "out", exit_code=ExitCode.FAILED)
        assert says in said
    listed = told("runs", "list", "--json")
    assert all(folder.name in listed for folder in runs)
    assert not Path("out").exists()


@needs_posix("pipes in folders, and /dev/zero")
@pytest.mark.parametrize("how", ["pipe", "device", "folder"])
@pytest.mark.parametrize("name", ["log.jsonl", "events.parquet", "run.json"])
def test_pipes_devices_and_folders_in_place_of_a_run_s_files_are_refused(
    runs: list[Path], name: str, how: str
) -> None:
    """A pipe used to block the command, and /dev/zero to fill the memory."""
    path = runs[0] / name
    path.unlink()
    {"pipe": os.mkfifo, "device": lambda to: Path(to).symlink_to("/dev/zero"), "folder": os.mkdir}[how](path)
    assert isinstance(call("export", runs[0].name, "--to", "ro-crate", "-o", "out").exception, RigctlError)
    assert runs[1].name in told("runs", "list", "--json")
    verified = call("runs", "verify", runs[0].name)
    assert verified.exception is None or isinstance(verified.exception, SystemExit)
    assert runs[0].name in verified.output
    assert not Path("out").exists()
