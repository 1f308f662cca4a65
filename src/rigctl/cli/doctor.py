"""`rigctl doctor`: what is installed, what is missing, and how to get it."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal

import typer


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at: `fix` says what to type when it is not well."""

    subject: str
    state: Literal["ok", "optional", "broken"]
    detail: str
    fix: str = ""


#: import name, extra, what it is for
_EXTRAS = (
    ("nptdms", "tdms", "reads and writes LabVIEW's TDMS files"),
    ("asammdf", "mdf", "reads and writes MDF4 files"),
    ("distributed", "cluster", "spreads fits over several machines"),
)


def examine() -> Iterator[Finding]:
    """Look at everything rigctl stands on, cheapest first."""
    yield _interpreter()
    yield from _packages()
    yield from _extras()
    yield _engine_cache()
    yield _project()


def _interpreter() -> Finding:
    return Finding("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")


def _packages() -> Iterator[Finding]:
    """Every package that rigctl requires, as its own metadata lists them."""
    for requirement in requires("rigctl") or ():
        if "extra ==" in requirement:
            continue
        name = requirement.partition(">")[0].partition("<")[0].strip()
        try:
            yield Finding(name, "ok", version(name))
        except PackageNotFoundError:
            yield Finding(name, "broken", "not installed", f"pip install '{requirement}'")


def _extras() -> Iterator[Finding]:
    for module, extra, purpose in _EXTRAS:
        if find_spec(module):
            yield Finding(f"{extra} (extra)", "ok", purpose)
        else:
            yield Finding(f"{extra} (extra)", "optional", purpose, f"pip install 'rigctl[{extra}]'")


def _engine_cache() -> Finding:
    """The folder that keeps compiled models; without it every start compiles again."""
    from rigctl.engine.cache import cache_root

    folder = cache_root()
    if _writable(folder):
        return Finding("compiled models", "ok", str(folder))
    return Finding("compiled models", "broken", f"cannot write {folder}", "make the folder writable")


def _project() -> Finding:
    from rigctl.project import find_project

    project = find_project()
    if not _writable(project.runs):
        return Finding("runs folder", "broken", f"cannot write {project.runs}", "make the folder writable")
    return Finding("runs folder", "ok", str(project.runs))


def _writable(folder: Path) -> bool:
    """Whether a file can be made in `folder`, or in the nearest folder above that exists."""
    import tempfile

    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")] = False,
) -> None:
    """Say what is installed, what is missing, and how to get it.

    Example: rigctl doctor
    """
    findings = list(examine())
    broken = any(finding.state == "broken" for finding in findings)
    if as_json:
        typer.echo(json.dumps({"healthy": not broken, "findings": [asdict(f) for f in findings]}, indent=1))
    else:
        _show(findings)
    raise typer.Exit(1 if broken else 0)


def _show(findings: list[Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False)
    marks = {"ok": "[green]✓[/]", "optional": "[dim]–[/]", "broken": "[red]✗[/]"}
    for finding in findings:
        fix = f"[bold]{escape(finding.fix)}[/]" if finding.fix else ""
        table.add_row(marks[finding.state], finding.subject, escape(finding.detail), fix)
    Console(highlight=False).print(table)
