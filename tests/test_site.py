"""The documentation site, checked by an HTML parser that is independent of its builder."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[1]


class Links(HTMLParser):
    """What a page loads, where it leads, and the anchors that it has."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.leads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag in ("script", "img", "iframe") and "src" in given:
            self.loads.append(given["src"])
        if tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.loads.append(given["href"])
        if tag == "a" and "href" in given:
            self.leads.append(given["href"])


@pytest.fixture(scope="module")
def site(built_site: Path) -> dict[Path, Links]:
    """Every page of the site by its file."""
    return {path: Links(path) for path in built_site.rglob("*.html") if path.name != "404.html"}


def test_every_page_of_the_documentation_is_on_the_site_and_reachable(site: dict[Path, Links]) -> None:
    folder = min((path.parent for path in site), key=lambda path: len(path.parts))
    pages = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    pages = {page.with_name("index.html") if page.name == "README.html" else page for page in pages}
    assert pages <= {path.relative_to(folder) for path in site}
    seen, left = set(), [folder / "index.html"]
    while left:
        page = left.pop()
        if page not in seen:
            seen.add(page)
            left += [path for link in site[page].leads if (path := led(page, link)[0]) in site]
    assert seen == set(site)


def test_pages_load_only_files_of_the_site(site: dict[Path, Links]) -> None:
    loaded = {(page, link) for page, found in site.items() for link in found.loads}
    assert loaded
    assert {(page, link) for page, link in loaded if not led(page, link)[0].is_file()} == set()


def test_links_lead_to_existing_pages_and_anchors(site: dict[Path, Links]) -> None:
    for page, found in site.items():
        for link in found.leads:
            if re.match(r"[a-z]+:", link):
                continue
            target, anchor = led(page, link)
            assert target.is_file(), f"{page.name} leads to {link}"
            there = site[target].anchors if target in site else {anchor}
            assert not anchor or anchor in there, f"{page.name} leads to {link}"


def led(page: Path, link: str) -> tuple[Path, str]:
    """The file and the anchor that a relative link leads to."""
    file, _, anchor = link.partition("#")
    target = (page.parent / unquote(file)).resolve() if file else page
    return (target / "index.html" if target.is_dir() else target), unquote(anchor)
