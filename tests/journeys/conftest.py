"""Fixtures of the journeys: each module makes a separate project, its `bench`."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module", autouse=True)
def as_on_one_computer(shared_results: Path) -> None:
    """Journeys on the same data reuse each other's fits, as a user's commands do."""


@pytest.fixture
def inside(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working folder is the module's project."""
    monkeypatch.chdir(bench)
