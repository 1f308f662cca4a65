"""The first thing a new user types, from an empty folder to a model that agrees, and a page."""

from __future__ import annotations

import re
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

import rigctl
from commands import answer

#: mm at 20 degC and 20, 30, 40, 50 bar, from an independent calculation; longer by so much when warm
PUBLISHED = {20.0: 77.4, 30.0: 94.9, 40.0: 109.6, 50.0: 122.6}
GROWTH = {20.0: 1.0, 60.0: 1.014, 80.0: 1.022}
#: the explanations of the published strokes
RIVALS = {
    "relief_thermal_drift",
    "position_thermal_drift",
    "valve_delay_thermal",
    "flow_area_thermal_drift",
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder in which the plain demo was called, and its answer."""
    folder = tmp_path_factory.mktemp("plain")
    with chdir(folder):
        return folder, answer("demo", "first", "--plain")


def test_the_plain_demo_ends_with_a_page_of_the_published_campaign(
    plain: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, done = plain
    monkeypatch.chdir(folder)
    page = Path(done["page"]).read_text(encoding="utf-8")
    assert page.count("<html") == 1
    assert len(page) < 6e6

    run = rigctl.open_run(done["run"], Path("first/runs"))
    records = run.records
    assert len(records) == 28
    assert set(records["outcome"]) == {"complete"}
    for _, record in records.iterrows():
        if record["oil"] in GROWTH:
            expected = PUBLISHED[record["supply"]] * GROWTH[record["oil"]]
            assert record["stroke"] == pytest.approx(expected, abs=1.0)


def test_the_demo_tells_the_published_story(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stroke falls, the textbook says it rises; eight published strokes leave four explanations open;
    strokes over time single out the hidden one, which predicts a temperature that no fit saw."""
    monkeypatch.chdir(tmp_path)
    done = answer("demo", "whole")
    question = done["question"]
    assert question["verdict"] == "ambiguous"
    assert set(question["classes"][0]) == RIVALS
    assert any(done["hidden"] in step and "over time" in step for step in question["next_steps"])

    run = rigctl.open_run(done["run"], Path("whole/runs"))
    strokes = run.records.set_index(["oil", "supply"])["stroke"]
    for supply in (20.0, 50.0):
        assert 3.0 < strokes[20.0, supply] - strokes[60.0, supply] < 7.0  # the published loss: 3.7 to 6.5 mm
    assert done["verdict"] == "missing_effect"
    assert done["effects"] == [done["hidden"]]
    assert done["improved"]["ended"] == "adequate"
    assert Path(done["model"]) == Path("whole/models/hl32-demo.yaml")
    history = answer("model", "history", done["model"])
    assert [version["kind"] for version in history["versions"]] == ["start", "add"]

    page = Path("whole/hl32-demo.html").read_text(encoding="utf-8")
    assert page.count("<html") == 1
    assert "<h1>hl32-demo.yaml, version 2</h1>" in page
    top = page[page.index('<section id="improvement">') : page.index('<section id="question">')]
    assert re.search(r"Wrong direction: measured stroke falls \d.*?, the model says it rises \d", top)
    ((before, after),) = re.findall(r"that no fit saw: ([\d.]+) mm before, ([\d.]+) mm after", top)
    assert float(before) > 3.0
    assert float(after) < 0.3
    assert top.index("version 1 (dotted)") < top.index("Added valve delay thermal")
    end = page[page.index('<section id="hidden">') :]
    assert "hidden: valve delay thermal, coefficient" in end
    assert "found: valve delay thermal, coefficient" in end


def test_demo_again_makes_another_run_and_overwrites_nothing(
    plain: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, first = plain
    monkeypatch.chdir(folder)
    second = answer("demo", "first", "--plain")
    assert first["run"] != second["run"]
    samples = [Path("first/runs", done["run"], "samples.parquet").read_bytes() for done in (first, second)]
    assert samples[0] == samples[1], "one seed gives one set of samples, byte for byte"
