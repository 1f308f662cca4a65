"""The documentation is correct: valid links, current generated pages, commands that print what is shown."""

from __future__ import annotations

import json
import re
import runpy
import sys
from pathlib import Path

import pytest

import rigctl
from doc_page import PageRun, blocks, steps
from rigctl.cli.commands.init import create_project
from rigctl.dataset import annotate
from systems import needs_compiler, needs_windows_itself

pytestmark = pytest.mark.usefixtures("shared_results")

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
#: pages whose links alone are followed
FOR_CONTRIBUTORS = [ROOT / "CONTRIBUTING.md", ROOT / "rigctl-validation" / "README.md"]
#: followed by tests/cli/test_effects.py, which also installs the package that the page shows
_ELSEWHERE = "write-an-effect.md"
#: needs the emulated board
_ON_LINUX = "first-run-on-hardware.md"
#: what some pages need
_NEEDS = {
    "use-a-model-in-another-simulator.md": needs_compiler,
    "use-an-fmu-as-a-model.md": needs_compiler,
    "use-a-python-driver.md": needs_windows_itself(
        "CM_MapCrToWin32Err, for which PyMeasure looks when it is imported,"
    ),
}
CARRIED_OUT = [
    path
    for path in PAGES
    if path.name not in (_ELSEWHERE, "README.md", *(() if sys.platform == "linux" else (_ON_LINUX,)))
    and re.search(r"^```(console|pycon)$", path.read_text(encoding="utf-8"), re.MULTILINE)
]
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def anchors(path: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = _HEADING.findall(path.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", [*PAGES, *FOR_CONTRIBUTORS], ids=named)
def test_links_are_valid(page: Path) -> None:
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for link in _LINK.findall(prose):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{named(page)} links to {link}"
        assert not anchor or anchor in anchors(target), f"{named(page)} links to {link}: no such heading"


def test_every_page_is_reachable_from_the_start_page() -> None:
    start = ROOT / "docs" / "README.md"
    listed = {(start.parent / link).resolve() for link in _LINK.findall(start.read_text(encoding="utf-8"))}
    pages = {path for path in PAGES if path.parent.name in ("tutorial", "how-to", "reference", "explanation")}
    assert pages <= listed


def test_generated_pages_are_current() -> None:
    pages = runpy.run_path(str(ROOT / "tools" / "generate_docs.py"))["pages"]
    stale = [
        named(path) for path, text in pages() if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    assert not stale, "'make docs' writes them"


def test_the_dataset_page_names_everything_that_is_in_a_run(tmp_path: Path) -> None:
    run = rigctl.simulate(ROOT / "procedures" / "quick-check.yaml", runs=tmp_path).run
    annotate(run.folder, "a note")
    tables = {name: run.table(name).schema for name in ("samples", "records", "events")}
    own = {*run.layout.channels, *run.layout.commands, "supply", "stroke", "stroke_passed"}
    there = {file.name for file in run.folder.iterdir()} | set(rigctl.open_run(run.folder).info)
    there |= {name for schema in tables.values() for name in schema.names} - own
    there |= {key.decode() for schema in tables.values() for field in schema for key in field.metadata or {}}
    there |= {key.decode() for schema in tables.values() for key in schema.metadata or {}}
    there |= set(run.events["kind"]) | {key for data in run.events["data"] for key in json.loads(data)}
    there |= {key for session in run.info["sessions"] for key in session}
    there |= {key for measure in run.info["measures"] for key in measure}
    page = (ROOT / "docs" / "reference" / "dataset.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`([^`\n]+)`", page))
    assert there <= told, f"dataset.md says nothing of {sorted(there - told)}"


@pytest.mark.parametrize(
    "page",
    [pytest.param(path, marks=_NEEDS.get(path.name, ())) for path in CARRIED_OUT],
    ids=named,
)
def test_the_commands_of_a_page_print_what_the_page_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every command of the page, in order; a page that does not create a project starts in a new one."""
    for name in ("USER", "LOGNAME", "USERNAME", "LNAME"):
        monkeypatch.setenv(name, "ada")
    found = list(blocks(page.read_text(encoding="utf-8")))
    begins = [step.command for block in found if block.kind == "console" for step in steps(block)][:1]
    own = bool(begins) and begins[0].startswith("rigctl init")
    if not own:
        create_project(tmp_path / "my-bench")
    run = PageRun(tmp_path, "." if own else "my-bench")
    for block in found:
        run.carry_out(block)
