"""Fixtures of the design tests; each module makes its own project, `bench`."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module", autouse=True)
def as_on_one_computer(shared_results: Path) -> None:
    """Fits are cached between the tests of a module, as between a user's commands."""


@pytest.fixture(scope="module", autouse=True)
def quick(small_search: None) -> None:
    """Every design of these tests is a small one."""


@pytest.fixture
def inside(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working folder is the module's project."""
    monkeypatch.chdir(bench)
