"""The pictures of the workbench that the documentation shows: ``python tools/workbench_pictures.py``.

Runs the tutorial of the hidden effect in Chromium, on all of its records, and writes screenshots to
``docs/tutorial``, with the page's headings, buttons and labels in each picture: ``tests/web`` runs the same
steps on a few records, and fails if the page has changed. It takes some minutes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[1]
_COLOURS = 96


def main() -> None:
    """Run the tutorial and store its pictures."""
    sys.path.insert(0, str(_ROOT / "tests"))
    from playwright.sync_api import sync_playwright

    from report.browser import SWITCHES, find_chromium
    from rigctl.cli.commands.init import create_project
    from web.serving import Window, serving

    switches = [one for one in SWITCHES if not one.startswith(("--headless", "--remote"))]
    with tempfile.TemporaryDirectory() as place:
        project = Path(place) / "my-bench"
        create_project(project)
        with (
            serving(project, "--port", "0", state=Path(place) / "state") as served,
            sync_playwright() as playwright,
        ):
            browser = playwright.chromium.launch(executable_path=find_chromium(), args=switches)
            context = browser.new_context(viewport={"width": 1280, "height": 860})
            context.set_default_timeout(600_000)
            tutorial(Window(context, served).open("/workbench"))
            browser.close()


def tutorial(page: Any) -> None:
    """The steps of ``docs/tutorial/hidden-effect-in-the-browser.md``."""
    page.get_by_text("Bring in measured data").click()
    page.get_by_label("File").fill("data/unknown-bench.csv")
    page.get_by_label("Bench", exact=True).select_option("rigs/hl32-bench.yaml")
    page.get_by_label("Assume").first.fill("heater=off")
    page.get_by_role("button", name="Import").click()
    page.get_by_role("checkbox").first.wait_for()
    page.get_by_label("Hold out").fill("oil == 60 degC")
    page.get_by_role("button", name="Open", exact=True).click()
    exact = page.locator("[data-exact=yes]")
    exact.wait_for()
    page.locator(".message button").first.click()
    page.get_by_label("flow area, typed").fill("3.33")
    page.keyboard.press("Tab")
    exact.wait_for()
    page.get_by_label("Channel", exact=True).select_option(label="position")
    page.get_by_role("button", name="oil temperature 80 degC, relief valve 50 bar").click()
    page.mouse.move(0, 0)
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(1000)
    keep(page.screenshot(full_page=True), "workbench-by-hand", page.locator(".bench"))
    page.get_by_role("button", name="Undo").click()
    exact.wait_for()
    verbs = page.get_by_role("toolbar", name="Analyses")
    verbs.get_by_role("button", name="Diagnose").click()
    found = page.locator("section.result[data-verb=diagnose]")
    found.wait_for()
    keep(found.screenshot(), "workbench-diagnosis", found)
    page.get_by_role("button", name="Add what is missing").click()
    page.locator('[data-open$="@2"]').wait_for()
    exact.wait_for()
    verbs.get_by_role("button", name="History").click()
    history = page.locator("section.result[data-verb=history]")
    history.wait_for()
    keep(history.screenshot(), "workbench-history", history)
    page.emulate_media(color_scheme="dark")
    page.set_viewport_size({"width": 420, "height": 860})
    page.wait_for_timeout(1000)
    page.get_by_label("flow area, typed").scroll_into_view_if_needed()
    page.wait_for_timeout(1000)
    keep(page.screenshot(), "workbench-on-a-phone", page.locator(".bench"))


def keep(picture: bytes, name: str, place: Any) -> None:
    """Store a small PNG with the text of the page."""
    import json
    from io import BytesIO

    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    from web.pictures import FIELD, FOLDER, outline

    said = PngInfo()
    said.add_text(FIELD, json.dumps(outline(place)))
    drawn = Image.open(BytesIO(picture)).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    drawn.save(FOLDER / f"{name}.png", optimize=True, pnginfo=said)
    print(FOLDER / f"{name}.png", (FOLDER / f"{name}.png").stat().st_size)


if __name__ == "__main__":
    main()
