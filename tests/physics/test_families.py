"""Families by name, file, context and installed package, and when a Python file may run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.families.heater_board.family import FAMILY as HEATER_BOARD
from rigctl.files.shipped import shipped
from rigctl.physics import families
from rigctl.physics.families import FAMILIES, family_names, find_family, is_family_file, using_families
from rigctl.physics.user.program import run_family_file

TANK = "models/families/water-tank.yaml"
#: a Python file that makes a family
PROGRAM = """\
from dataclasses import replace

from rigctl.families.heater_board.family import FAMILY as HEATER_BOARD


def family():
    return replace(HEATER_BOARD, name="their_board")
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Installs a package whose entry point registers `attribute` as the family `name`."""

    def install(source: str, name: str = "their_board", attribute: str = "family") -> None:
        module = f"package_of_{name}"
        (tmp_path / f"{module}.py").write_text(source, encoding="utf-8")
        metadata = tmp_path / f"{module}-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n", "utf-8")
        entry = f"[rigctl.families]\n{name} = {module}:{attribute}\n"
        (metadata / "entry_points.txt").write_text(entry, "utf-8")
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.delitem(sys.modules, module, raising=False)
        families._installed_family.cache_clear()

    return install


def test_a_shipped_family_is_found_by_its_name() -> None:
    assert find_family("heater_board") is HEATER_BOARD
    with pytest.raises(RigctlError, match="did you mean 'heater_board'"):
        find_family("heaterboard")


def test_a_family_path_is_searched_beside_the_file_in_the_project_and_among_the_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert find_family(TANK).name == "water_tank"  # among the shipped
    project = tmp_path / "project"
    (project / "rigs").mkdir(parents=True)
    (project / "rigctl.toml").write_text("", "utf-8")
    text = shipped(*TANK.split("/")).read_text(encoding="utf-8")
    (project / "own.yaml").write_text(text.replace("family: water_tank", "family: of_the_project"), "utf-8")
    rig = project / "rigs" / "bench.yaml"
    assert find_family("own.yaml", rig).name == "of_the_project"
    (project / "rigs" / "own.yaml").write_text(text.replace("family: water_tank", "family: beside"), "utf-8")
    assert find_family("own.yaml", rig).name == "beside"
    monkeypatch.chdir(project)
    assert find_family("own.yaml").name == "of_the_project"
    with pytest.raises(RigctlError, match="there is no such file"):
        find_family("nowhere.yaml", rig)


def test_a_file_may_not_take_the_name_of_a_shipped_family(tmp_path: Path) -> None:
    text = shipped(*TANK.split("/")).read_text(encoding="utf-8")
    path = tmp_path / "taken.yaml"
    path.write_text(text.replace("family: water_tank", "family: oil_viscosity"), "utf-8")
    with pytest.raises(RigctlError, match="there is a model family of this name already"):
        find_family(str(path))


def test_a_given_family_is_known_within_its_context_only() -> None:
    own = replace(HEATER_BOARD, name="own_board")
    with using_families(own):
        assert find_family("own_board") is own
        assert "own_board" in family_names()
        with pytest.raises(RigctlError, match="there is a model family of this name already"):
            using_families(replace(own, title="Another board")).__enter__()
        with using_families(own):  # the very same
            assert find_family("own_board") is own
        assert find_family("own_board") is own
    assert family_names()[: len(FAMILIES)] == tuple(FAMILIES)
    with pytest.raises(RigctlError, match="unknown model family"):
        find_family("own_board")


def test_an_unsound_given_family_is_refused() -> None:
    unsound = replace(HEATER_BOARD, name="unsound", outputs=())
    with pytest.raises(RigctlError, match="the family has no outputs"):
        using_families(unsound).__enter__()


def test_a_python_file_named_by_another_file_is_not_run(tmp_path: Path) -> None:
    (tmp_path / "trap.py").write_text("raise SystemExit('sprung')", "utf-8")
    with pytest.raises(RigctlError, match="a Python file is not run because another file names it"):
        find_family("trap.py", tmp_path / "rig.yaml")
    with pytest.raises(RigctlError, match="a Python file is not run"):
        find_family(str(tmp_path / "trap.py"))
    assert is_family_file("trap.PY")


def test_a_python_file_run_explicitly_gives_a_family(tmp_path: Path) -> None:
    path = tmp_path / "board.py"
    path.write_text(PROGRAM, "utf-8")
    family = run_family_file(path)
    assert family.name == "their_board"
    with using_families(family, path=path):
        assert find_family("board.py", tmp_path / "rig.yaml") is family
        assert find_family("their_board") is family


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\ny = 1/0\n", r"board\.py:2: the file fails: ZeroDivisionError"),
        ("x = 1\nfamily = (\n", r"board\.py:2:\d+: the file fails: SyntaxError"),
        ("import sys\nsys.exit(3)\n", r"board\.py:2: the file fails: SystemExit: 3"),
        ("from rigctl.units import parse_unit\nparse_unit('meter2')\n", r"board\.py:2: unknown unit"),
        ("famly = 1\n", r"board\.py: the file defines no 'family'"),
        ("family = 'tank'\n", r"board\.py: 'family' is no model family, got \"'tank'\""),
        ("def family():\n    raise KeyError('x')\n", r"board\.py: 'family' fails: KeyError: 'x'"),
    ],
)
def test_errors_of_a_python_file_are_reported_with_their_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "board.py"
    path.write_text(text, "utf-8")
    with pytest.raises(RigctlError, match=said):
        run_family_file(path)


def test_a_missing_python_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="there is no such Python file"):
        run_family_file(tmp_path / "nowhere.py")


def test_the_family_of_an_installed_package_is_found_and_loaded_on_demand(
    installed: Callable[..., None],
) -> None:
    installed(PROGRAM)
    assert "their_board" in family_names()
    assert "package_of_their_board" not in sys.modules  # listing loads nothing
    assert find_family("their_board").title == HEATER_BOARD.title


def test_a_broken_package_affects_only_its_own_family(installed: Callable[..., None]) -> None:
    installed("raise RuntimeError('broken')", name="broken_board")
    installed(PROGRAM)
    assert find_family("their_board").name == "their_board"
    with pytest.raises(RigctlError, match="the model family 'broken_board' cannot be loaded: broken"):
        find_family("broken_board")


@pytest.mark.parametrize(
    ("name", "source", "said"),
    [
        ("number", "family = 3", "is no model family, got '3'; expected a ModelFamily"),
        ("misnamed", PROGRAM, "has another name, got 'their_board'; expected misnamed"),
        (
            "unsound",
            PROGRAM.replace('"their_board"', '"unsound", outputs=()'),
            "the model family unsound is not sound: unsound: the family has no outputs",
        ),
    ],
)
def test_an_unsound_family_of_a_package_is_refused(
    installed: Callable[..., None], name: str, source: str, said: str
) -> None:
    installed(source, name=name)
    with pytest.raises(RigctlError, match=said):
        find_family(name)
