"""The frequency response on the workbench: the same as the command's, and it follows the sliders."""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

import swing
from commands import answer, told
from rigctl.dataset import list_runs
from web.serving import Served, Window, serving
from web.test_workbench import read_frame, settled

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

MODEL = "models/swing.yaml"
#: of a 32-bit float
SINGLE = 1e-5


@pytest.fixture(scope="module")
def swinging(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A log of a mass that a multisine drives, and one of it at rest: two runs of one record each."""
    folder = tmp_path_factory.mktemp("swinging") / "bench"
    folder.mkdir()
    swing.project(folder, swing.white)
    with chdir(folder):
        told("import", "log.csv", "--rig", "rigs/swing.yaml")
        lines = Path("log.csv").read_text("utf-8").splitlines()
        at_rest = [lines[0], *(f"{line.split(',')[0]},1,{line.split(',')[2]}" for line in lines[1:])]
        Path("rest.csv").write_text("\n".join(at_rest), "utf-8")
        told("import", "rest.csv", "--rig", "rigs/swing.yaml")
    with serving(folder, "--port", "0", state=tmp_path_factory.mktemp("state")) as found:
        yield found


def runs(served: Served) -> list[str]:
    with chdir(served.project):
        return sorted((one.id for one in list_runs(Path("runs"))), key=lambda name: "rest" in name)


class Session:
    """A page's socket, without a page."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket

    def ask(self, do: str, **more: Any) -> None:
        self._socket.send(json.dumps({"do": do, **more}))

    def until(self, kind: str, **has: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The next message of this kind with these values."""
        while True:
            message = self._socket.recv(timeout=240)
            read = (json.loads(message), {}) if isinstance(message, str) else read_frame(message)
            assert read[0]["kind"] != "problem", read[0]
            if read[0]["kind"] == kind and has.items() <= read[0].items():
                return read


@pytest.fixture
def session(swinging: Served) -> Iterator[Session]:
    headers = {"Cookie": swinging.enter()}
    address = f"ws://{swinging.host}/api/workbench/session"
    with connect(address, origin=Origin(swinging.base), additional_headers=headers) as socket:
        yield Session(socket)


def by_command(served: Served, written: str) -> dict[str, Any]:
    """What the command that the page shows answers."""
    with chdir(served.project):
        (one,) = answer(*shlex.split(written)[1:])["responses"]
    return one


def decibels(one: dict[str, Any], of: str = "") -> list[float]:
    """At the lines that are shown, from the lowest."""
    shown = [line for line in one["lines"] if line["shown"]]
    return [20.0 * np.log10((line[of] if of else line)["magnitude"]) for line in shown]


def measured(arrays: dict[str, np.ndarray], row: int, panel: int = 0) -> np.ndarray:
    """A trace of a panel at the lines that are shown."""
    values = arrays[f"panel {panel}"]
    return values[row][np.isfinite(values[1])]


def test_the_response_is_that_of_its_command_and_follows_the_sliders(
    session: Session, swinging: Served
) -> None:
    session.ask("open", runs=runs(swinging)[:1], model=MODEL)
    assert session.until("opened")[0]["inputs"] == [{"name": "force", "title": "force"}]
    session.ask("frequency", open=True, channel="position", seq=1)
    header, arrays = session.until("frequency")
    one = by_command(swinging, header["equals"])
    assert (header["input"], header["channel"], header["exact"]) == ("force", "position", True)
    assert header["statement"] == one["statement"]
    assert measured(arrays, 0) == pytest.approx(
        [x["frequency"] for x in one["lines"] if x["shown"]], rel=SINGLE
    )
    assert measured(arrays, 1) == pytest.approx(decibels(one), abs=1e-3)
    assert measured(arrays, 4) == pytest.approx(decibels(one, "of_model"), abs=1e-2)
    coherence = [line["coherence"] for line in one["lines"] if line["shown"]]
    assert measured(arrays, 1, 2) == pytest.approx(coherence, abs=1e-4)
    assert all(measured(arrays, 2) < measured(arrays, 1))
    assert all(measured(arrays, 3) > measured(arrays, 1))

    # while a slider moves, and at rest: another spring is another response of the model alone
    for do, exact in (("follow", False), ("settle", True)):
        session.ask(do, values={"stiffness": 8.0}, on=[], seq=2)
        moved, others = session.until("frequency", exact=exact, seq=2)
        assert "is not the measured one" in moved["statement"]
        assert measured(others, 1) == pytest.approx(measured(arrays, 1), abs=1e-3)
        assert measured(others, 4)[0] < measured(arrays, 4)[0] - 6.0  # half as much at rest

    # the same state as a version of the model in its file
    with chdir(swinging.project):
        Path("models/stiff.yaml").write_text(
            Path(MODEL).read_text("utf-8").replace("4 N/m", "8 N/m"), "utf-8"
        )
    stiff = by_command(swinging, header["equals"].replace(MODEL, "models/stiff.yaml"))
    assert measured(others, 4) == pytest.approx(decibels(stiff, "of_model"), abs=1e-2)
    assert moved["statement"] == stiff["statement"].replace("stiff", "swing")

    # closed, it costs nothing more
    session.ask("frequency", open=False)
    session.ask("settle", values={}, on=[], seq=3)
    while (header := session.until("picture")[0])["seq"] != 3 or not header["exact"]:
        pass
    session.ask("frequency", open=True, seq=4)
    assert session.until("frequency")[0]["seq"] == 4


def test_records_are_chosen_and_one_in_which_no_input_moves_says_so(
    session: Session, swinging: Served
) -> None:
    both = runs(swinging)
    session.ask("open", runs=both, model=MODEL)
    session.until("opened")
    session.ask("frequency", open=True, every=True)
    together = session.until("frequency")[0]
    assert together["every"]
    assert "record ==" not in together["equals"]
    session.ask("frequency", open=True)
    alone, arrays = session.until("frequency", every=False)
    assert "record == 1" in alone["equals"]
    assert measured(arrays, 1) == pytest.approx(decibels(by_command(swinging, alone["equals"])), abs=1e-3)

    session.ask("show", records=[1])
    still = session.until("frequency")[0]
    assert still["plot"] is None
    assert "no input moves in these records" in still["statement"]
    session.ask("frequency", open=True, input="force", channel="position")
    assert "this input does not move in these records" in session.until("frequency")[0]["statement"]
    session.ask("frequency", open=True, input="torque")
    assert "torque" in session.until("frequency")[0]["statement"]


def test_a_page_shows_it_beside_the_sliders(browser: Browser, swinging: Served) -> None:
    context = browser.new_context(viewport={"width": 1400, "height": 1000})
    context.set_default_timeout(240_000)
    window = Window(context, swinging)
    page = window.open("/workbench?choose")
    for box in page.locator("fieldset input[type=checkbox]").all():
        box.check()
    page.get_by_label("Model", exact=True).select_option(MODEL)
    page.get_by_role("button", name="Open", exact=True).click()
    settled(page)
    page.locator("button.cell").first.click()
    page.get_by_text("Frequency response", exact=True).click()
    panel = page.locator("details.response")
    panel.locator(".uplot").nth(2).wait_for()
    same = panel.locator(".statement").inner_text()
    assert "the response of swing from force to position" in same
    assert "rigctl frequency" in panel.locator("code").inner_text()
    assert accessible(page)
    before = drawn(page)

    # the model's curve follows the slider, and comes back with undo
    page.get_by_label("stiffness, typed").fill("8")
    page.keyboard.press("Tab")
    at_rest(page, "rigctl model set")
    assert drawn(page)[0] != before[0]
    assert drawn(page)[2] == before[2]  # the coherence is the measured one
    assert "is not the measured one" in panel.locator(".statement").inner_text()
    if folder := os.environ.get("RIGCTL_SCREENSHOTS"):
        page.screenshot(path=f"{folder}/bode.png", full_page=True)
    page.get_by_role("button", name="Undo").click()
    at_rest(page, "rigctl frequency")
    assert drawn(page) == before

    # a record at rest says why not
    page.locator("button.cell").nth(1).click()
    panel.get_by_text("no input moves in these records").or_(
        panel.get_by_text("this input does not move in these records")
    ).wait_for()
    assert panel.locator(".uplot").count() == 0
    page.get_by_label("Records", exact=True).select_option("all")
    panel.locator(".uplot").nth(2).wait_for()
    context.close()
    assert window.complaints == []


def drawn(page: Page) -> list[str]:
    """The plots of magnitude, phase and coherence, as images."""
    found: list[str] = page.locator("details.response canvas").evaluate_all(
        "every => every.map(one => one.toDataURL())"
    )
    return found


def at_rest(page: Page, command: str) -> None:
    """Wait for the exact response of the state that this command stands for."""
    page.locator("details.response code", has_text=re.compile(f"^{command}")).wait_for()
    settled(page)
    page.locator("details.response[data-settled=yes]").wait_for()
    page.wait_for_timeout(100)  # plots are drawn with the next frame of the screen


def accessible(page: Page) -> bool:
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    assert [one for one in found if one["impact"] in ("serious", "critical")] == []
    return True
