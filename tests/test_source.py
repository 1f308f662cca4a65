"""Rules for the source that no linter checks."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from rigctl.effects import library

SOURCE = Path(__file__).parents[1] / "src" / "rigctl"
VALIDATION = SOURCE.parents[1] / "rigctl-validation" / "src"


def bare_nexts(text: str) -> list[int]:
    """Lines with a `next` without a default on an iterator that may be empty: a search, or a collection.

    In other iterators its StopIteration ends them silently; elsewhere it is a traceback without a message.
    """
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "next":
            (first, *default) = node.args
            fresh = isinstance(first, ast.GeneratorExp | ast.Call)
            if fresh and not default:
                found.append(node.lineno)
    return found


def test_next_without_a_default_is_found() -> None:
    assert bare_nexts("next(x for x in y)\nnext(iter(y))\nnext((x for x in y), 0)\nnext(counter)") == [1, 2]


def test_no_search_in_the_source_can_end_in_stop_iteration() -> None:
    files = [path for folder in (SOURCE, VALIDATION) for path in folder.rglob("*.py")]
    found = {str(path): bare_nexts(path.read_text("utf-8")) for path in files}
    assert {name: lines for name, lines in found.items() if lines} == {}


WHERE = re.compile(r"^\| .+ \| `([\w/]+\.py)` \| `(\w+)` \|$", re.MULTILINE)


def defined(path: Path) -> set[str]:
    """The names that a module itself defines at its top."""
    names: set[str] = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    return names


@pytest.mark.skipif(os.name == "nt" and shutil.which("git") is None, reason="Git is not installed there")
def test_no_file_of_the_source_is_left_out_of_the_repository() -> None:
    """Templates in a new folder were ignored like written pages, and no page could be made."""
    built = ("__pycache__", "shipped")
    files = [path for path in SOURCE.rglob("*") if path.is_file() and not {*built} & {*path.parts}]
    asked = "\n".join(path.relative_to(SOURCE.parents[1]).as_posix() for path in files)
    ignored = subprocess.run(
        ["git", "check-ignore", "--no-index", "--stdin"],
        input=asked,
        cwd=SOURCE.parents[1],
        text=True,
        capture_output=True,
        check=False,
    )
    assert ignored.stdout == ""


def test_the_contributing_guide_names_existing_places() -> None:
    page = (SOURCE.parents[1] / "CONTRIBUTING.md").read_text("utf-8")
    rows = WHERE.findall(page)
    assert len(rows) >= 20
    assert len(rows) == page.partition("## Where do I change")[2].count("\n| ") - 1
    missing = [f"{file}: {name}" for file, name in rows if name not in defined(SOURCE / file)]
    assert missing == []


def test_the_journeys_of_the_contributing_guide_pass_existing_files() -> None:
    page = (SOURCE.parents[1] / "CONTRIBUTING.md").read_text("utf-8")
    journeys = page.partition("**A sample, from the wire")[2].partition("\n## ")[0]
    named = re.findall(r"`([\w/]+\.py|\w+/\w+)`", journeys)
    assert len(named) > 30
    places = (SOURCE, SOURCE / "analysis")  # the second journey is there for the most part
    assert [name for name in named if not any((place / name).exists() for place in places)] == []


def test_every_package_is_in_the_contributing_guide() -> None:
    page = (SOURCE.parents[1] / "CONTRIBUTING.md").read_text("utf-8")
    listed = set(re.findall(r"`(\w+)`", page.partition("| package | holds |")[2].partition("## Habits")[0]))
    packages = {path.parent.name for path in SOURCE.glob("*/__init__.py")}
    assert packages <= listed, f"CONTRIBUTING.md has no row for {sorted(packages - listed)}"


def test_the_contributing_guide_lists_the_packages_from_the_ground_up() -> None:
    """In the order of the layers that the import contract declares."""
    contracts = tomllib.loads((SOURCE.parents[1] / "pyproject.toml").read_text("utf-8"))["tool"][
        "importlinter"
    ]
    (layers,) = (one["layers"] for one in contracts["contracts"] if one.get("containers") == ["rigctl"])
    floors = {
        name.strip(): floor for floor, names in enumerate(reversed(layers)) for name in names.split("|")
    }
    page = (SOURCE.parents[1] / "CONTRIBUTING.md").read_text("utf-8")
    table = page.partition("| package | holds |")[2].partition("## Habits")[0]
    listed = [re.findall(r"`(\w+)`", line.split("|")[1]) for line in table.splitlines() if "| `" in line]
    assert set(floors) <= {name for names in listed for name in names}
    lowest = [min(floors[name] for name in names) for names in listed]
    assert lowest == sorted(lowest)


def test_the_glossary_names_existing_files() -> None:
    page = (SOURCE.parents[1] / "docs" / "reference" / "glossary.md").read_text("utf-8")
    named = re.findall(r"`([\w/]+(?:\.py|/))`", page)
    assert len(named) > 30
    assert [name for name in named if not (SOURCE / name).exists()] == []
    effects = re.findall(r"`(\w+_(?:leakage|delay|friction))`", page)
    assert effects
    assert set(effects) <= set(library("hydraulic_cylinder"))
    for table in page.split("| term |")[1:]:
        terms = [line.split("|")[1].strip() for line in table.splitlines() if line.startswith("| ")]
        assert terms == sorted(terms, key=str.casefold), "in alphabetical order"


def test_the_longest_test_files_exist() -> None:
    """A file that is not found under its listed name would start last and prolong the whole run."""
    here = Path(__file__).parent
    body = ast.parse((here / "conftest.py").read_text("utf-8")).body
    (listed,) = [
        ast.literal_eval(node.value)
        for node in body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "LONGEST"
    ]
    assert [name for name in listed if not (here / name).exists()] == []
