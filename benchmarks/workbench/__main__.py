"""From a slider to its curves: ``python -m benchmarks.workbench [--records 28]``.

Serves a project with some strokes, opens the textbook model on them in Chromium, and drags sliders. A time is
from the slider's event to the frame in which everything has been drawn: curves, residuals, errors and map.
The sliders are a parameter of the model, and the size of an effect that was switched on, which needs the
equations of the whole library. ``exact_s`` is the time of the following fit of the record-level unknowns.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from contextlib import chdir
from pathlib import Path
from typing import Any

from benchmarks.record import keep, table

_TESTS = Path(__file__).parents[2] / "tests"
#: events of one drag, 16 ms apart as from a mouse
_EVENTS = 120
_LISTEN = """() => {
  window.drawn = [];
  document.addEventListener("workbench-drawn", ({ detail }) => {
    const { sent, exact, records, server } = detail;
    if (sent) window.drawn.push([performance.now() - sent, exact, records, 1000 * server]);
  });
}"""
_NEXT = "new Promise((done) => document.addEventListener('workbench-drawn', done, { once: true }))"
_DRAG = """async ([label, events]) => {
  const boxes = [...document.querySelectorAll(".slider")].filter((one) => !one.closest("[hidden]"));
  const box = boxes.find((one) => one.textContent.startsWith(label));
  const range = box.querySelector("input[type=range]");
  window.drawn = [];
  for (let k = 0; k < events; k++) {
    range.value = 400 + (k % 60) * 3;
    range.dispatchEvent(new Event("input"));
    await new Promise((done) => setTimeout(done, 16));
  }
  range.dispatchEvent(new Event("change"));
}"""


def project(folder: Path, records: int) -> None:
    """A project with the first strokes of the shipped campaign as a run."""
    from rigctl.cli.commands.init import create_project
    from rigctl.dataset.assumptions import read_assumptions
    from rigctl.dataset.importing import import_files
    from rigctl.dataset.importing.options import Options
    from rigctl.rig import load_rig

    create_project(folder)
    with chdir(folder):
        lines = Path("data/unknown-bench.csv").read_text("utf-8").splitlines(keepends=True)
        kept = [line for line in lines[1:] if int(line.split(",")[1]) <= records]
        Path("strokes.csv").write_text("".join([lines[0], *kept]), "utf-8")
        options = Options(assume=read_assumptions(["heater=off"]))
        import_files([Path("strokes.csv")], load_rig(Path("rigs/hl32-bench.yaml")), Path("runs"), options)


def dragged(page: Any, label: str) -> dict[str, float]:
    """ms from an event to its frame, and the part of the simulation."""
    page.evaluate(_DRAG, [label, _EVENTS])
    page.locator("[data-exact=yes]").wait_for()
    drawn = [one for one in page.evaluate("window.drawn") if not one[1]]
    times = sorted(one[0] for one in drawn)
    return {
        "frames": len(times),
        "median_ms": statistics.median(times),
        "of_ten_nine_below_ms": times[int(0.9 * len(times))],
        "largest_ms": times[-1],
        "simulated_ms": statistics.median(one[3] for one in drawn),
        "records": statistics.median(one[2] for one in drawn),
    }


def measure(folder: Path, records: int) -> dict[str, Any]:
    """All figures of one session in a browser."""
    from playwright.sync_api import sync_playwright

    from report.browser import SWITCHES, find_chromium
    from web.serving import Window, serving

    switches = [one for one in SWITCHES if not one.startswith(("--headless", "--remote"))]
    with (
        serving(folder, "--port", "0", state=folder.parent / "state") as served,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=switches)
        context = browser.new_context(viewport={"width": 1400, "height": 900})
        context.set_default_timeout(120_000)
        page = Window(context, served).open("/workbench")
        begun = time.perf_counter()
        page.get_by_role("button", name="Open", exact=True).click()
        page.locator("[data-exact=yes]").wait_for()
        opened = time.perf_counter() - begun
        page.evaluate(_LISTEN)
        found = {"open_s": opened, "parameter": dragged(page, "flow area")}
        page.evaluate("window.drawn = []")
        page.get_by_role("switch", name="valve leakage").check()
        page.evaluate(
            "new Promise((done) => document.addEventListener('workbench-drawn', done, { once: true }))"
        )
        found["switch_ms"] = page.evaluate("window.drawn[0][0]")
        begun = time.perf_counter()
        page.locator("[data-exact=yes]").wait_for()
        found["exact_s"] = time.perf_counter() - begun
        found["effect"] = dragged(page, "conductance")
        browser.close()
    return {"records": records, **found}


def main() -> None:
    """Measure and keep."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=28)
    arguments = parser.parse_args()
    sys.path.insert(0, str(_TESTS))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "strokes"
        os.environ["RIGCTL_RESULTS"] = "off"
        project(folder, arguments.records)
        found = measure(folder, arguments.records)
    rows = [("", *found["parameter"])]
    rows += [
        (f"dragging {name}", *(f"{one:.4g}" for one in found[name].values()))
        for name in ("parameter", "effect")
    ]
    table(f"{arguments.records} records", rows)
    rest = [(key, f"{found[key]:.3g}") for key in ("open_s", "switch_ms", "exact_s")]
    table("once", [("what", "value"), *rest])
    keep(Path(__file__).parent, found, "starlette", "uvicorn", "playwright")


if __name__ == "__main__":
    main()
