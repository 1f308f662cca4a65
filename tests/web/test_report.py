"""The report inside the served page: the same page, without access to the server."""

from __future__ import annotations

import json

from rigctl.dataset.catalogue import page_of_runs
from web.serving import Served, Window
from web.watched import wait_for


def newest(served: Served) -> str:
    return page_of_runs(served.project / "runs").runs[-1].id


def test_a_report_is_shown_and_cannot_reach_the_server(window: Window) -> None:
    run = newest(window.served)
    page = window.open(f"/report?run={run}")
    page.locator("iframe.report").wait_for()
    inside = page.frame_locator("iframe.report")
    inside.locator("h1", has_text="stroke campaign").wait_for()
    inside.locator(".plot:visible").first.scroll_into_view_if_needed()
    inside.locator(".plot .main-svg").first.wait_for()  # the scripts of the report itself run
    tried = f"""async () => {{
      const told = [];
      try {{ told.push(document.cookie); }} catch {{ told.push("no cookie"); }}
      try {{ told.push(window.parent.document.title); }} catch {{ told.push("no page"); }}
      try {{ told.push(await (await fetch("{window.served.base}/api/status")).text()); }}
      catch {{ told.push("no answer"); }}
      return told;
    }}"""
    frame = next(each for each in page.frames if each.parent_frame is not None)
    assert frame.evaluate(tried) == ["no cookie", "no page", "no answer"]
    window.complaints.clear()  # the browser reports that it has refused the last one
    assert f"rigctl report {run}" in page.locator(".command").inner_text()


def test_a_report_reads_only_files_of_the_project(served: Served, cookie: str) -> None:
    run = newest(served)
    for body in (
        {"runs": []},
        {"runs": ["../x"]},
        {"runs": ["--help"]},
        {"runs": [run], "models": ["/etc/passwd"]},
        {"runs": [run], "models": ["../../etc/passwd"]},
        {"runs": [run], "models": ["--diagnose"]},
        {"runs": [run] * 21},
        {"runs": "x"},
    ):
        status, answer = served.post("/api/report", body, cookie)
        if status == 200:  # the command itself refuses anything other than a run
            wait_for(lambda job=answer["id"]: served.get(f"/api/jobs/{job}", cookie)["state"] != "working")
            ended = served.get(f"/api/jobs/{answer['id']}", cookie)
            assert ended["state"] == "failed"
        else:
            assert status == 400, body
    assert served.ask("GET", "/report/made/none", cookie=cookie)[0] == 400
    assert served.ask("GET", "/report/made/none")[0] == 401


def test_a_stopped_job_is_reported_as_stopped(served: Served, cookie: str) -> None:
    status, job = served.post("/api/report", {"runs": [newest(served)]}, cookie)
    assert status == 200
    status, _, text = served.ask(
        "DELETE", f"/api/jobs/{job['id']}", headers={"Origin": served.base}, cookie=cookie
    )
    assert (status, json.loads(text)["state"]) == (200, "stopped")
    assert served.ask("GET", f"/report/made/{job['id']}", cookie=cookie)[0] == 400
