"""Runs to test with; see `run_workshop`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from run_workshop import Done, Workshop


@pytest.fixture
def workshop(tmp_path: Path) -> Workshop:
    return Workshop(tmp_path)


@pytest.fixture
def do(workshop: Workshop) -> Callable[..., Done]:
    return workshop.run
