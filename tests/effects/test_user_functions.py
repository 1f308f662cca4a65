"""Effects from Python: declared by a decorator, registered by an entry point, examined before use."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigctl.effects import EffectParameter, find_effect, library, registry
from rigctl.effects.declaration import Own
from rigctl.effects.examine import examine
from rigctl.effects.option import read_effect_option
from rigctl.effects.user import effect
from rigctl.errors import RigctlError
from rigctl.model import Model, build_system
from rigctl.physics.families import find_family
from rigctl.physics.scope import Scope

FAMILY = find_family("hydraulic_cylinder")
SIZE = EffectParameter("size", "N", 0.0, 50.0, 0.0, 500.0, "F")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Installs a package with the given source, whose entry point registers its `EFFECTS`."""

    def install(source: str, attribute: str = "EFFECTS") -> None:
        (tmp_path / "their_effects.py").write_text(source, encoding="utf-8")
        metadata = tmp_path / "their_effects-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: their-effects\nVersion: 1.0\n", encoding="utf-8"
        )
        (metadata / "entry_points.txt").write_text(
            f"[rigctl.effects]\ntheirs = their_effects:{attribute}\n", encoding="utf-8"
        )
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.delitem(sys.modules, "their_effects", raising=False)
        registry.installed_effects.cache_clear()

    yield install
    monkeypatch.undo()
    registry.installed_effects.cache_clear()


HEADER = """
from rigctl.effects import EffectParameter
from rigctl.effects.user import effect

SIZE = EffectParameter("size", "N", 0.0, 50.0, 0.0, 500.0, "F")
"""

DRAG = (
    HEADER
    + '''
@effect("friction", [SIZE], equation="F*v/(1 m/s)", source="a test")
def drag(m, p):
    """A force in proportion to the speed.

    More about it.
    """
    return p.size * m.velocity / m.constant(1.0, "m/s")

EFFECTS = [drag]
'''
)


def test_a_function_becomes_an_effect() -> None:
    @effect("friction", [SIZE], equation="F·v", needs="motion", confused_with=["viscous_friction"])
    def drag(m: Scope, p: Own) -> Any:
        """A force in proportion to the speed."""
        return p.size * m.velocity / m.constant(1.0, "m/s")

    assert (drag.name, drag.slots, drag.kind) == ("drag", ("friction",), "process")
    assert drag.summary == "A force in proportion to the speed."
    assert examine(drag, FAMILY) == ()
    system = build_system(FAMILY, {"drag": {"size": 60.0}}, own_effects=[drag])
    assert system.nominal[system.parameter_names.index("drag.size")] == 60.0


def test_a_sensor_slot_makes_a_sensor_effect() -> None:
    size = EffectParameter("size", "mm", 0.0, 1e-3, 0.0, 1e-2, "c")
    assert effect("position_reading", [size], equation="c")(lambda m, p: p.size).kind == "sensor"


def test_an_unknown_slot_is_refused_by_the_decorator() -> None:
    with pytest.raises(RigctlError, match="did you mean 'friction'"):
        effect("fricton", [SIZE], equation="F")


def test_a_registered_function_is_an_effect_like_any_other(installed: Any) -> None:
    installed(DRAG)
    assert "drag" in library("hydraulic_cylinder")
    assert find_effect("drag", "hydraulic_cylinder").source == "a test"
    effect, values = read_effect_option("drag:size=80 N")
    assert (effect.name, values) == ("drag", {"size": 80.0})
    model = Model(FAMILY).with_effect("drag", {"size": 80.0})
    assert model.values["drag.size"] == 80.0
    assert model.own_effects == ()
    assert "drag.size" in model.system().parameter_names
    assert "drag.size" in Model(FAMILY).system(library=True).parameter_names


def test_a_single_effect_can_be_registered(installed: Any) -> None:
    installed(DRAG, "drag")
    assert "drag" in library("hydraulic_cylinder")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return p.size * m.velocity", "the term at friction has the dimension"),
        ("return p.size if m.velocity > 0 else -p.size", "may not branch.*smooth"),
        ("return p.size + m.constant(1.0, 'N')", "does not switch the term off"),
        ("return p.sice", "unknown variable"),
        ("return None", "not part of an equation"),
        ("return {}['x']", "the term fails: KeyError"),
        ("return m.constant(1.0, 'N')", "no term uses this parameter"),
    ],
)
def test_a_wrong_function_is_refused_with_its_reason(installed: Any, body: str, message: str) -> None:
    installed(
        HEADER
        + f'@effect("friction", [SIZE], equation="?")\ndef wrong(m, p):\n    {body}\n\nEFFECTS = [wrong]\n'
    )
    with pytest.raises(RigctlError, match=message):
        library("hydraulic_cylinder")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("EFFECTS = 3\n", "is no effect"),
        ("raise ValueError('no')\n", "cannot be loaded: no"),
        ("import nothing_of_this_name\n", "cannot be loaded"),
        (
            DRAG.replace("def drag", "def coulomb_friction").replace("[drag]", "[coulomb_friction]"),
            "same name",
        ),
    ],
)
def test_an_invalid_entry_point_is_refused(installed: Any, source: str, message: str) -> None:
    installed(source)
    with pytest.raises(RigctlError, match=message):
        library("hydraulic_cylinder")


IN_YAML = """
effect: {name}
summary: A constant force.
slot: friction
term: force*tanh(velocity/(1 mm/s))
parameters: {{force: {{null_value: 0 N, start: 50 N, bounds: [0 N, 500 N]}}}}
confused_with: [{other}, coulomb_friction]
"""


def test_a_package_registers_a_folder_of_files_that_name_each_other(installed: Any, tmp_path: Path) -> None:
    folder = tmp_path / "their_files"
    folder.mkdir()
    for name, other in (("upper_seal", "lower_seal"), ("lower_seal", "upper_seal")):
        (folder / f"{name}.yaml").write_text(IN_YAML.format(name=name, other=other), encoding="utf-8")
    installed("from pathlib import Path\nEFFECTS = Path(__file__).parent / 'their_files'\n")
    known = library("hydraulic_cylinder")
    assert known["upper_seal"].confused_with == ("lower_seal", "coulomb_friction")
    assert "lower_seal" in known


def test_a_package_may_load_its_files_itself(installed: Any, tmp_path: Path) -> None:
    (tmp_path / "seal.yaml").write_text(
        IN_YAML.format(name="seal", other="stribeck_friction"), encoding="utf-8"
    )
    installed(
        "from pathlib import Path\nfrom rigctl.effects.user import load_effect\n"
        "EFFECTS = [load_effect(Path(__file__).parent / 'seal.yaml')]\n"
    )
    assert "seal" in library("hydraulic_cylinder")


def test_a_folder_without_effects_is_refused(installed: Any) -> None:
    installed("from pathlib import Path\nEFFECTS = Path(__file__).parent / 'their_effects-1.0.dist-info'\n")
    with pytest.raises(RigctlError, match="has no effect files"):
        library("hydraulic_cylinder")
