"""One server over one small project, and one browser, for all tests of the page."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from commands import create_strokes
from report.browser import SWITCHES, find_chromium
from web.serving import Served, Window, serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A project with one small campaign, served."""
    project = create_strokes(tmp_path_factory.mktemp("served") / "strokes-of-may", "30 degC", seed=7)
    with serving(project, "--port", "0", state=tmp_path_factory.mktemp("state")) as found:
        yield found


@pytest.fixture(scope="session")
def cookie(served: Served) -> str:
    return served.enter()


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """The system's Chromium, once for all tests."""
    if sys.platform == "win32":
        pytest.skip("drives a browser, and Wine has none")
    from playwright.sync_api import sync_playwright

    switches = [one for one in SWITCHES if not one.startswith(("--headless", "--remote"))]
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=find_chromium(), args=switches)
        yield chromium
        chromium.close()


@pytest.fixture
def window(browser: Browser, served: Served) -> Iterator[Window]:
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    context.set_default_timeout(120_000)
    found = Window(context, served)
    yield found
    context.close()
    assert found.complaints == []
