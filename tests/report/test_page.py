"""The page as a file: complete, small, escaped, and self-contained."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

import rigctl.report
from report.conftest import RunMaker
from report.made_campaign import RIG_FILE, STARTED
from rigctl.dataset import Run, RunHeader, RunWriter, Source, annotate, open_run, source_of_rig
from rigctl.errors import RigctlError
from rigctl.report import write_report
from rigctl.report.interactive_plots import embed
from rigctl.report.page import page, policy
from rigctl.report.run_data import RunData, read_run
from rigctl.report.section import Section
from rigctl.report.sections.outcome import readable, safety, statement, summarise
from rigctl.report.signals import end_to_end, overview_plot
from rigctl.report.words import WORDS, words_in
from rigctl.report.write import assemble
from rigctl.rig import load_rig

ASSETS = Path(rigctl.report.__file__).parent / "assets"
#: of plotly-basic.min.js in the npm package plotly.js-basic-dist-min
PLOTLY_4_1_1 = "99784e3abfb07b142a15e521a439e6d9addceadb3f79553fd24c72774f0649ba"
HOSTILE = '</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 2">'


class Outline(HTMLParser):
    """What elements a page has."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def outline(html: str) -> Outline:
    found = Outline()
    found.feed(html)
    return found


def html_of(*runs: RunData) -> str:
    return page(runs, assemble(runs))


def empty_run(tmp_path: Path, *, status: str = "finished", reason: str | None = None) -> Run:
    rig = load_rig(RIG_FILE)
    header = RunHeader("20261121-093000-empty", Source("empty"), source_of_rig(rig), rig.layout, STARTED)
    return open_run(RunWriter.create(tmp_path / "runs", header).close(status, reason))


def test_the_page_of_a_campaign_is_small_and_complete(published: Run, tmp_path: Path) -> None:
    written = write_report([published], tmp_path / "page.html")
    assert written.size < 6_000_000
    text = written.page.read_text(encoding="utf-8")
    for part in ("stroke campaign", "HL32 bench", "Ada", "rigfw 1.2", "2026-11-21", "All 28 records"):
        assert part in text
    assert "65\N{NARROW NO-BREAK SPACE}100" in text


def test_the_page_loads_nothing_from_outside(published_data: RunData) -> None:
    html = html_of(published_data)
    for tag, attributes in outline(html).tags:
        assert "src" not in attributes or tag == "img", (tag, attributes)
        assert tag not in ("link", "iframe", "object", "img")
        assert not (attributes.get("href") or "#").startswith("http")
    stated = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert stated is not None
    assert "default-src &#39;none&#39;" in stated.group(1)
    assert "http" not in stated.group(1)
    assert "unsafe-eval" not in stated.group(1)


def test_the_content_security_policy_has_the_digest_of_each_script() -> None:
    # the digest of an empty script, as browsers compute it
    stated = {one.split()[0]: one.split()[1:] for one in policy([""]).split("; ")}
    assert stated["script-src"] == ["'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"]  # and no other
    assert stated["default-src"] == ["'none'"]


def test_the_plotting_library_is_the_published_version() -> None:
    bundle = (ASSETS / "plotly-basic.min.js").read_text(encoding="utf-8").encode("utf-8")
    assert sha256(bundle).hexdigest() == PLOTLY_4_1_1
    assert (ASSETS / "LICENSE-plotly").read_text(encoding="utf-8").startswith("MIT License")


def test_hostile_texts_are_escaped(make_run: RunMaker) -> None:
    made = make_run(
        temperatures=(20.0, 30.0),
        pressures=(30.0,),
        idle_rows=2,
        name=HOSTILE,
        record=HOSTILE,
        operator=HOSTILE,
        facts={"versions": {HOSTILE: HOSTILE}, "arguments": {HOSTILE: HOSTILE}},
    )
    annotate(made.folder, HOSTILE)
    data = read_run(open_run(made.folder))
    sweep = {HOSTILE: (1.0, "1"), **data.records[0].sweep}
    alarm = replace(data.events[0], kind="alarm", message=HOSTILE, path=HOSTILE)
    data = replace(
        data,
        records=(replace(data.records[0], sweep=sweep, excluded=HOSTILE), *data.records[1:]),
        events=(*data.events, alarm),
        info={**data.info, "reason": HOSTILE, "status": "failed"},
    )
    html = html_of(data)
    plain = html_of(replace(data, events=()))
    scripts = [attributes for tag, attributes in outline(html).tags if tag == "script"]
    assert [attributes for attributes in scripts if "type" not in attributes] == [{}, {}]
    assert "<img" not in html.replace("&lt;img", "")
    assert html.count("</script>") == len(scripts)
    assert "<script>window" not in plain


@pytest.mark.parametrize("text", ["</script>", "<!--", "]]>", "a & b", "\u2028\u2029", 'quote " and \\'])
def test_json_in_the_page_cannot_end_its_element(text: str) -> None:
    embedded = embed({"name": text})
    assert json.loads(embedded) == {"name": text}
    assert not set("<>&\u2028\u2029") & set(embedded)


def test_a_million_samples_make_a_page_of_a_few_megabytes(tmp_path: Path) -> None:
    rig = load_rig(RIG_FILE)
    header = RunHeader("20261121-093000-long", Source("long"), source_of_rig(rig), rig.layout, STARTED)
    writer = RunWriter.create(tmp_path / "runs", header)
    count = 1_000_000
    rows = np.zeros((count, len(rig.layout.columns)))
    rows[:, 0] = np.arange(count) / 1000.0
    rows[:, 2] = 300.0 + np.sin(rows[:, 0])
    rows[654_321, 4] = 0.123  # one spike in a million
    rows[:, 1] = writer.open_record(0.0, "endurance", {}, "1/record", 1000.0)
    writer.append_block(rows)
    writer.close_record(1000.0, "complete")
    run = open_run(writer.close("finished"))
    data = read_run(run)
    sections = assemble([data])
    assert len(page([data], sections).encode("utf-8")) < 3_000_000
    for section in sections:
        for plot in section.plots:
            position = next(t for panel in plot.panels for t in panel.traces if t.name == "position")
            assert position.y.max() == pytest.approx(123.0)


def test_a_page_of_thousands_of_records_is_limited_in_size(published_data: RunData) -> None:
    records = tuple(replace(published_data.records[i % 28], index=i) for i in range(3000))
    html = html_of(replace(published_data, records=records))
    assert len(html) < 6_000_000
    assert "2000 more are in the run" in html


@pytest.mark.parametrize(
    ("status", "reason", "said"),
    [
        ("finished", None, "The run finished. Nothing was recorded."),
        ("failed", "heat timed out at 38.2 °C.", "The run failed: heat timed out at 38.2 °C. Nothing"),
        ("aborted", "Ctrl-C", "The run was aborted: Ctrl-C. Nothing was recorded."),
    ],
)
def test_a_run_without_a_sample_has_a_page(
    tmp_path: Path, status: str, reason: str | None, said: str
) -> None:
    html = html_of(read_run(empty_run(tmp_path, status=status, reason=reason)))
    assert said in html
    assert 'id="records"' not in html


@pytest.mark.parametrize(
    ("reason", "said"),
    [
        ("procedures/stroke.yaml:15:5: the rod is loose.", "the rod is loose (stroke.yaml, line 15)"),
        (r"C:\bench\stroke.yaml:15: late", "late (stroke.yaml, line 15)"),
        ("ended by SIGINT", "ended by SIGINT"),
        ("", ""),
    ],
)
def test_the_reason_of_a_failure_is_printed_before_its_place(reason: str, said: str) -> None:
    assert readable(reason) == said


def test_an_aborted_run_reports_its_complete_records(published_data: RunData) -> None:
    info = {**published_data.info, "status": "aborted", "reason": "ended by SIGINT"}
    said = statement(replace(published_data, info=info, records=published_data.records[:5]))
    assert said.startswith("The run was aborted: ended by SIGINT. 5 records were complete by then")


def test_alarms_are_shown_first(published_data: RunData) -> None:
    alarm = replace(published_data.events[0], kind="alarm", time=500.0, message="Oil over-temperature")
    html = html_of(replace(published_data, events=(*published_data.events, alarm)))
    assert "1 alarm or fault occurred" in html
    events = html[html.index('<section id="events">') :]
    assert events.index("Oil over-temperature") < events.index("idle → arming")


def test_missed_limits_and_failed_records_are_counted(published_data: RunData) -> None:
    first = published_data.records[0]
    measures = (replace(first.measures[0], passed=False),)
    records = (replace(first, measures=measures), *published_data.records[1:])
    html = html_of(replace(published_data, records=records))
    assert "1 of 28 measured values lies outside its limits" in html
    records = (replace(first, outcome="timed_out"), *published_data.records[1:])
    html = html_of(replace(published_data, records=records))
    assert "27 of 28 records are complete" in html
    assert "timed out" in html


@pytest.mark.parametrize(
    ("status", "unconfirmed", "said"),
    [
        ("failed", None, "Safe: every output was put into its safe state"),
        ("failed", "heater", "Not confirmed safe: heater may still be on"),
        ("finished", "heater", "Not confirmed safe: heater may still be on"),
        ("interrupted", None, "The final state of the outputs was not recorded"),
        ("finished", None, ""),
        ("running", None, ""),
    ],
)
def test_an_aborted_run_reports_whether_outputs_are_safe(
    published_data: RunData, status: str, unconfirmed: str | None, said: str
) -> None:
    info = {**published_data.info, "status": status, "unconfirmed": unconfirmed, "reason": "late"}
    data = replace(published_data, info=info)
    assert safety(data).startswith(said)
    assert bool(said) == bool(safety(data))
    first = assemble([data])[0]
    assert safety(data) in str(first.body)


def test_records_with_restarting_times_are_drawn_side_by_side(published_data: RunData) -> None:
    """Every record of an imported log may begin at 0 s."""
    first, second = (record.rows for record in published_data.records[:2])
    rows = np.r_[first, second]
    count = first.stop - first.start
    time = np.concatenate(
        [published_data.time[part] - published_data.time[part.start] for part in (first, second)]
    )
    records = tuple(
        replace(record, start=0.0, end=float(time[-1]), rows=slice(place * count, (place + 1) * count))
        for place, record in enumerate(published_data.records[:2])
    )
    signals = {name: replace(one, values=one.values[rows]) for name, one in published_data.signals.items()}
    data = replace(published_data, time=time, records=records, signals=signals)
    plot = overview_plot(data, points=10_000, key="o")
    assert plot.x_title == "the records one after the other [s]"
    for panel in plot.panels:
        for trace in panel.traces:
            assert np.all(np.diff(trace.x) > 0.0)
    assert plot.spans[0].end < plot.spans[1].start
    assert dict(summarise(data).figures)["duration"] == "7.49\N{NO-BREAK SPACE}s"
    assert not end_to_end(published_data)[1].any()


def test_simulated_data_is_labelled(published_data: RunData) -> None:
    assert summarise(published_data).badge is None
    info = {**published_data.info, "backend": {"kind": "simulated"}}
    assert ">simulated bench</span>" in html_of(replace(published_data, info=info))


def test_imported_data_without_a_rig_file_has_a_page(published_data: RunData) -> None:
    info = {**published_data.info, "source": "import", "rig": {"name": "", "text": ""}, "backend": {}}
    html = html_of(replace(published_data, info=info, rig=None))
    assert "The data was imported. All 28 records are complete" in html


def test_several_runs_share_a_page(make_run: RunMaker) -> None:
    runs = [read_run(make_run(temperatures=(20.0, 30.0), idle_rows=2, seed=seed)) for seed in (1, 2)]
    html = html_of(*runs)
    assert "2 runs on HL32 bench" in html
    assert html.count("<optgroup") == 4
    assert 'data-record="r0-0"' in html
    assert 'data-record="r1-7"' in html
    ids = [attributes["id"] for _, attributes in outline(html).tags if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_equal_runs_give_equal_pages(published_data: RunData) -> None:
    when = datetime(2026, 11, 21, tzinfo=UTC)
    sections = assemble([published_data])
    assert page([published_data], sections, when) == page([published_data], assemble([published_data]), when)


def test_other_modules_can_add_sections(published_data: RunData) -> None:
    added = Section("comparison", "Model against measurement", Markup("<p>It fits.</p>"))
    order = [section.id for section in assemble([published_data], [added])]
    assert order[:4] == ["comparison", "outcome", "campaign", "records"]


def test_the_evidence_is_folded_unless_the_run_failed(published_data: RunData) -> None:
    added = Section("comparison", "Model against measurement", Markup("<p>It fits.</p>"))
    assert {one.id for one in assemble([published_data]) if one.folded} == {
        *("measures", "overview", "events", "provenance")
    }
    assert [one.id for one in assemble([published_data], [added]) if not one.folded] == ["comparison"]
    failed = replace(published_data, info={**published_data.info, "status": "failed"})
    sections = assemble([failed], [added])
    assert [one.id for one in sections if not one.folded] == ["outcome", "comparison"]
    assert sections[0].id == "outcome"


def test_an_unwritable_path_is_reported(make_run: RunMaker, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    run = make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2)
    with pytest.raises(RigctlError, match="a file is there; expected the name of a folder"):
        write_report([run], tmp_path / "file" / "page.html")


def test_an_old_page_is_replaced_without_leftovers(make_run: RunMaker, tmp_path: Path) -> None:
    target = tmp_path / "out" / "page.html"
    target.parent.mkdir()
    target.write_text('<!DOCTYPE html><meta name="generator" content="rigctl 0.0">', encoding="utf-8")
    write_report([make_run(temperatures=(20.0,), pressures=(30.0,), idle_rows=2)], target)
    assert target.stat().st_size > 100_000
    assert [entry.name for entry in target.parent.iterdir()] == ["page.html"]


def test_a_report_without_runs_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="at least one run"):
        write_report([], tmp_path / "page.html")


def test_the_glossary_has_every_word_that_a_page_explains() -> None:
    glossary = (Path(__file__).parents[2] / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
    for word, meaning in WORDS.items():
        assert f"| {word} | {meaning} |" in glossary


def test_a_page_explains_only_the_words_that_it_uses() -> None:
    found = words_in("<p class='sigma'>3.2 times as strong as chance (p = 0.2), R² 99 %, mBICs</p>")
    assert list(found) == ["times as strong as chance", "R²", "p", "mBIC"]
    assert list(words_in("<p>too much for chance (p &lt; 1e-6)</p>")) == ["p"]
    assert not words_in(
        "<p>nothing</p><script>const noise = 1; if (p < 2) sigma();</script><style>.slot {}</style>"
    )
