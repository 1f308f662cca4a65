"""What the tests of a design share: each module makes a project of its own, its `bench`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.design import design, rivals, search


@pytest.fixture(scope="module", autouse=True)
def as_on_one_computer(shared_results: Path) -> None:
    """What one test has fitted, another one on the same data finds again, as a user's commands do."""


@pytest.fixture(scope="module", autouse=True)
def small_search() -> Iterator[None]:
    """Fewer rivals, candidates, values of each free number and draws: the same design, in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "CANDIDATES", 12)
        patch.setattr(search, "SWEEPS", 1)
        patch.setattr(search, "VALUES", 2)
        patch.setattr(rivals, "MOST_RIVALS", 3)
        patch.setattr(design, "DRAWS", 20)
        yield


@pytest.fixture
def inside(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working folder is the module's project."""
    monkeypatch.chdir(bench)
