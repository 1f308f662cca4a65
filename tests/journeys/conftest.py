"""What the journeys share: each module makes a project of its own, its `bench`."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def inside(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working folder is the module's project."""
    monkeypatch.chdir(bench)
