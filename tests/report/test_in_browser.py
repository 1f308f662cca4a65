"""The page in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from markupsafe import Markup

from made_fit import made_fit, made_noise
from report.browser import Browser
from report.conftest import RunMaker
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.blocks import Answer
from rigctl.dataset import Run
from rigctl.report import write_report
from rigctl.report.analysis.maps import channel_maps
from rigctl.report.analysis.page_top import NamedModels, answer_section
from rigctl.report.heat_map import heat_map_table
from rigctl.report.page import page
from rigctl.report.run_data import read_run
from rigctl.report.section import Section
from rigctl.report.write import assemble

HOSTILE = '</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 2">'
ALL_DRAWN = "[...document.querySelectorAll('.plot')].every(p => p.querySelector('.main-svg'))"
UNFOLD = "document.querySelectorAll('details.fold').forEach(one => { one.open = true; })"
RECORD_DRAWN = "document.querySelector('#record-plot .main-svg')"
POSITIONS = "document.getElementById('record-plot').data[0].y"


@pytest.fixture(scope="module")
def campaign_page(published: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report([published], tmp_path_factory.mktemp("page") / "page.html").page


@pytest.fixture
def quiet(browser: Browser) -> Iterator[Browser]:
    """The browser; the page must cause no console message and request nothing but itself."""
    yield browser
    assert browser.complaints == []
    assert [url for url in browser.requests if not url.startswith(("file:", "blob:", "data:"))] == []
    assert len([url for url in browser.requests if url.startswith("file:")]) == 1


def show_records(browser: Browser) -> None:
    browser.evaluate("document.getElementById('records').scrollIntoView({behavior: 'instant'})")
    assert browser.wait(RECORD_DRAWN)


def pick(browser: Browser, name: str, key: str) -> None:
    """Choose from a list, as a person would."""
    browser.evaluate(f"document.getElementById('{name}').value = '{key}'")
    browser.evaluate(f"document.getElementById('{name}').dispatchEvent(new Event('change'))")


def test_every_plot_is_drawn_with_its_data(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page, height=9000)
    quiet.evaluate(UNFOLD)
    assert quiet.wait(ALL_DRAWN)
    assert quiet.evaluate("document.querySelectorAll('.plot .main-svg').length") > 0
    drawn = "document.querySelectorAll('#response-0 .scatterlayer .trace').length"
    assert quiet.evaluate(drawn) == 4  # one line per pressure
    point = "Array.from(document.getElementById('response-0').data[2].y)[4]"
    assert quiet.evaluate(point) == pytest.approx(93.5, abs=0.1)


def test_plots_below_the_window_wait_until_they_are_reached(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page, height=500)
    assert quiet.wait("document.querySelector('#response-0 .main-svg')")
    assert not quiet.evaluate(f"!!({RECORD_DRAWN})")
    show_records(quiet)


def test_a_record_can_be_chosen_by_list_row_key_and_link(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page)
    show_records(quiet)
    title = "document.getElementById('record-title').textContent"
    peak = f"Math.max(...{POSITIONS})"
    assert quiet.evaluate(title) == "0 · stroke · oil 20 °C, supply 20 bar"
    assert quiet.evaluate(peak) == pytest.approx(77.0, abs=0.6)
    pick(quiet, "record-chosen", "r0-3")
    assert quiet.evaluate(title).startswith("3 · stroke")
    assert quiet.evaluate(peak) == pytest.approx(125.0, abs=0.6)
    quiet.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}))")
    assert quiet.evaluate(title).startswith("4 · stroke")
    quiet.evaluate("document.querySelector('[data-choose=\"r0-7\"]').click()")
    assert quiet.evaluate(title).startswith("7 · stroke")
    quiet.evaluate("location.hash = '#records/r0-27'")
    assert quiet.wait(f"{title}.startsWith('27 · stroke')")
    assert quiet.evaluate("document.querySelector('tr.chosen').dataset.choose") == "r0-27"
    quiet.evaluate("document.getElementById('record-next').click()")  # there is no record after the last
    assert quiet.evaluate(title).startswith("27 · stroke")


def test_a_second_record_is_laid_over_the_first(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page)
    show_records(quiet)
    before = quiet.evaluate("document.getElementById('record-plot').data.length")
    pick(quiet, "record-other", "r0-16")
    assert quiet.evaluate("document.getElementById('record-plot').data.length") == 2 * before
    assert "dashed: 16 · stroke" in quiet.evaluate("document.getElementById('record-title').textContent")


def test_records_of_different_benches_share_the_axes_of_common_channels(
    quiet: Browser, make_run: RunMaker, tmp_path: Path
) -> None:
    first = read_run(make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2))
    second = read_run(make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2, seed=2))
    flow = replace(second.signals["position"], name="flow", unit="l/min")
    second = replace(second, signals={"flow": flow, **second.signals})
    target = tmp_path / "page.html"
    target.write_text(page([first, second], assemble([first, second])), encoding="utf-8", newline="\n")
    quiet.open(target)
    show_records(quiet)
    pick(quiet, "record-other", "r1-0")
    traces = quiet.evaluate("document.getElementById('record-plot').data.map(t => [t.name, t.yaxis])")
    assert "flow (compared)" not in [name for name, _ in traces]
    axes = dict(traces)
    for name in ("position", "supply pressure", "valve"):
        assert axes[f"{name} (compared)"] == axes[name]


def test_records_share_their_scales_until_the_reader_changes_it(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page)
    show_records(quiet)
    top = "document.getElementById('record-plot')._fullLayout.yaxis.range[1]"
    assert quiet.evaluate(top) > 125.0
    quiet.evaluate("document.getElementById('record-scales').click()")
    assert quiet.wait(f"{top} < 90")


def test_the_page_follows_the_reader_s_dark_mode(quiet: Browser, campaign_page: Path) -> None:
    colour = "document.getElementById('response-0')._fullLayout.font.color"
    seen = []
    for dark in (False, True):
        quiet.open(campaign_page, dark=dark)
        assert quiet.wait("document.querySelector('#response-0 .main-svg')")
        seen.append(quiet.evaluate(colour))
    assert seen[0] != seen[1]


def test_every_plot_is_printed(quiet: Browser, campaign_page: Path, tmp_path: Path) -> None:
    quiet.open(campaign_page, height=500, dark=True)
    assert quiet.wait("document.querySelector('#response-0 .main-svg')")
    quiet.pdf(tmp_path / "page.pdf")
    assert quiet.evaluate(ALL_DRAWN)
    assert (tmp_path / "page.pdf").stat().st_size > 100_000


def test_a_link_opens_its_folded_section(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page)
    opened = "document.querySelector('#overview > details').open"
    assert not quiet.evaluate(opened)
    quiet.evaluate("document.querySelector('nav a[href=\"#overview\"]').click()")
    assert quiet.wait(opened)
    assert quiet.wait("document.querySelector('#overview .main-svg')")


def test_a_narrow_screen_does_not_scroll_sideways(quiet: Browser, campaign_page: Path) -> None:
    quiet.open(campaign_page, width=400, height=9000)
    quiet.evaluate(UNFOLD)
    assert quiet.wait(ALL_DRAWN)
    assert quiet.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


@pytest.fixture(scope="module")
def answer_page(published: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with an answer: the fall of an error, an overlay, maps, a wide table."""
    off = made_fit(made_noise(), 3, lambda place, times: 0.1 * np.sin(times / 9.0))
    after = replace(off, outputs=tuple(one - [[0.0, 0.01]] for one in off.outputs))
    answer = Answer("warn", "An effect is missing", "something is there", (("how sure", "very"),))
    top = answer_section(
        answer, NamedModels(("before", "after"), (after, off), ({}, {"position": 20.0})), about="own.yaml"
    )
    maps = channel_maps(cast("ModelComparison", SimpleNamespace(fit=off)), "map")
    body = Markup().join(heat_map_table(one) for one in maps)
    where = Section("where", "Where it fails", body, folded=True, hint="maps")
    return write_report(
        [published], tmp_path_factory.mktemp("answer") / "page.html", sections=[top, where]
    ).page


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (420, True)])
@pytest.mark.parametrize("which", ["campaign_page", "answer_page"])
def test_the_page_is_accessible(
    quiet: Browser, request: pytest.FixtureRequest, which: str, width: int, dark: bool
) -> None:
    """By axe-core: names, roles, contrast, regions that keys can scroll."""
    quiet.open(request.getfixturevalue(which), width=width, height=9000, dark=dark)
    quiet.evaluate(UNFOLD)
    assert quiet.wait(ALL_DRAWN)
    assert quiet.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    axe = files("axe_playwright_python") / "axe.min.js"
    quiet.evaluate(axe.read_text(encoding="utf-8") + "; 0")
    quiet.evaluate("axe.run({resultTypes: ['violations']}).then(found => { window.found = found; }); 0")
    assert quiet.wait("window.found")
    serious = "found.violations.filter(one => ['serious', 'critical'].includes(one.impact))"
    assert quiet.evaluate(f"{serious}.map(one => one.id + ': ' + one.nodes[0].html.slice(0, 200))") == []


def test_hostile_texts_are_shown_and_do_nothing(quiet: Browser, make_run: RunMaker, tmp_path: Path) -> None:
    made = make_run(
        temperatures=(20.0, 30.0),
        pressures=(30.0, 40.0),
        idle_rows=2,
        name=HOSTILE,
        record=HOSTILE,
        operator=HOSTILE,
    )
    data = read_run(made)
    alarm = replace(
        data.events[0], kind="alarm", time=3.0, message=HOSTILE + "<a href='https://example.org'>x</a>"
    )
    odd = {HOSTILE: (1.0, "1")}
    records = tuple(replace(record, sweep={**record.sweep, **odd}) for record in data.records)
    data = replace(data, events=(*data.events, alarm), records=records)
    target = tmp_path / "page.html"
    target.write_text(page([data], assemble([data])), encoding="utf-8", newline="\n")
    quiet.open(target, height=9000)
    quiet.evaluate(UNFOLD)
    assert quiet.wait(ALL_DRAWN)
    assert quiet.evaluate("window.hacked === undefined")
    assert quiet.evaluate("document.querySelector('h1').textContent") == HOSTILE
    assert quiet.evaluate("document.querySelectorAll('img, .plot a').length") == 0
    legend = "document.querySelector('#response-0 .legendtext').textContent"
    assert HOSTILE in quiet.evaluate(legend)


def test_unescaped_markup_is_blocked_by_the_policy(
    browser: Browser, campaign_page: Path, tmp_path: Path
) -> None:
    """The content security policy protects even a page in which escaping was forgotten."""
    broken = tmp_path / "broken.html"
    text = campaign_page.read_text(encoding="utf-8")
    broken.write_text(text.replace("<main>", f"<main>{HOSTILE}"), encoding="utf-8", newline="\n")
    browser.open(broken)
    assert browser.wait("document.querySelector('#response-0 .main-svg')")
    assert browser.evaluate("window.hacked === undefined")
    assert any("Content Security Policy" in complaint for complaint in browser.complaints)


def test_missing_values_leave_gaps(quiet: Browser, make_run: RunMaker, tmp_path: Path) -> None:
    data = read_run(make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2))
    position = data.signals["position"].values.copy()
    position[100:110] = float("nan")
    signals = {**data.signals, "position": replace(data.signals["position"], values=position)}
    data = replace(data, signals=signals)
    target = tmp_path / "page.html"
    target.write_text(page([data], assemble([data])), encoding="utf-8", newline="\n")
    quiet.open(target, height=9000)
    quiet.evaluate(UNFOLD)
    assert quiet.wait(ALL_DRAWN)
    assert quiet.evaluate(f"{POSITIONS}.filter(Number.isNaN).length") == 10
