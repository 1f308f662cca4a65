"""The workbench in a browser: the tutorial of the hidden effect without a terminal, and its failures."""

from __future__ import annotations

import json
import os
import re
import signal
import struct
import subprocess
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from commands import answer
from rigctl.dataset import open_run
from rigctl.web.server_state import LONGEST_MESSAGE
from rigctl.web.workbench.frames import frame
from systems import needs_posix
from web.pictures import outline, outline_of_picture
from web.serving import Served, Window, serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

#: records at 20 and 80 degC, and one at 60, of the shipped campaign that an independent program made with a
#: leaking valve; the same as in journeys/test_diagnose.py, whose fits are reused
RECORDS = {"001", "019", "025", "028"}
MODEL = "models/hl32-textbook.yaml"


@pytest.fixture(scope="module")
def leaking(tmp_path_factory: pytest.TempPathFactory, shared_results: Path) -> Iterator[Served]:
    """A server on an empty folder; jobs reuse the fits of earlier ones."""
    project = tmp_path_factory.mktemp("leaking") / "bench"
    project.mkdir()
    with serving(project, "--port", "0", state=tmp_path_factory.mktemp("state")) as found:
        yield found


@pytest.fixture(scope="module")
def bench(browser: Browser, leaking: Served) -> Iterator[Page]:
    """The page of the workbench: a project, data and a model, as a user gets them in an empty folder."""
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    context.set_default_timeout(240_000)
    window = Window(context, leaking)
    page = window.open("/workbench")
    page.get_by_role("button", name="Fill it with examples").click()
    page.get_by_text("This folder holds no project yet").wait_for(state="detached")
    write_few(leaking.project)
    page.get_by_text("Bring in measured data").click()
    page.get_by_label("File").fill("few.csv")
    page.get_by_label("Bench", exact=True).select_option("rigs/hl32-bench.yaml")
    page.get_by_label("Assume").first.fill("heater=off")
    page.get_by_role("button", name="Import").click()
    page.get_by_role("checkbox", name=re.compile("few")).wait_for()
    assert page.get_by_label("Model", exact=True).input_value() == MODEL
    page.get_by_label("Hold out").fill("oil == 60 degC")
    page.get_by_role("button", name="Open", exact=True).click()
    settled(page)
    yield page
    context.close()
    assert window.complaints == []


def write_few(project: Path) -> None:
    """A file of measured data that is no run yet."""
    lines = (project / "data/unknown-bench.csv").read_text("utf-8").splitlines(keepends=True)
    kept = [line for line in lines[1:] if line.split(",")[1] in RECORDS]
    (project / "few.csv").write_text("".join([lines[0], *kept]), "utf-8")


def settled(page: Page) -> None:
    page.locator("[data-exact=yes]").wait_for()


def verb(page: Page, name: str) -> str:
    """Click an analysis, wait for it, and return its answer."""
    page.get_by_role("toolbar", name="Analyses").get_by_role("button", name=name).click()
    return card(page, name)


def card(page: Page, name: str) -> str:
    found = page.locator("section.result", has=page.get_by_role("heading", name=name)).first
    found.wait_for()
    return found.inner_text()


def position(page: Page) -> float:
    """The root mean square error of the position that the page shows, mm."""
    shown = page.locator(".now li", has_text="position").inner_text()
    return float(shown.split()[0])


def drag(page: Page, label: str, steps: int) -> None:
    """Press an arrow key on a slider: a drag as the keyboard makes it."""
    page.get_by_role("slider", name=label).focus()
    for _ in range(abs(steps)):
        page.keyboard.press("ArrowRight" if steps > 0 else "ArrowLeft")


def is_pictured(place: Locator, name: str) -> None:
    """The documentation's picture shows this page, as it is now."""
    assert outline(place) == outline_of_picture(name), "'python tools/workbench_pictures.py' takes it again"


def test_the_hidden_effect_is_found_and_added_without_a_terminal(bench: Page, leaking: Served) -> None:
    page = bench
    before = position(page)
    assert "held out" in page.locator(".now").inner_text()

    # by hand: another opening, and the leak; all displays follow, and return with undo
    drag(page, "flow area fitted", -20)
    settled(page)
    moved = position(page)
    assert moved != before
    assert "rigctl model set" in page.locator(".standsfor").inner_text()
    is_pictured(page.locator(".bench"), "workbench-by-hand")
    page.get_by_role("switch", name="valve leakage").check()
    settled(page)
    assert "--add" in page.locator(".standsfor").inner_text()
    page.get_by_role("button", name="Undo").click()
    settled(page)
    assert position(page) == moved
    page.get_by_role("button", name="Undo").click()
    settled(page)
    assert position(page) == before
    assert page.get_by_role("switch", name="valve leakage").is_checked() is False

    page.locator("button.cell").nth(2).click()
    label = page.locator("button.cell").nth(2).get_attribute("aria-label") or ""
    found = verb(page, "Diagnose")
    assert "valve leakage" in found
    is_pictured(page.locator("section.result[data-verb=diagnose]"), "workbench-diagnosis")
    measured_what_was_designed(page, leaking)

    page.get_by_role("button", name="Add what is missing").click()
    assert "added valve_leakage: the model now agrees" in card(page, "Diagnose and add")
    page.locator('[data-open$="@2"]').wait_for()
    settled(page)
    assert page.get_by_role("switch", name="valve leakage").is_checked()
    assert position(page) < 0.2 * before
    assert page.locator(".channel .uplot").count() == 6  # the selected record is still selected
    assert label.partition(":")[0] in page.locator("h2.record").inner_text()
    assert "v1" in verb(page, "History")
    is_pictured(page.locator("section.result[data-verb=history]"), "workbench-history")
    with chdir(leaking.project):
        history = answer("model", "history", MODEL)
    assert [one["done"] for one in history["versions"]] == ["first version", "add valve_leakage"]
    assert position(page) == pytest.approx(history["errors"][-1]["rmse"]["position"], rel=0.02)

    # a state kept by hand is the next version, as the command would write it
    drag(page, "flow area fitted", 3)
    settled(page)
    page.get_by_role("button", name="Keep as version").click()
    page.locator('[data-open$="@3"]').wait_for()
    with chdir(leaking.project):
        assert answer("model", "history", MODEL)["versions"][-1]["kind"] == "set"
    versions_beside_each_other(page)


def measured_what_was_designed(page: Page, leaking: Served) -> None:
    """The next experiment: designed, viewed, approved, and carried out on the simulated bench."""
    proposed = verb(page, "Next experiment")
    assert "valve_leakage is what is missing" in proposed
    design = page.locator("section.result[data-verb=design]")
    assert design.locator(".uplot").count() >= 1  # the prediction for the experiment
    page.get_by_label("the simulated bench hides").fill("valve_leakage:conductance=7e-15 m^3")
    page.get_by_role("button", name="Approve: run it on the simulated bench").click()
    done = page.locator("section.result[data-verb=approve]")
    done.wait_for()
    run = done.locator(".statement").inner_text().partition(":")[0]
    assert "rigctl simulate procedures/next-1.yaml --with" in done.inner_text()
    design.locator("summary", has_text="The procedure").click()
    with chdir(leaking.project):
        told = open_run(run).info
        assert told["status"] == "finished"
        assert "valve_leakage (conductance=7e-15)" in told["backend"]["plant"]
        assert Path("procedures/next-1.yaml").read_text("utf-8") == design.locator("pre").inner_text()


def versions_beside_each_other(bench: Page) -> None:
    """Any two of the versions made so far, compared on the same records."""
    verb(bench, "History")
    bench.get_by_role("button", name="Compare version 1 with version 3").click()
    said = card(bench, "Compare")
    assert f"rigctl compare {shown_run(bench)} --model {MODEL}@1 --model {MODEL}" in said
    heads = bench.locator("section.result[data-verb=compare] thead th").all_inner_texts()
    assert heads[1:3] == [f"{MODEL}@1", MODEL]
    line = bench.locator("section.result[data-verb=compare] tbody tr", has_text="position").first
    first, last = (float(text.split()[0]) for text in line.locator("td").all_inner_texts()[:2])
    assert last < 0.9 * first
    assert (
        bench.locator("section.result[data-verb=compare] .uplot").count() >= 1
    )  # the error that each leaves


@pytest.fixture
def opened(bench: Page, leaking: Served) -> Iterator[Page]:
    """The imported data and the model on a separate page, without steps or results of other tests."""
    page = bench.context.new_page()
    page.goto(f"{leaking.base}/workbench?choose")  # nothing is opened by itself
    page.get_by_role("checkbox", name=re.compile("few")).wait_for()
    page.evaluate("history.replaceState(null, '', '/workbench')")  # as it is when a user comes back
    for box in page.locator("fieldset input[type=checkbox]").all():
        box.uncheck()
    page.get_by_role("checkbox", name=re.compile("few")).check()
    page.get_by_label("Model", exact=True).select_option(MODEL)
    page.get_by_role("button", name="Open", exact=True).click()
    settled(page)
    yield page
    page.close()


def test_a_reload_keeps_the_steps_and_the_results(opened: Page) -> None:
    kept = position(opened)
    found = verb(opened, "Compare")
    assert MODEL in found
    opened.get_by_label("flow area, typed").fill("3.4")
    opened.keyboard.press("Tab")
    settled(opened)
    moved = position(opened)
    assert moved != kept
    opened.reload()
    settled(opened)
    assert position(opened) == moved
    assert card(opened, "Compare") == found
    opened.get_by_role("button", name="Undo").click()
    settled(opened)
    assert position(opened) == kept
    assert opened.get_by_role("button", name="Undo").is_disabled()
    opened.get_by_role("button", name="Redo").click()
    settled(opened)
    assert position(opened) == moved


def shown_run(page: Page) -> str:
    """The run that is open."""
    return page.locator(".choosing > summary").inner_text().split(" on ")[1].partition(":")[0]


def test_the_errors_of_a_table_of_single_values_follow_the_sliders(bench: Page, leaking: Served) -> None:
    page = bench.context.new_page()
    page.goto(f"{leaking.base}/workbench?choose")  # nothing is opened by itself
    page.get_by_text("Bring in measured data").click()
    page.get_by_label("File").fill("data/hl32-viscosity.csv")
    page.get_by_label("Bench", exact=True).select_option(label="no bench: a table")
    page.get_by_role("button", name="Import").click()
    page.get_by_role("checkbox", name=re.compile("viscosity")).wait_for()
    assert page.get_by_label("Model", exact=True).input_value() == "models/hl32-oil.yaml"
    page.get_by_role("button", name="Open", exact=True).click()
    settled(page)
    with chdir(leaking.project):
        said = answer("compare", shown_run(page), "--model", "models/hl32-oil.yaml", "--no-fit")
    assert read(page) == pytest.approx(said["channels"]["kinematic_viscosity"]["rmse"], rel=1e-3)
    assert "over oil temperature" in page.locator("h2.record").inner_text()
    assert page.locator("button.cell").count() == 13
    drag(page, "vogel a fitted", 3)
    settled(page)
    assert read(page) > said["channels"]["kinematic_viscosity"]["rmse"]
    page.get_by_role("button", name="Undo").click()
    settled(page)
    assert read(page) == pytest.approx(said["channels"]["kinematic_viscosity"]["rmse"], rel=1e-3)
    page.close()


def read(page: Page) -> float:
    """The first channel's root mean square error that the page shows."""
    return float(page.locator(".now li b").first.inner_text().split()[0])


def test_a_cell_of_the_map_shows_its_record_and_arrow_keys_move_between_cells(bench: Page) -> None:
    cells = bench.locator("button.cell")
    cells.nth(2).click()
    label = cells.nth(2).get_attribute("aria-label") or ""
    assert "times the noise" in label
    bench.locator("h2.record", has_text=label.partition(":")[0]).wait_for()
    bench.keyboard.press("ArrowRight")
    assert bench.evaluate("document.activeElement.getAttribute('aria-label')") != label


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (420, "dark")])
def test_the_workbench_is_accessible(bench: Page, scheme: Any, width: int) -> None:
    from axe_playwright_python.sync_playwright import Axe

    bench.emulate_media(color_scheme=scheme)
    bench.set_viewport_size({"width": width, "height": 900})
    bench.wait_for_timeout(100)
    if width == 420:
        is_pictured(bench.locator(".bench"), "workbench-on-a-phone")
    found = Axe().run(bench).response["violations"]
    serious = [(one["id"], [node["html"] for node in one["nodes"]]) for one in found]
    assert [one for one in serious if found[serious.index(one)]["impact"] in ("serious", "critical")] == []
    assert bench.evaluate("document.documentElement.scrollWidth") <= width


def test_a_stopped_analysis_is_reported_as_stopped(bench: Page, leaking: Served) -> None:
    bench.get_by_role("toolbar", name="Analyses").get_by_role("button", name="Discover").click()
    bench.get_by_role("button", name="Stop").click()
    bench.get_by_text("Discover: stopped").wait_for()
    status = leaking.ask("GET", "/api/jobs", cookie=leaking.enter())[2]
    assert json.loads(status)["jobs"][0]["state"] == "stopped"


def test_a_refusal_is_shown_and_sliders_keep_working(bench: Page) -> None:
    """As a hand-made message, or a page of another version, might send."""
    bench.set_viewport_size({"width": 1400, "height": 900})
    typed = bench.get_by_label("flow area, typed")
    typed.fill("a lot")
    bench.keyboard.press("Tab")
    assert typed.get_attribute("aria-invalid") == "true"
    typed.fill("-1")
    bench.keyboard.press("Tab")
    bench.get_by_text("out of bounds").wait_for()
    typed.fill("3.4")
    bench.keyboard.press("Tab")
    settled(bench)


@needs_posix("ps, and SIGKILL")
def test_a_crashed_workbench_is_reported_and_reopens(bench: Page, leaking: Served) -> None:
    """Out of memory, or a crash in native code: the server keeps running."""
    for pid, arguments in children(leaking.process.pid):
        if "spawn_main" in arguments:
            os.kill(pid, signal.SIGKILL)
    bench.get_by_text("the process behind this workbench has ended").wait_for()
    bench.get_by_role("button", name="Open again").click()
    bench.get_by_role("button", name="Open again").wait_for(state="detached")
    settled(bench)


def children(parent: int) -> list[tuple[int, str]]:
    """The processes that another has started, with their command lines."""
    listed = subprocess.run(
        ["ps", "-ww", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True
    )
    lines = [line.split(None, 2) for line in listed.stdout.splitlines()]
    return [(int(pid), args) for pid, ppid, args in lines if int(ppid) == parent]


@pytest.mark.parametrize("path", ["../../secret.yaml", "/etc/secret.yaml", "models/a\0b.yaml"])
def test_only_the_project_s_files_are_imported_analysed_or_have_a_history(leaking: Served, path: str) -> None:
    headers, cookie = {"Origin": leaking.base}, leaking.enter()
    brought = {"file": path, "rig": "", "assume": []}
    asked = "/api/workbench/history?" + urlencode({"model": path})
    work = {"verb": "compare", "runs": ["latest"], "assume": [], "model": path}
    beside = work | {"model": MODEL, "beside": path}
    for method, route, body in (
        ("POST", "/api/workbench/import", brought),
        ("POST", "/api/workbench/work", work),
        ("POST", "/api/workbench/work", beside),
        ("GET", asked, None),
    ):
        status, _, text = leaking.ask(method, route, body, headers=headers, cookie=cookie)
        assert status == 400, route
        assert "the project has no such place" in text, route
    status, _, text = leaking.ask(
        "POST", "/api/workbench/work", work | {"model": MODEL, "runs": [path]}, headers=headers, cookie=cookie
    )
    assert status == 400
    assert "this is not a run's id" in text


@pytest.mark.parametrize(
    ("origin", "let_in"), [("http://evil.example", True), (None, True), ("{base}", False)]
)
def test_a_socket_from_elsewhere_is_refused(leaking: Served, origin: str | None, let_in: bool) -> None:
    """Another page with this browser's cookie, a program without an Origin, and our page without a cookie."""
    headers = {"Cookie": leaking.enter()} if let_in else {}
    given = None if origin is None else Origin(origin.format(base=leaking.base))
    address = f"ws://{leaking.host}/api/workbench/session"
    with pytest.raises(InvalidStatus), connect(address, origin=given, additional_headers=headers):
        pass


def test_unknown_messages_are_refused_and_the_session_continues(leaking: Served) -> None:
    address = f"ws://{leaking.host}/api/workbench/session"
    headers = {"Cookie": leaking.enter()}
    with connect(address, origin=Origin(leaking.base), additional_headers=headers) as socket:
        for message in (
            "no JSON",
            "[]",
            '{"do": "fly"}',
            '{"do": "fly", "values": "' + 200_000 * "x" + '"}',
            '{"do": "settle", "values": {"flow_area": 1e999}}',
            '{"do": "open", "runs": ["no such run"], "model": "models/hl32-textbook.yaml"}',
            '{"do": "open", "runs": [], "model": "../../../etc/passwd"}',
        ):
            socket.send(message)
            answers = iter(lambda: json.loads(socket.recv(timeout=60)), None)
            problem = next(one for one in answers if one["kind"] == "problem")
            assert problem["error"]["message"], message[:200]


@pytest.mark.parametrize(("length", "closed"), [(LONGEST_MESSAGE, None), (LONGEST_MESSAGE + 1, 1009)])
def test_messages_up_to_the_maximum_length_are_accepted_and_longer_ones_refused(
    leaking: Served, length: int, closed: int | None
) -> None:
    """The limits of server and workbench used to differ: messages in between were read, then refused."""
    address = f"ws://{leaking.host}/api/workbench/session"
    headers = {"Cookie": leaking.enter()}
    text = '{"do": "fly", "values": ""}'.replace('""', f'"{(length - 27) * "x"}"')
    assert len(text) == length
    with connect(address, origin=Origin(leaking.base), additional_headers=headers) as socket:
        socket.send(text)
        if closed is None:
            assert json.loads(socket.recv(timeout=60))["kind"] == "problem"
            return
        with pytest.raises(ConnectionClosed) as caught:
            socket.recv(timeout=60)
    assert caught.value.rcvd is not None
    assert caught.value.rcvd.code == closed


def read_frame(message: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Decode a message of `frame` as the browser does."""
    (length,) = struct.unpack_from("<I", message)
    header: dict[str, Any] = json.loads(message[4 : 4 + length])
    arrays, at = {}, 4 + length
    for one in header["arrays"]:
        count = int(np.prod(one["shape"], dtype=np.int64))
        arrays[one["name"]] = np.frombuffer(message, "<f4", count, at).reshape(one["shape"])
        at += 4 * count
    return header, arrays


@settings(max_examples=15)
@given(
    hnp.arrays(np.float32, hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=7)),
    st.dictionaries(st.text(max_size=5), st.text(max_size=9), max_size=3),
)
def test_arrays_are_transmitted_unchanged(values: np.ndarray, header: dict[str, str]) -> None:
    header.pop("arrays", None)
    read, arrays = read_frame(frame(header, [("one", values), ("two", values.T)]))
    assert {key: value for key, value in read.items() if key != "arrays"} == header
    np.testing.assert_array_equal(arrays["one"], values)
    np.testing.assert_array_equal(arrays["two"], values.T)
