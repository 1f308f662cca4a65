"""A browser for the session, and runs to report on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from report.browser import Browser
from report.made_campaign import Campaign, make_campaign
from rigctl.dataset import Run, open_run
from rigctl.report.run_data import RunData, read_run

RunMaker = Callable[..., Run]


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """The browser; fails with instructions where no Chromium is installed."""
    if sys.platform == "win32":
        pytest.skip("drives a browser over inherited pipes, which Windows has not")
    with Browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def make_run(tmp_path: Path) -> RunMaker:
    def make(**facts: object) -> Run:
        return open_run(make_campaign(tmp_path / "runs", Campaign(**facts)))  # type: ignore[arg-type]

    return make


@pytest.fixture(scope="session")
def published(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The whole campaign: 28 records and 65 100 samples."""
    return open_run(make_campaign(tmp_path_factory.mktemp("published"), Campaign(idle_rows=1950)))


@pytest.fixture(scope="session")
def published_data(published: Run) -> RunData:
    return read_run(published)
