"""A procedure in the browser: completed and checked as it is typed, drawn, saved, and carried out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rigctl.dataset import open_run
from rigctl.dataset.catalogue import page_of_runs
from rigctl.dataset.recording.writer_lock import read_state
from rigctl.errors import RigctlError
from rigctl.project import Project
from rigctl.web.jobs import Jobs
from rigctl.web.procedure import Procedures
from rigctl.web.request_handling import PageRequest
from rigctl.web.server_state import Site
from web.serving import Served, Window
from web.watched import wait_for

ASKING = """\
procedure: ask me
rig: rigs/hl32-bench.yaml
steps:
  - prompt: {question: How long did the oil run, name: runtime, unit: s, low: 1 s, high: 10 min}
  - prompt: Close the <b>door</b>
"""


def test_errors_are_shown_at_their_line(window: Window) -> None:
    page = window.open("/procedure?file=procedures/quick-check.yaml")
    page.locator(".figures", has_text="records").wait_for()
    assert page.locator(".timeline .box.record").count() == 2
    area = page.get_by_label("The procedure's text")
    area.fill("procedure: x\nrig: rigs/hl32-bench.yaml\nsteps:\n  - heet: 40 degC\n  - wait: 3 bar\n")
    page.locator(".wrong li", has_text="did you mean 'heat'").wait_for()
    page.locator(".wrong li", has_text="Line 5").wait_for()
    assert page.locator(".gutter .bad").all_inner_texts() == ["4\n", "5\n"]
    assert page.get_by_role("button", name="Simulate").is_disabled()
    page.once("dialog", lambda dialog: dialog.accept())
    page.evaluate("document.querySelector('textarea').value = ''")
    page.close(run_before_unload=False)


OFFERED = [
    ("pro", {"procedure"}),
    ("steps:\n  - he", {"heat"}),
    ("steps:\n  - record: {na", {"name"}),
    ("steps:\n  - record: {name: x, ra", {"rate"}),
    ("steps:\n  - heat:\n      wi", {"within"}),
    ("steps:\n  - for: {oil: [20 degC]}\n    do:\n      - measure: {name: x}\n    on_f", {"on_failure"}),
    ("steps:\n  - wait: ", set()),
    ("rig: ri", set()),
]


def test_completions_come_from_the_schema(window: Window, cookie: str) -> None:
    page = window.context.new_page()
    page.goto(f"{window.served.base}/assets/procedure.js")
    known = window.served.get("/api/procedure/completion", cookie)
    found = page.evaluate(
        """async ([known, texts]) => {
          const { suggestions } = await import("/assets/procedure.js");
          return texts.map((text) => suggestions(known, text, text.length).entries.map(([name]) => name));
        }""",
        [known, [text for text, _ in OFFERED]],
    )
    for (text, offered), names in zip(OFFERED, found, strict=True):
        assert offered <= set(names), text
        assert bool(names) is bool(offered), text


def test_a_step_name_is_completed_with_the_keyboard(window: Window) -> None:
    page = window.open("/procedure?file=procedures/quick-check.yaml")
    area = page.get_by_label("The procedure's text")
    area.fill("procedure: x\nrig: rigs/hl32-bench.yaml\nsteps:\n  - ")
    area.press("Control+Space")
    area.type("retr")
    page.locator("#offers [aria-selected=true]", has_text="retract").wait_for()
    area.press("Enter")
    assert area.input_value().endswith("  - retract: ")
    page.close(run_before_unload=False)


def test_a_file_changed_meanwhile_is_not_overwritten(served: Served, cookie: str) -> None:
    def save(path: str, text: str, sha256: str = "") -> tuple[int, dict[str, str]]:
        return served.post("/api/procedure/save", {"path": path, "text": text, "sha256": sha256}, cookie)

    status, first = save("procedures/new.yaml", "procedure: one\n")
    assert status == 200
    assert save("procedures/new.yaml", "procedure: two\n", first["sha256"])[0] == 200
    status, refused = save("procedures/new.yaml", "procedure: three\n", first["sha256"])
    assert (status, refused["error"]["what"]) == (409, "the file has changed since it was read")
    assert (served.project / "procedures" / "new.yaml").read_text("utf-8") == "procedure: two\n"
    for path in (
        "../x.yaml",
        "rigs/x.yaml",
        "procedures/../rigs/hl32-bench.yaml",
        "/tmp/x.yaml",
        "procedures/x.py",
    ):
        assert save(path, "x")[0] == 400
    for path in ("../../etc/passwd", "/etc/passwd", "rigctl.toml\0"):
        assert (
            served.ask("GET", f"/api/procedure/file?path={path}".replace("\0", "%00"), cookie=cookie)[0]
            == 400
        )


def test_of_windows_that_save_at_once_one_succeeds(tmp_path: Path) -> None:
    """Each had compared the file with what it knew before any of them wrote."""
    (tmp_path / "procedures").mkdir()
    procedures = Procedures(Site(Project(tmp_path, tmp_path / "runs"), Jobs(tmp_path)))

    def save(text: str) -> str:
        try:
            procedures.save(PageRequest({}, {}, {"path": "procedures/new.yaml", "text": text}))
        except RigctlError as error:
            return error.what
        return text

    texts = [f"procedure: {number}\n" for number in range(16)]
    with ThreadPoolExecutor(16) as windows:
        done = set(windows.map(save, texts))
    (saved,) = done - {"the file has changed since it was read"}
    assert (tmp_path / "procedures" / "new.yaml").read_text("utf-8") == saved


@pytest.mark.parametrize("path", ["../elsewhere.yaml", "/etc/x.yaml", "procedures/a\0b.yaml", ""])
def test_a_text_is_checked_only_as_a_file_of_the_project(served: Served, cookie: str, path: str) -> None:
    """The rig is looked up beside the file."""
    status, told = served.post("/api/procedure/check", {"path": path, "text": "procedure: x"}, cookie)
    (error,) = told["errors"]
    assert (status, error["what"]) == (200, "the project has no such place")


def test_a_simulation_is_started_and_its_run_shown(window: Window) -> None:
    page = window.open("/procedure?file=procedures/quick-check.yaml")
    page.get_by_label("Speed", exact=True).select_option("max")
    page.get_by_role("button", name="Simulate").click()
    page.locator("aside h2", has_text="quick-check").wait_for()
    page.locator("aside .tag", has_text="finished").wait_for()


def test_a_real_run_needs_confirmation_by_name_and_prompts_are_answered_on_the_page(window: Window) -> None:
    served = window.served
    path = Path(served.project, "procedures", "ask-me.yaml")
    path.write_text(ASKING, encoding="utf-8")
    cookie = served.enter()
    before = page_of_runs(served.project / "runs").all
    body = {"path": "procedures/ask-me.yaml", "bench": "real"}
    for name in ("", "hl32 bench", "HL32", 7):
        assert served.post("/api/procedure/start", {**body, "rig": name}, cookie)[0] == 400
    assert page_of_runs(served.project / "runs").all == before
    page = window.open("/procedure?file=procedures/ask-me.yaml")
    page.get_by_label("real bench").check()
    go = page.get_by_role("button", name="Start on HL32 bench")
    go.wait_for()
    assert go.is_disabled()
    page.get_by_label("Type the rig's name").fill("HL32 bench")
    go.click()
    page.get_by_text("How long did the oil run").first.wait_for()
    page.get_by_role("button", name="Take").click()  # a window of an earlier test may have them still
    page.get_by_text("This window has the controls").wait_for()
    answer = page.get_by_label("The answer")
    answer.fill("3 h")  # out of range: the prompt is repeated
    page.get_by_role("button", name="Answer").click()
    page.locator(".question", has_text="out of range").wait_for()
    answer.fill("90 s")
    page.get_by_role("button", name="Answer").click()
    page.locator(".question", has_text="Close the <b>door</b>").wait_for()
    run = page.locator(".run-title").inner_text()
    page.get_by_role("button", name="Done").click()
    page.get_by_text("This run is over: finished").wait_for()
    folder = served.project / "runs" / run
    wait_for(lambda: (read_state(folder) is not None) and not (folder / "samples.journal").exists())
    (value,) = [one["value"] for one in open_run(folder).info["measures"]]
    assert value == pytest.approx(90.0)
    assert served.post("/api/live/lease", {"over": True}, served.enter(), "late")[0] == 200
    status, refused = served.post(
        f"/api/live/{run}/answer", {"question": "x", "text": "y"}, served.enter(), "late"
    )
    assert (status, refused["error"]["what"]) == (409, "nothing is asked")
