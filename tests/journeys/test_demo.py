"""The first thing a new user types, from an empty folder to a model that agrees, and a page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rigctl
from commands import answer
from rigctl.cli.commands.init import create_project

#: mm at 20 degC and 20, 30, 40, 50 bar, from an independent calculation; longer by so much when warm
PUBLISHED = {20.0: 77.4, 30.0: 94.9, 40.0: 109.6, 50.0: 122.6}
GROWTH = {20.0: 1.0, 60.0: 1.014, 80.0: 1.022}
#: enough of the campaign for a class of several effects, in nine records instead of 28; test_learn.py uses
#: the same bench and data, and reuses these fits
SHORT = {"temperatures": "20 degC, 60 degC, 80 degC", "pressures": "20 bar, 35 bar, 50 bar"}


def test_the_plain_demo_ends_with_a_page_of_the_published_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    told = answer("demo", "first", "--plain")
    page = Path(told["page"]).read_text(encoding="utf-8")
    assert page.count("<html") == 1
    assert len(page) < 6e6

    run = rigctl.open_run(told["run"], Path("first/runs"))
    records = run.records
    assert len(records) == 28
    assert set(records["outcome"]) == {"complete"}
    for _, record in records.iterrows():
        if record["oil"] in GROWTH:
            expected = PUBLISHED[record["supply"]] * GROWTH[record["oil"]]
            assert record["stroke"] == pytest.approx(expected, abs=1.0)


@pytest.mark.usefixtures("small_search")
def test_the_demo_identifies_the_hidden_effect_and_adds_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The campaign leaves a class of effects; the designed records single out the hidden one."""
    monkeypatch.chdir(tmp_path)
    create_project(Path("whole"))
    shorten(Path("whole/procedures/campaign.yaml"))
    told = answer("demo", "whole")
    assert told["verdict"] == "ambiguous"
    (left,) = told["classes"]
    assert told["hidden"] in left
    assert len(left) > 1
    learned = told["learned"]
    assert learned["ended"] == "adequate"
    assert learned["added"] == [told["hidden"]]
    designed = learned["rounds"][1]
    assert designed["promised"]["probability"] > 0.5
    assert designed["came_out"]["told_apart"]
    assert Path(told["model"]) == Path("whole/models/hl32-demo.yaml")

    history = answer("model", "history", told["model"])
    assert [version["kind"] for version in history["versions"]] == ["start", "add"]
    page = Path(told["page"]).read_text(encoding="utf-8")
    assert page.count("<html") == 1
    assert "<h1>hl32-demo.yaml, version 2</h1>" in page
    for words in ("predicted and achieved", "How the systematic error falls", "position, version 1"):
        assert words in page
    assert f"{told['run']} agrees" not in page  # a model is never called by a run
    end = page[page.index('<section id="hidden">') :]
    assert f"hidden: {told['hidden'].replace('_', ' ')}, conductance" in end
    assert f"found: {told['hidden'].replace('_', ' ')}, conductance (" in end
    assert end.count("<section") == 1
    # the size found is the same number at the top and at the end
    (size,) = re.findall(r"found: .*?conductance (\(.*? m³)", end)
    assert size in page[page.index('<section id="answer">') : page.index('<section id="learning"')]


def shorten(campaign: Path) -> None:
    """Give the arguments of a procedure file the values of `SHORT`."""
    text = campaign.read_text(encoding="utf-8")
    for name, values in SHORT.items():
        text, found = re.subn(rf"({name}:.*?\[)[^\]]*", rf"\g<1>{values}", text, count=1, flags=re.DOTALL)
        assert found == 1
    campaign.write_text(text, encoding="utf-8", newline="\n")


def test_demo_again_makes_another_run_and_overwrites_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first, second = (answer("demo", "d", "--plain", "--seed", "5") for _ in range(2))
    assert first["run"] != second["run"]
    samples = [Path("d/runs", told["run"], "samples.parquet").read_bytes() for told in (first, second)]
    assert samples[0] == samples[1], "one seed gives one set of samples, byte for byte"
