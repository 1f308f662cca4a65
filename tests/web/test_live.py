"""A run that is watched by several windows and commanded by one; none of them can disturb it."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from rigctl.dataset import open_run, verify
from rigctl.web.feed import Watcher
from rigctl.web.live import _between
from web.serving import Served, Window
from web.watched import InProgress, listening, run_in_progress, wait_for


@pytest.fixture(scope="module")
def running(served: Served) -> Iterator[InProgress]:
    with run_in_progress(served.project) as found:
        yield found


@pytest.mark.parametrize(
    ("origin", "with_cookie", "host"),
    [
        (None, True, None),
        ("http://evil.example", True, None),
        ("null", True, None),
        ("http://127.0.0.1:1", True, None),
        ("{base}", False, None),
        ("http://evil.example", True, "evil.example"),
    ],
)
def test_a_socket_is_opened_only_for_a_page_of_this_server(
    served: Served, cookie: str, origin: str | None, host: str | None, *, with_cookie: bool
) -> None:
    headers = {"Cookie": cookie} if with_cookie else {}
    named = origin.format(base=served.base) if origin else None
    address = f"ws://{host or served.host}/api/live/stream?viewer=x"
    line = socket.create_connection(("127.0.0.1", served.port), timeout=120)
    with pytest.raises(InvalidStatus) as refused, line:
        connect(address, sock=line, origin=named, additional_headers=headers).__enter__()
    assert refused.value.response.status_code == 403


def test_a_window_receives_samples_and_set_points(served: Served, cookie: str, running: InProgress) -> None:
    with listening(served, cookie, "first") as listener:
        listener.want(running.id, window=20.0, width=4000)
        listener.hear_until(lambda: listener.rows.shape[1] > 150 and listener.told.get("set_points"))
        held = listener.told["set_points"][-1]
        listener.hear_until(lambda: listener.rows[0, -1] > held["begin"] + 0.5)
        seen = listener.rows
        about, state = listener.told["run"], listener.told["state"]
    assert state["state"] == "running"
    assert [step["stage"] for step in state["tree"]].count("current") >= 1
    assert [channel["unit"] for channel in about["channels"]] == ["degC", "bar", "mm"]
    position = next(channel for channel in about["channels"] if channel["name"] == "position")
    assert [(limit["bound"], limit["value"]) for limit in position["limits"]] == [
        ("above", pytest.approx(240.0)),
        ("below", pytest.approx(-3.0)),
    ]
    pressure = next(channel for channel in about["channels"] if channel["name"] == "supply_pressure")
    assert pressure["set_point"] == "relief_valve"
    assert (held["channel"], held["within"]) == ("supply_pressure", pytest.approx(40.0))
    near = np.abs(seen[0] - held["begin"]) < 0.3
    assert np.abs(seen[2, near] - held["to"]).min() < 1e-4  # a reading at its start


def test_two_windows_see_the_same_and_one_commands(window: Window, cookie: str, running: InProgress) -> None:
    served = window.served
    one = window.open("/live")
    two = window.open("/live")
    for page in (one, two):
        page.locator(".channel canvas").first.wait_for()
        assert page.locator(".run-title").inner_text() == running.id
    one.get_by_role("button", name="Take").click()  # a window of an earlier test may still hold them
    one.get_by_text("This window has the controls").wait_for()
    one.get_by_role("button", name="Pause").click()
    one.get_by_text(f"rigctl pause {running.id}").wait_for()
    two.locator(".run-state", has_text="paused").wait_for()
    wait_for(lambda: running.state() == "paused")
    two.get_by_text("has the controls").wait_for()
    two.locator("button", has_text="Continue").and_(two.locator(":disabled")).wait_for()
    # a window that enables its button by force is refused by the server, too
    status, refused = served.post(f"/api/live/{running.id}/request", {"request": "abort"}, cookie, "liar")
    assert status == 409
    assert "has the controls" in refused["error"]["what"]
    assert running.state() == "paused"
    two.get_by_role("button", name="Take over").click()
    one.get_by_role("button", name="Take over").wait_for()
    two.reload()  # a reload in between: the window remains the same one
    two.get_by_text("This window has the controls").wait_for()
    two.get_by_role("button", name="Continue").click()
    one.locator(".run-state", has_text="running").wait_for()
    two.get_by_role("button", name="Give them back").click()
    one.get_by_text("Nobody has the controls").wait_for()


def test_a_procedure_s_name_with_markup_is_text(window: Window, running: InProgress) -> None:
    page = window.open("/live")
    page.locator(".live-names p", has_text="<b onclick=alert(1)>watch me</b>").wait_for()
    assert page.locator(".live-names b").count() == 0
    page.goto(f"{window.served.base}/runs?run={running.id}")
    page.locator("aside dd", has_text="<b onclick=alert(1)>watch me</b>").wait_for()


def test_a_browser_without_sockets_shows_a_notice_and_polls(window: Window, running: InProgress) -> None:
    window.context.add_init_script("delete globalThis.WebSocket")
    page = window.open("/live")
    page.get_by_text("no live connection").wait_for()
    page.locator(".channel canvas").first.wait_for()
    page.locator(".run-state", has_text="running").wait_for()
    assert page.locator("[data-channel=position] .value").inner_text().endswith("mm")


def test_a_window_that_does_not_read_delays_neither_the_run_nor_other_windows(
    served: Served, cookie: str, running: InProgress
) -> None:
    """Its socket fills up; the run and the other windows continue."""
    line = socket.create_connection(("127.0.0.1", served.port), timeout=120)
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    address = f"ws://{served.host}/api/live/stream?viewer=asleep"
    asleep = connect(
        address, sock=line, origin=served.base, additional_headers={"Cookie": cookie}, max_queue=1
    )
    with asleep as connection, listening(served, cookie, "awake") as awake:
        connection.send(f'{{"run": "{running.id}", "window": 900, "width": 4000}}')
        awake.want(running.id)
        awake.hear_until(lambda: awake.rows.shape[1] > 0)
        before = awake.rows[0, -1]
        awake.hear_until(lambda: awake.rows[0, -1] > before + 1.0)
        assert "dropped" not in awake.told
        line.close()
    assert running.process.poll() is None


@pytest.mark.parametrize(
    "sent",
    [
        "",
        "[]",
        "{}",
        '{"run": 7}',
        '{"run": "../x"}',
        '{"run": "nothing"}',
        '{"window": 1e999}',
        "\x00",
        "[" * 5000,
        b"\x00\x01",
    ],
    ids=range(10),
)
def test_invalid_messages_do_not_end_the_connection(
    served: Served, cookie: str, running: InProgress, sent: str | bytes
) -> None:
    with listening(served, cookie, "odd") as odd:
        odd.socket.send(sent)
        odd.want(running.id)
        odd.hear_until(lambda: "state" in odd.told)


def test_an_aborted_run_is_complete_and_has_the_samples_that_were_shown(
    window: Window, running: InProgress
) -> None:
    with listening(window.served, window.served.enter(), "last") as listener:
        listener.want(running.id, window=20.0, width=4000)
        listener.hear_until(lambda: listener.rows.shape[1] > 100)
        seen = listener.rows
    page = window.open("/live")
    page.get_by_role("button", name="Take").click()
    page.get_by_text("This window has the controls").wait_for()
    page.get_by_role("button", name="Abort", exact=True).click()
    page.get_by_role("button", name="Abort now").click()
    page.get_by_text("This run is over: aborted").wait_for()
    assert page.locator(".commands dd").all_inner_texts() == ["off (safe)", "neutral (safe)", "–"]
    page.locator(".statement", has_text="at a browser").wait_for()
    running.process.wait(120)
    assert verify(running.folder).good
    run = open_run(running.folder)
    time = run.signals("time")
    found = np.searchsorted(time, seen[0] - 1e-5)
    assert np.abs(time[found] - seen[0]).max() < 1e-4
    for row, name in enumerate(run.layout.channels, start=1):
        kept = run.samples([name])[name].to_numpy()[found]
        assert np.allclose(kept, seen[row], rtol=1e-6, atol=1e-6)


def test_a_slow_window_drops_the_oldest_samples_and_counts_them() -> None:
    watcher = Watcher(lambda: None)
    rows = np.zeros((5, 3))
    watcher.begin(rows, 10.0, 10_000)
    for step in range(200):
        rows[:, 0] = step + np.arange(5) / 5
        watcher.take(rows.copy())
    told, batches = watcher.waiting()
    assert len(batches) == 40
    assert told["dropped"] == 161
    begins = [struct.unpack("<HHHHd", batch[:16])[4] for batch in batches]
    assert begins == [float(step) for step in range(160, 200)]
    assert watcher.waiting() == ({}, [])


def test_a_number_too_large_for_a_float_is_limited_to_the_range() -> None:
    assert _between(10**400, 60.0, 1.0, 900.0) == 900.0
    assert _between(-(10**400), 60.0, 1.0, 900.0) == 1.0
