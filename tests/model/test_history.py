"""Versions of a model file are never changed or lost, despite concurrent writers and manual edits."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import (
    Change,
    Model,
    ModelError,
    current_version,
    find_version,
    load_model,
    load_version,
    parse_model,
    save_version,
    version_errors,
    versions,
)

FIT = Change("fit")


@pytest.fixture
def head(tmp_path: Path) -> Path:
    return Path(shutil.copy(shipped("models", "hl32-textbook.yaml"), tmp_path / "m.yaml"))


def kept_files(head: Path) -> dict[str, bytes]:
    folder = head.parent / ".history" / head.stem
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.suffix in (".yaml", ".json")}


def test_the_first_change_saves_the_original_as_version_one(head: Path) -> None:
    before = head.read_bytes()
    changed = load_model(head).with_values({"flow_area": 3.3e-6}, std={"flow_area": 2e-9}, source="a fit")
    error = ModelError({"position": 1.5}, 20.0, {"position": 1.7}, {"position": "mm"}, {"position": 0.2})
    choice = {"hold_out": "oil == 60 degC", "only": "oil > 20 degC", "assume": ("heater=0",)}
    done = Change("fit", runs=("a", "b"), **choice, before=error, after=replace(error))
    when = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)
    version = save_version(changed, head, done, now=when)
    first, second = versions(head)
    assert second == version == current_version(head)
    assert (first.number, first.parent, str(first.done)) == (1, None, "first version")
    assert (second.number, second.parent, second.time, second.done) == (2, 1, when, done)
    assert first.file.read_bytes() == before
    assert second.file.read_bytes() == head.read_bytes()
    stated = second.values["flow_area"]
    assert (stated.value, stated.unit, stated.std, stated.fit, stated.source) == (
        3.3,
        "mm^2",
        0.002,
        True,
        "a fit",
    )
    assert "edge_area" not in second.values  # given by the rig
    assert load_version(head, 1).values["flow_area"] == pytest.approx(4.05e-6)
    assert load_model(head).parameters["flow_area"].std == pytest.approx(2e-9)
    for file in (first.file, first.file.with_suffix(".json"), second.file):
        assert not stat.S_IMODE(file.stat().st_mode) & 0o222


def test_a_version_can_be_loaded_and_changed_like_any_model(tmp_path: Path) -> None:
    (tmp_path / "rigs").mkdir()
    shutil.copy(shipped("rigs", "hl32-bench.yaml"), tmp_path / "rigs" / "mine.yaml")
    head = tmp_path / "m.yaml"
    head.write_text("model: hydraulic_cylinder\nrig: rigs/mine.yaml\n", encoding="utf-8")
    save_version(load_model(head).with_effect("cap_leakage", {}), head, Change("add", effect="cap_leakage"))
    first = load_model(Path(f"{head}@1"))
    assert first.name == "m@1"
    assert first.path == Path(f"{head}@1")
    assert first.rig is not None
    assert not first.effects
    assert load_model(head).name == "m"
    with pytest.raises(RigctlError, match="expected 1 to 2") as refused:
        load_model(Path(f"{head}@3"))
    assert refused.value.where.file == head
    # a change of an earlier version makes the next version
    again = save_version(first.with_effect("barus", {}), Path(f"{head}@1"), Change("add", effect="barus"))
    assert (again.number, again.parent) == (3, 1)
    assert set(load_model(head).effects) == {"barus"}


def test_an_edit_by_hand_is_saved_as_a_version_before_the_next_change(head: Path) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    by_hand = head.read_text(encoding="utf-8").replace("120 N*s/m", "130 N*s/m") + "# by hand\n"
    head.write_text(by_hand, encoding="utf-8", newline="\n")
    edit = versions(head)[-1]
    assert (edit.number, edit.parent, edit.kept, str(edit.done)) == (3, 2, False, "edited by hand")
    assert load_version(head, 3).values["viscous_damping"] == 130.0
    save_version(load_model(head).with_effect("barus", {}), head, Change("add", effect="barus"))
    found = versions(head)
    assert [str(version.done) for version in found] == ["first version", "fit", "edited by hand", "add barus"]
    assert found[2].file.read_text(encoding="utf-8") == by_hand
    assert "# by hand" in head.read_text(encoding="utf-8")


def test_an_edit_during_a_fit_is_saved_as_a_version(head: Path) -> None:
    model = load_model(head)
    head.write_text("model: hydraulic_cylinder\n", encoding="utf-8")
    version = save_version(model.with_values({"flow_area": 3.3e-6}), head, FIT)
    assert [(each.number, each.parent, str(each.done)) for each in versions(head)] == [
        (1, None, "first version"),
        (2, 1, "edited by hand"),
        (3, 1, "fit"),
    ]
    assert version.number == 3
    assert load_version(head, 2).parameters == {}


def test_a_restored_file_is_recognised_as_its_earlier_version(head: Path) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    shutil.copy(find_version(head, 1).file, head)
    head.chmod(0o644)
    assert len(versions(head)) == 2
    assert current_version(head).number == 1
    assert save_version(load_model(head).with_effect("barus", {}), head, FIT).parent == 1


def test_changed_line_endings_make_no_new_version(head: Path) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    head.write_bytes(head.read_bytes().replace(b"\n", b"\r\n"))
    assert current_version(head).number == 2
    save_version(load_model(head).with_values({"flow_area": 3.4e-6}), head, FIT)
    assert [version.number for version in versions(head)] == [1, 2, 3]
    assert head.read_bytes().count(b"\n") == head.read_bytes().count(b"\r\n")


def test_a_modified_version_file_is_refused(head: Path) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    file = find_version(head, 1).file
    file.chmod(0o644)
    file.write_text("model: hydraulic_cylinder\n", encoding="utf-8")
    with pytest.raises(RigctlError, match="changed after it was kept") as refused:
        load_version(head, 1)
    assert refused.value.where.file == file


def test_an_unfinished_version_is_kept_and_its_number_is_skipped(head: Path) -> None:
    model = load_model(head)
    folder = head.parent / ".history" / "m"
    folder.mkdir(parents=True)
    (folder / "001.yaml").write_text("mod", encoding="utf-8")
    assert save_version(model.with_values({"flow_area": 3.3e-6}), head, FIT).number == 3
    assert [version.number for version in versions(head)] == [2, 3]
    assert (folder / "001.yaml").read_text(encoding="utf-8") == "mod"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"version": 1}', "\xff"])
def test_a_damaged_version_note_is_reported_with_its_file(head: Path, text: str) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    note = find_version(head, 2).file.with_suffix(".json")
    note.chmod(0o644)
    note.write_bytes(text.encode("latin-1"))
    with pytest.raises(RigctlError, match="tells of no version") as refused:
        versions(head)
    assert refused.value.where.file == note


def test_files_that_differ_only_in_their_suffix_do_not_share_versions(head: Path) -> None:
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, FIT)
    other = Path(shutil.copy(head, head.with_suffix(".yml")))
    with pytest.raises(RigctlError, match=r"versions of m\.yaml"):
        versions(other)
    head.unlink()  # a file that was renamed keeps its versions
    assert current_version(other).number == 2


def test_a_model_not_read_from_a_file_cannot_be_saved(head: Path) -> None:
    from rigctl.families.hydraulic_cylinder.family import FAMILY as HYDRAULIC_CYLINDER

    with pytest.raises(RigctlError, match="not read from a file"):
        save_version(Model(HYDRAULIC_CYLINDER), head, FIT)
    assert not (head.parent / ".history").exists()


def test_a_user_effect_is_saved_with_a_reference_to_its_file(head: Path) -> None:
    from rigctl.effects.user import load_effect

    file = head.parent / "effects" / "mine.yaml"
    file.parent.mkdir()
    text = shipped("models", "effects", "piston-leakage-eccentric.yaml").read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    effect = load_effect(file)
    changed = load_model(head).with_effect(effect, {})
    with pytest.raises(RigctlError, match="unknown effect"):
        save_version(changed, head, Change("add", effect=effect.name))
    save_version(changed, head, Change("add", effect=effect.name), effect_files=[file])
    assert "own_effects: [effects/mine.yaml]" in head.read_text(encoding="utf-8").replace('"', "")
    assert set(load_model(head).effects) == {effect.name}
    assert set(load_model(Path(f"{head}@2")).effects) == {effect.name}


def test_a_fit_records_the_errors_of_the_version_before_it_too(head: Path) -> None:
    def error(rmse: float) -> ModelError:
        return ModelError.from_si({"position": rmse * 1e-3}, {"position": "mm"}, noise={"position": 1e-4})

    model = load_model(head)
    done = Change("fit", runs=("a",), before=error(2.0), after=error(1.0))
    save_version(model.with_values({"flow_area": 3.3e-6}), head, done)
    save_version(load_model(head).without_effect("spool_lag"), head, Change("remove", effect="spool_lag"))
    found = version_errors(versions(head))
    assert [(each.version.number, each.error.rmse["position"]) for each in found] == [
        (1, pytest.approx(2.0)),
        (2, pytest.approx(1.0)),
    ]
    assert found[0].error.noise["position"] == pytest.approx(0.1)
    assert found[0].runs == ("a",)


@settings(max_examples=15)
@given(st.lists(st.sampled_from(("fit", "add", "remove", "edit", "put back", "old")), max_size=8))
def test_no_sequence_of_changes_alters_an_earlier_version(steps: list[str]) -> None:
    with TemporaryDirectory() as folder:
        head = Path(folder) / "m.yaml"
        text = "# mine\nmodel: heater_board\nparameters:\n  convection: {value: 12 mW/K, fit: true}  # U\n"
        head.write_text(text, encoding="utf-8", newline="\n")
        before: dict[str, bytes] = {}
        for count, step in enumerate(steps, start=1):
            model = load_model(head)
            old = head.read_bytes()
            if step == "fit":
                save_version(model.with_values({"convection": 0.012 + 1e-4 * count}), head, FIT)
            elif step == "add" and "radiation" not in model.effects:
                save_version(model.with_effect("radiation", {}), head, Change("add", effect="radiation"))
            elif step == "remove" and "radiation" in model.effects:
                save_version(model.without_effect("radiation"), head, Change("remove", effect="radiation"))
            elif step == "edit":
                head.write_bytes(old + f"# edit {count}\n".encode())
            elif step == "put back" and before:
                shutil.copy(find_version(head, versions(head)[0].number).file, head)
                head.chmod(0o644)
            elif step == "old" and before:
                first = Path(f"{head}@1")
                save_version(load_model(first).with_values({"convection": 0.02}), first, FIT)
            if (head.parent / ".history").exists():
                now = kept_files(head)
                assert {name: now[name] for name in before} == before
                before = now
                assert old in now.values() or step in ("edit", "put back") or old == head.read_bytes()
            assert current_version(head).number == 1 or current_version(head).parent is not None
        for version in versions(head):
            assert parse_model(version.file.read_text(encoding="utf-8")).family.name == "heater_board"


def test_concurrent_threads_lose_no_version(head: Path) -> None:
    base = load_model(head)
    areas = [3e-6 + 1e-8 * k for k in range(12)]
    with ThreadPoolExecutor(4) as pool:
        made = list(
            pool.map(lambda area: save_version(base.with_values({"flow_area": area}), head, FIT), areas)
        )
    assert sorted(version.number for version in made) == list(range(2, 14))
    for version, area in zip(made, areas, strict=True):
        assert load_version(head, version.number).values["flow_area"] == pytest.approx(area)
    assert {version.parent for version in made} == {1}
    assert head.read_bytes() in kept_files(head).values()


def test_concurrent_processes_lose_no_version(head: Path) -> None:
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from rigctl.model import Change, load_model, save_version\n"
        "head = Path(sys.argv[1])\n"
        "for _ in range(4):\n"
        "    values = {'flow_area': float(sys.argv[2])}\n"
        "    save_version(load_model(head).with_values(values), head, Change('fit', note=sys.argv[2]))\n"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", program, str(head), area]) for area in ("3.1e-6", "3.2e-6")
    ]
    assert [process.wait(600) for process in running] == [0, 0]
    found = versions(head)
    assert [version.number for version in found] == list(range(1, 10))
    assert sorted(version.done.note for version in found) == [""] + ["3.1e-6"] * 4 + ["3.2e-6"] * 4
    for version in found[1:]:
        assert load_version(head, version.number).values["flow_area"] == pytest.approx(
            float(version.done.note)
        )


def test_a_version_note_is_strict_json_without_nan(head: Path) -> None:
    error = ModelError({"position": float("nan"), "oil_temperature": 0.5})
    save_version(load_model(head).with_values({"flow_area": 3.3e-6}), head, Change("fit", after=error))
    note = json.loads(find_version(head, 2).file.with_suffix(".json").read_text(encoding="utf-8"))
    assert note["after"]["rmse"] == {"position": None, "oil_temperature": 0.5}
    after = find_version(head, 2).done.after
    assert after is not None
    assert after.rmse == {"oil_temperature": 0.5}
