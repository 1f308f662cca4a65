"""The first page of a project without runs has the first steps of README; a click opens the workbench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.commands.init import create_project
from web.serving import Window, serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_the_first_page_tells_the_story_of_readme_and_opens_it(
    browser: Browser, tmp_path: Path, shared_results: Path
) -> None:
    project = tmp_path / "bench"
    create_project(project)
    with serving(project, "--port", "0", state=tmp_path / "state") as served:
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        context.set_default_timeout(240_000)
        window = Window(context, served)
        page = window.open("/")
        steps = page.get_by_role("region", name="First steps")
        steps.wait_for()
        shown = [text.removeprefix("$ ") for text in steps.locator("code").all_inner_texts()]
        assert len(shown) == 3
        assert all(f"$ {line}" in README for line in shown)
        steps.get_by_role("button", name="Bring in the published strokes").click()
        page.wait_for_url("**/workbench")
        page.locator("[data-open^='models/hl32-textbook.yaml']").wait_for()  # the newest run and its model
        page.goto(f"{served.base}/")
        page.get_by_text("hl32-strokes").first.wait_for()
        assert page.get_by_role("region", name="First steps").count() == 0
        context.close()
        assert window.complaints == []
