"""Every page on wide screens and phones, light and dark, with keyboard and screen reader."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from rigctl.dataset.catalogue import page_of_runs
from web.serving import Served, Window

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

#: the states in which each page is checked, beside its empty one
SETTLED = {
    "runs": "table.runs tbody tr td",
    "live": ".idle .finding",
    "procedure": ".timeline .box",
    "report": "iframe.report, .job",
}


def serious(page: Page) -> list[str]:
    """Serious findings of axe-core; the frame of a report has its own tests."""
    from axe_playwright_python.sync_playwright import Axe  # not on Windows

    found = Axe().run(page, context={"exclude": [["iframe"]]}).response["violations"]
    return [
        f"{one['id']}: {node['html'][:120]} {json.dumps(node['any'][:1])[:200]}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (420, True)], ids=["wide", "phone"])
def test_every_page_is_accessible_and_fits_its_screen(
    browser: Browser, served: Served, width: int, *, dark: bool
) -> None:
    run = page_of_runs(served.project / "runs").runs[-1].id
    scheme = "dark" if dark else "light"
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    context.set_default_timeout(120_000)
    window = Window(context, served)
    page = window.open(f"/runs?run={run}")
    for name, settled in SETTLED.items():
        if name != "runs":
            page.goto(f"{served.base}/{name}")
        page.wait_for_selector("#part[data-ready=yes]")
        page.locator(settled).first.wait_for()
        assert serious(page) == [], name
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{name} is {wide} pixels wide"
    context.close()
    assert window.complaints == []


def test_the_keyboard_reaches_the_content_first(window: Window) -> None:
    page = window.open("/runs")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    page.keyboard.press("Enter")
    assert page.evaluate("location.hash") == "#main"
    links = page.locator("nav[aria-label=Parts] a")
    assert links.all_inner_texts() == ["Runs", "Live", "Workbench", "Procedure", "Report", "Docs"]
    assert page.locator("nav [aria-current=page]").inner_text() == "Runs"


@pytest.mark.parametrize("width", [320, 400, 640, 800])
def test_every_link_of_the_navigation_is_on_the_screen(window: Window, width: int) -> None:
    """At 400 pixels the last one was beyond the right edge, in a row that scrolled without a scroll bar."""
    page = window.open("/runs")
    page.set_viewport_size({"width": width, "height": 800})
    for link in page.locator("nav[aria-label=Parts] a").all():
        box = link.bounding_box()
        assert box is not None
        assert 0.0 <= box["x"] < box["x"] + box["width"] <= width, link.inner_text()
