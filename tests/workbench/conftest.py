"""A project with four records of a bench that leaks, opened once on the textbook model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from commands import MODEL, told
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.workbench import Workbench

#: records at 20 and 80 degC of the shipped campaign that an independent program made with a leaking valve
RECORDS = {"001", "004", "025", "028"}


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workbench")
    create_project(folder)
    with chdir(folder):
        lines = Path("data/unknown-bench.csv").read_text("utf-8").splitlines(keepends=True)
        kept = [line for line in lines[1:] if line.split(",")[1] in RECORDS]
        Path("few.csv").write_text("".join([lines[0], *kept]), "utf-8")
        told("import", "few.csv", "--rig", "rigs/hl32-bench.yaml", "--assume", "heater=off")
    return folder


@pytest.fixture(autouse=True)
def inside(project: Path) -> Iterator[None]:
    with chdir(project):
        yield


@pytest.fixture(scope="session")
def textbook(project: Path) -> Workbench:
    """The shipped model; tests do not change its state."""
    with chdir(project):
        return Workbench.open([open_run("latest")], Path(MODEL), named=MODEL)
