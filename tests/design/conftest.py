"""What the tests of a design share: each module makes a project of its own, its `bench`."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module", autouse=True)
def as_on_one_computer(shared_results: Path) -> None:
    """What one test has fitted, another one on the same data finds again, as a user's commands do."""


@pytest.fixture(scope="module", autouse=True)
def quick(small_search: None) -> None:
    """Every design of these tests is a small one."""


@pytest.fixture
def inside(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working folder is the module's project."""
    monkeypatch.chdir(bench)
