"""`rigctl effects`: the library listed, shown and drawn; a user's file checked; the how-to page followed."""

from __future__ import annotations

import json
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import commands
from commands import told as said
from rigctl.effects import library, registry
from rigctl.errors import RigctlError
from rigctl.physics.families import FAMILIES

HOW_TO = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "write-an-effect.md"
EXAMPLE = "models/effects/piston-leakage-eccentric.yaml"

answer = partial(commands.answer, "effects")


def test_the_list_has_every_effect_of_every_family() -> None:
    listed = [(each["family"], each["effect"]) for each in answer("list")["effects"]]
    assert listed == [(family, name) for family in FAMILIES for name in library(family)]
    text = said("effects", "list", "--family", "heater_board")
    assert "power_law_convection" in text
    assert "piston_leakage" not in text


def test_slots_list_the_variables_of_a_term() -> None:
    (family,) = answer("list", "--slots", "--family", "hydraulic_cylinder")["families"]
    slots = {slot["name"]: slot for slot in family["slots"]}
    assert slots["throttle_area"]["combine"] == "product"
    assert slots["throttle_area"]["local"] == [{"name": "reynolds", "unit": "1"}]
    assert {"name": "viscosity", "unit": "Pa*s", "meaning": "oil in the cylinder"} in family["variables"]


SPINDLE = """
family: spindle
states:
  speed: {start: 0 rpm, scale: 1 rpm, rate: (gain*command + friction)/inertia}
inputs:
  command: {value: 0 percent}
parameters:
  gain: {value: 1 N*m, bounds: [0 N*m, 10 N*m]}
constants: {inertia: 1e-3 kg*m^2}
slots:
  friction: {unit: N*cm, meaning: at the bearing}
  speed_error: {unit: rpm, kind: sensor, meaning: of the tachometer}
  drift: {unit: degC, kind: sensor, meaning: of the thermometer}
outputs:
  speed: {unit: rpm, formula: speed + speed_error}
  housing: {unit: degC, formula: 20 degC + drift}
"""


def test_slots_have_the_units_of_the_family_file(tmp_path: Path) -> None:
    """A speed declared in rpm was listed in rad/s; a term in degC is an interval, so in K."""
    file = tmp_path / "spindle.yaml"
    file.write_text(SPINDLE, encoding="utf-8")
    (family,) = answer("list", "--slots", "--family", str(file))["families"]
    units = {slot["name"]: slot["unit"] for slot in family["slots"]}
    assert units == {"friction": "N*cm", "speed_error": "rpm", "drift": "K"}
    head, _, tail = SPINDLE.partition("slots:")
    without = head + "outputs:" + tail.partition("outputs:")[2]
    for term in (" + friction", " + speed_error", " + drift"):
        without = without.replace(term, "")
    file.write_text(without, encoding="utf-8")
    (family,) = answer("list", "--slots", "--family", str(file))["families"]
    units = {slot["name"]: slot["unit"] for slot in family["slots"]}
    assert {units["command_input"], units["speed_reading"], units["housing_reading"]} == {
        "percent",
        "rpm",
        "K",
    }


def test_an_effect_is_shown_with_its_picture() -> None:
    text = said("effects", "show", "piston_leakage")
    for piece in (
        "Q_AB = k·(p_A − p_B)/µ",
        "adds at flow_a_to_b [m^3/s]: conductance*(pressure_a - pressure_b)/viscosity",
        "0 m^3 to (2e-13 m^3)",
        "looks like: ",
        "confused with: rod_leakage, cap_leakage, valve_leakage",
        "source: Merritt",
        "wait 0.2 s, extend 1.05 s, hold closed 1 s, retract 1.5 s",
        "oil_temperature: no change",
    ):
        assert piece in text, piece
    assert len(re.findall(r"│[\u2800-\u28ff]{60}$", text, re.MULTILINE)) == 16


def test_the_json_answer_has_the_signature_as_data() -> None:
    document = answer("show", "position_offset")
    seen = document["signature"]
    assert len(seen["time"]) == 376
    assert seen["outputs"]["position"]["difference"] == pytest.approx([1.0] * 376)
    assert seen["outputs"]["position"]["unit"] == "mm"
    assert [name for name, output in seen["outputs"].items() if output["changes"]] == ["position"]
    assert document["terms"][0]["latex"] == r"\mathrm{offset}"
    assert "signature" not in answer("show", "position_offset", "--no-picture")


def test_the_signature_of_base_physics_is_the_change_from_removing_it() -> None:
    text = said("effects", "show", "spool_lag")
    assert "removed by spool_time = 0.001 (SI)" in text
    assert "position: largest +7." in text


def test_an_effect_that_requires_another_is_shown_with_it() -> None:
    assert "Alone it has no influence on any reading" in said("effects", "show", "barus")
    assert "position: largest -" in said("effects", "show", "barus", "--with", "piston_leakage")


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_the_picture_can_be_written_as_png_or_svg(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"leak.{ending}"
    assert f"Wrote {file.as_posix()}" in said("effects", "show", "piston_leakage", "--figure", str(file))
    content = file.read_bytes()
    assert content.startswith(b"\x89PNG") if ending == "png" else b"<svg " in content[:1000]


def test_the_family_of_an_effect_name_can_be_chosen() -> None:
    assert answer("show", "heater_lag", "--no-picture")["family"] == "hydraulic_cylinder"
    assert answer("show", "heater_lag", "--no-picture", "-f", "heater_board")["family"] == "heater_board"
    assert answer("show", "radiation", "--no-picture")["family"] == "heater_board"


def test_the_check_finds_the_shipped_example_sound() -> None:
    text = said("effects", "check", EXAMPLE, "--rig", "rigs/hl32-bench.yaml")
    assert "piston_leakage_eccentric (hydraulic_cylinder, process) is sound" in text
    assert re.search(r"changes position by up to 0\.\d+ mm, \d+(\.\d+)? times the noise", text)
    assert "warning" not in text
    document = answer("check", EXAMPLE)
    assert document["sound"] is True
    assert document["indistinguishable"] == ["piston_leakage"]
    assert document["alike"][0]["effect"] == "piston_leakage"
    assert document["warnings"] == []
    assert document["signature"]["outputs"]["pressure_a"]["changes"] is True


def test_an_effect_without_influence_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "blind.yaml"
    file.write_text(
        "effect: blind\nsummary: A reading that the bench does not have.\nslot: pressure_a_reading\n"
        "term: error\nparameters: {error: {null_value: 0 bar, start: 1 bar, bounds: [-9 bar, 9 bar]}}\n",
        encoding="utf-8",
    )
    text = said("effects", "check", str(file), "--rig", "rigs/hl32-bench.yaml")
    assert "warning: by itself blind has no influence on anything that rig 'HL32 bench' reads" in text
    assert answer("check", str(file))["signature"]["silent"] is False


def test_a_term_undefined_on_the_record_is_reported_with_its_place(tmp_path: Path) -> None:
    file = tmp_path / "root.yaml"
    file.write_text(
        "effect: root\nsummary: A root.\nslot: friction\nterm: size*sqrt((0.05 m/s + velocity)/(1 m/s))\n"
        "parameters: {size: {null_value: 0 N, start: 1 N, bounds: [0 N, 9 N]}}\n",
        encoding="utf-8",
    )
    with pytest.raises(RigctlError, match=r"root\.yaml:4:7: the term has no value at velocity = -0\."):
        said("effects", "check", str(file))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "piston_leek"], "did you mean 'piston_leakage'"),
        (["show", "piston_leakage", "-f", "heater_board"], "unknown effect"),
        (["show", "piston_leakage", "--figure", "x.pdf"], r"expected a name ending in \.png or \.svg"),
        (["show", "piston_leakage", "--with", "barrus"], "did you mean 'barus'"),
        (["show", EXAMPLE, "--with", "piston_leakage"], "contradict one another"),
        (["show", "radiation", "--rig", "rigs/hl32-bench.yaml", "-f", "heater_board"], "another family"),
        (["check", "nowhere.yaml"], "nowhere.yaml"),
        (["list", "-f", "heater_bord"], "did you mean 'heater_board'"),
    ],
)
def test_mistakes_are_reported_with_clear_messages(arguments: list[str], message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        said("effects", *arguments)


def test_the_schema_describes_the_shipped_example() -> None:
    from jsonschema import Draft202012Validator

    from rigctl.files.shipped import shipped
    from rigctl.files.yaml import read_document

    schema = json.loads(said("schema", "effect"))
    Draft202012Validator.check_schema(schema)
    document = read_document(shipped(EXAMPLE)).data
    Draft202012Validator(schema).validate(document)
    assert list(Draft202012Validator(schema).iter_errors({**document, "slott": "friction"}))


# the how-to page: every file that it shows is written, every command that it shows is run

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    registry.installed_effects.cache_clear()
    yield tmp_path
    sys.modules.pop("my_effects", None)
    monkeypatch.undo()
    registry.installed_effects.cache_clear()


def test_the_commands_of_the_how_to_page_print_what_it_shows(workplace: Path) -> None:
    blocks = _BLOCK.findall(HOW_TO.read_text(encoding="utf-8"))
    assert [kind for kind, _ in blocks].count("console") == 8
    for kind, text in blocks:
        if kind == "console":
            command, expected = text.split("\n", 1)
            follow(command, expected)
        else:
            name = text.split("\n", 1)[0].removeprefix("# ")
            (workplace / name).write_text(text, encoding="utf-8")
            if name == "pyproject.toml":
                install(workplace, tomllib.loads(text))
    assert (workplace / "cold-seal.svg").exists()
    assert len(list((workplace / "runs").glob("*/samples.parquet"))) == 2


def follow(command: str, expected: str) -> None:
    """Give a command; its output must have the lines of the page, with anything where the page has '…'."""
    prompt, program, *arguments = shlex.split(command)
    assert (prompt, program) == ("$", "rigctl")
    try:
        found = said(*arguments)
    except RigctlError as error:
        found = f"rigctl: {error}\n"
    lines = [" ".join(line.split()) for line in found.splitlines()]
    wanted = [" ".join(line.split()) for line in expected.splitlines()]
    pattern = "\n".join(r"[\s\S]*?" if line == "…" else re.escape(line).replace("…", ".*") for line in wanted)
    assert re.fullmatch(pattern, "\n".join(lines).strip()), f"{command}\n{found}"


def install(folder: Path, project: dict[str, Any]) -> None:
    """What an installer leaves behind of a project: its name and entry points."""
    name, version = project["project"]["name"], project["project"]["version"]
    metadata = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8"
    )
    points = project["project"]["entry-points"]["rigctl.effects"]
    text = "\n".join(f"{key} = {target}" for key, target in points.items())
    (metadata / "entry_points.txt").write_text(f"[rigctl.effects]\n{text}\n", encoding="utf-8")
    registry.installed_effects.cache_clear()
