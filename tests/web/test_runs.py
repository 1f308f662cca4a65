"""The catalogue in the browser: finding, sorting, annotating, excluding and comparing runs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import pytest

from commands import answer, told
from rigctl.dataset import open_run
from rigctl.dataset.catalogue import page_of_runs
from rigctl.dataset.curate import exclude
from rigctl.dataset.sql import query
from rigctl.errors import RigctlError
from rigctl.project import Project
from rigctl.web.jobs import Jobs
from rigctl.web.overlay import _query, overlay
from rigctl.web.request_handling import PageRequest
from rigctl.web.runs import Catalogue
from rigctl.web.server_state import Site
from systems import words_of
from web.serving import Served, Window, serving

MARKUP = "<img src=x onerror=\"document.title='broken in'\"> & <b>worn</b>"


@pytest.fixture(scope="module")
def served(served: Served, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A project with two campaigns only; runs of other tests are not in it."""
    first = served.project / "runs" / page_of_runs(served.project / "runs", count=1000).runs[-1].id
    project = tmp_path_factory.mktemp("two") / "strokes-of-june"
    shutil.copytree(served.project, project, ignore=shutil.ignore_patterns("runs"))
    shutil.copytree(first, project / "runs" / first.name)
    with serving(project, "--port", "0", state=tmp_path_factory.mktemp("state")) as found:
        yield found


@pytest.fixture(scope="module")
def cookie(served: Served) -> str:
    return served.enter()


@pytest.fixture(scope="module")
def two(served: Served) -> tuple[str, str]:
    """A second campaign, on a bench whose piston leaks."""
    (first,) = [run.id for run in page_of_runs(served.project / "runs").runs]
    with chdir(served.project):
        other = answer(
            *("simulate", "procedures/campaign.yaml", "-a", "temperatures=30 degC", "--seed", "3"),
            *("--with", "piston_leakage"),
        )
    return first, str(other["run"])


def test_the_pages_of_runs_agree_with_the_list_command(
    served: Served, cookie: str, two: tuple[str, str]
) -> None:
    page = served.get("/api/runs?count=1", cookie)
    assert (page["found"], page["all"]) == (2, 2)
    assert [run["id"] for run in page["runs"]] == [two[1]]
    assert [run["id"] for run in served.get("/api/runs?count=1&first=1", cookie)["runs"]] == [two[0]]
    oldest = served.get("/api/runs?order=up", cookie)["runs"]
    with chdir(served.project):
        listed = answer("runs", "list")["runs"]
    assert [(run["id"], run["records"], run["status"]) for run in oldest] == [
        (run["id"], run["records"], run["status"]) for run in listed
    ]


def test_words_and_conditions_select_runs(served: Served, cookie: str, two: tuple[str, str]) -> None:
    assert served.get("/api/runs?search=HL32+stroke", cookie)["found"] == 2
    assert served.get("/api/runs?search=HL32+nothing", cookie)["found"] == 0
    assert served.get("/api/runs?search=%25", cookie)["found"] == 0  # a percent sign is no wildcard
    assert served.get("/api/runs?where=records+%3C+1", cookie)["found"] == 0
    page = served.get(f"/api/runs?where=id+%3D+%27{two[0]}%27", cookie)
    assert [run["id"] for run in page["runs"]] == [two[0]]


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("1) OR (SELECT max(sql) FROM sqlite_master", "cannot be understood"),
        ("recrods > 1", "records"),
        ("status = ?", "cannot be understood"),
        ("1; DROP TABLE run", "one condition"),
        ("load_extension('x')", "cannot be understood"),
    ],
)
def test_a_condition_can_read_only_the_catalogue(where: str, said: str, served: Served) -> None:
    with pytest.raises(RigctlError, match=said):
        page_of_runs(served.project / "runs", where=where)


def test_invalid_run_ids_are_refused(served: Served, cookie: str, tmp_path: Path) -> None:
    for name in ("..", "%2e%2e", "..%5Cx", "C%3A", ".", "%00"):
        status, _, text = served.ask("GET", f"/api/runs/{name}", cookie=cookie)
        assert status in (400, 404), text
        assert str(tmp_path.parent) not in text


def test_notes_and_exclusions_are_stored_with_the_run(
    served: Served, cookie: str, two: tuple[str, str]
) -> None:
    run = two[1]
    assert served.post(f"/api/runs/{run}/notes", {"text": MARKUP}, cookie)[0] == 200
    assert served.post(f"/api/runs/{run}/exclude", {"record": 1, "reason": "air"}, cookie)[0] == 200
    status, refused = served.post(f"/api/runs/{run}/exclude", {"record": 99, "reason": "air"}, cookie)
    assert status == 400
    assert refused["error"]["expected"] == "0 to 3"
    for body in (
        {"record": 1},
        {"reason": "x"},
        {"record": True, "reason": "x"},
        {"record": "1", "reason": "x"},
    ):
        assert served.post(f"/api/runs/{run}/exclude", body, cookie)[0] == 400
    shown = served.get(f"/api/runs/{run}", cookie)
    assert [record["excluded"] for record in shown["records"]] == [None, "air", None, None]
    with chdir(served.project):
        assert "<b>worn</b>" in told("runs", "show", run)
    undone = {"record": 1, "reason": "bled", "undo": True}
    assert served.post(f"/api/runs/{run}/exclude", undone, cookie)[0] == 200
    assert served.get(f"/api/runs/{run}", cookie)["records"][1]["excluded"] is None


def test_user_text_is_shown_as_text(window: Window, cookie: str, two: tuple[str, str]) -> None:
    served = window.served
    served.post(f"/api/runs/{two[0]}/notes", {"text": MARKUP}, cookie)
    page = window.open(f"/runs?run={two[0]}")
    page.get_by_text(MARKUP).wait_for()
    assert page.title() == "Runs · rigctl"
    assert page.locator(".notes img").count() == 0


def test_two_campaigns_are_overlaid_with_their_difference(window: Window, two: tuple[str, str]) -> None:
    page = window.open("/runs")
    for run in two:
        page.get_by_label(f"Choose {run}").check()
    page.get_by_role("button", name="Compare").click()
    page.locator("#difference canvas").first.wait_for()
    assert page.locator("#difference h2").inner_text() == f"{two[1]} minus {two[0]}"
    assert page.locator("#difference .numbers tbody tr").count() == 4
    page.get_by_label("Channel").select_option("position")
    # a leak across the piston moves the rod where it rests in a run without the leak
    cells = page.locator("#difference .numbers tbody tr").first.locator("td").all_inner_texts()
    assert abs(float(cells[2])) > 0.1


def test_picked_runs_are_drawn_over_each_other(window: Window, two: tuple[str, str]) -> None:
    page = window.open("/runs")
    for run in two:
        page.get_by_label(f"Choose {run}").check()
    page.get_by_role("button", name="Overlay").click()
    panel = page.get_by_role("region", name="Runs over each other")
    panel.locator("canvas").wait_for()
    assert panel.locator(".key li").all_inner_texts() == sorted(two)
    panel.get_by_label("Plot", exact=True).select_option("position")
    panel.get_by_label("over", exact=True).select_option("")
    panel.get_by_text("position [mm] over time in the record").wait_for()
    panel.locator(".quantities span", has_text="supply pressure").drag_to(
        panel.locator(".u-over"), target_position={"x": 300, "y": 250}
    )
    panel.get_by_text("position [mm] over supply pressure [bar]").wait_for()
    panel.get_by_text("FROM samples").wait_for()


@pytest.mark.parametrize(
    ("y", "x", "kind"),
    [
        ("position", "", "curves"),
        ("position", "supply_pressure", "samples"),
        ("stroke", "supply", "records"),
        ("stroke", "", "records"),
        ("stroke", "oil_temperature", "records"),  # a value of each record over the mean of a channel
    ],
)
def test_the_command_beside_an_overlay_lists_what_is_drawn(
    served: Served, two: tuple[str, str], y: str, x: str, kind: str
) -> None:
    runs = [open_run(run, served.project / "runs") for run in two]
    shown = overlay(runs, y, x)
    assert shown["kind"] == kind
    assert {one["run"] for one in shown["series"]} == set(two)
    words = words_of(shown["command"])
    with chdir(served.project):
        listed = json.loads(told(*words[1:], "--json"))
    rows = [dict(zip(listed["columns"], row, strict=True)) for row in listed["rows"]]
    drawn = sorted(
        (round(a, 3), round(b, 3))
        for one in shown["series"]
        for a, b in zip(one["x"], one["y"], strict=True)
        if a is not None and b is not None
    )
    if kind == "records" and x:
        assert drawn == sorted((round(row[x], 3), round(row[y], 3)) for row in rows)
    else:  # thinned, or on a common grid
        low, high = min(row[y] for row in rows), max(row[y] for row in rows)
        assert min(b for _, b in drawn) >= low - 1e-3
        assert max(b for _, b in drawn) <= high + 1e-3
        assert max(b for _, b in drawn) > low + 0.8 * (high - low)


def test_an_overlay_begins_with_a_measure_over_what_was_varied(served: Served, two: tuple[str, str]) -> None:
    shown = overlay([open_run(two[0], served.project / "runs")])
    assert (shown["y"], shown["kind"]) == ("stroke", "records")
    assert shown["left_out"] == 0
    for y, says in (("strok", "did you mean 'stroke'"), ("name", "unknown quantity")):
        with pytest.raises(RigctlError, match=says):
            overlay([open_run(two[0], served.project / "runs")], y)
    with pytest.raises(RigctlError, match="1 to 8"):
        overlay([open_run(two[0], served.project / "runs")] * 9)


@pytest.mark.parametrize(("y", "x"), [("position", "supply_pressure"), ("stroke", "oil_temperature")])
def test_runs_with_other_units_are_drawn_on_one_axis(
    served: Served, two: tuple[str, str], y: str, x: str
) -> None:
    """Metres and millimetres, kelvin and degrees Celsius were drawn as the same numbers."""
    first = open_run(two[0], served.project / "runs")
    layout = first.info["layout"]
    for given, instead in (("mm", "m"), ("degC", "K"), ("bar", "Pa")):
        assert given in layout["units"]
        layout = {**layout, "units": [instead if unit == given else unit for unit in layout["units"]]}
    # without the ranges of its sensors, in which these numbers are not
    other = replace(first, info={**first.info, "id": "other", "layout": layout, "calibrations": {}})
    shown = overlay([first, other], y, x)
    units = {one["name"]: one["unit"] for one in shown["quantities"]}
    # the numbers of the copy are stored, and now said to be in other units
    scale = {"mm": (1e3, 0.0), "degC": (1.0, -273.15), "bar": (1e-5, 0.0)}
    own, converted = shown["series"]
    for axis, name in (("y", y), ("x", x)):
        factor, offset = scale[units[name]] if name in layout["channels"] else (1.0, 0.0)
        assert converted[axis] == pytest.approx([value * factor + offset for value in own[axis]], rel=1e-4)
    wrong = {**layout, "units": ["A" if unit == "K" else unit for unit in layout["units"]]}
    unlike = replace(first, info={**first.info, "id": "unlike", "layout": wrong})
    with pytest.raises(RigctlError, match="oil_temperature is another quantity in unlike"):
        overlay([first, unlike], "oil_temperature")


@pytest.mark.parametrize(
    ("y", "x"),
    [("position", ""), ("stroke", "supply"), ("stroke", "oil_temperature"), ("position", "supply_pressure")],
)
def test_the_command_beside_an_overlay_lists_usable_records_only(
    served: Served, two: tuple[str, str], tmp_path: Path, y: str, x: str
) -> None:
    """Excluded records were listed, and names that are words of SQL refused."""
    copied = tmp_path / "runs" / two[0]
    shutil.copytree(served.project / "runs" / two[0], copied)
    exclude(copied, [1], "air")
    run = open_run(two[0], tmp_path / "runs")
    sql = words_of(overlay([run], y, x)["command"])[-1]
    listed = query(sql, tmp_path / "runs")
    assert listed.columns[-1] == y
    assert {row[listed.columns.index("record")] for row in listed.rows} == {0, 2, 3}


def test_names_and_ids_are_quoted_in_the_command(served: Served, two: tuple[str, str]) -> None:
    run = open_run(two[0], served.project / "runs")
    odd = replace(run, info={**run.info, "id": "it's"})
    sql = _query([odd], ["order", 'a"b'], {}, curves=False)
    assert 'SELECT run, record, "order", "a""b" FROM records' in sql
    assert "run IN ('it''s')" in sql


def test_the_catalogue_can_be_used_with_the_keyboard_alone(window: Window, two: tuple[str, str]) -> None:
    page = window.open("/runs")
    page.get_by_label("Find").focus()
    page.keyboard.type(two[0])
    page.get_by_text("1 of 2 runs").wait_for()
    page.locator(f"tr[data-run='{two[0]}'] a").press("Enter")  # the list may be drawn anew between two steps
    page.locator("aside h2", has_text=two[0]).wait_for()
    page.go_back()
    page.get_by_text("Choose a run to see").wait_for()


def test_a_list_that_is_drawn_anew_keeps_the_focus(window: Window, two: tuple[str, str]) -> None:
    """A key that was pressed just after went nowhere."""
    page = window.open("/runs")
    link = page.locator(f"tr[data-run='{two[1]}'] a")
    link.focus()
    link.evaluate("link => link.drawn = 'before'")
    page.evaluate("document.getElementById('where').dispatchEvent(new Event('change'))")
    page.wait_for_function("id => !document.querySelector(`tr[data-run='${id}'] a`).drawn", arg=two[1])
    page.keyboard.press("Enter")
    page.locator("aside h2", has_text=two[1]).wait_for()


def test_the_list_of_runs_has_the_address_of_its_storage(tmp_path: Path) -> None:
    project = Project(tmp_path, tmp_path / "runs", store="s3://bucket/runs")
    found = Catalogue(Site(project, Jobs(tmp_path))).page(PageRequest({}, {}))
    assert (found["all"], found["store"]) == (0, "s3://bucket/runs")
