"""The documentation site on the server: it can be read and searched, and no other file is served."""

from __future__ import annotations

from pathlib import Path

import pytest

from web.serving import Served, Window

ROOT = Path(__file__).parents[2]


pytestmark = pytest.mark.usefixtures("built_site")


def test_a_page_is_found_by_full_text_search_and_opened(window: Window) -> None:
    page = window.open("/docs")
    site = page.frame_locator("iframe.docs")
    site.locator("h1", has_text="Documentation").wait_for()
    site.get_by_role("textbox", name="Search").fill("hysteresis of the valve")
    found = site.locator(".md-search-result__link").first
    found.wait_for()
    found.click()
    # the results have headings as well, and the first page stays until the next has come
    site.locator(".md-content h1", has_not_text="Documentation").first.wait_for()
    frame = next(one for one in page.frames if "/docs/" in one.url)
    assert frame.url.startswith(f"{window.served.base}/docs/")
    assert not frame.url.endswith("index.html")


@pytest.mark.parametrize(
    "path", ["../mkdocs.yml", "..%2f..%2fpyproject.toml", "%2fetc/passwd", "nothing.html", "%00", ""]
)
def test_only_the_site_is_served(path: str, served: Served, cookie: str) -> None:
    status, _, text = served.ask("GET", f"/docs/{path}", cookie=cookie)
    assert (status, "<title>" in text) == ((200, True) if path == "" else (status, False))
    assert status in ((200,) if path == "" else (400, 404))


def test_the_documentation_requires_authentication(served: Served) -> None:
    assert served.ask("GET", "/docs/index.html")[0] == 401
