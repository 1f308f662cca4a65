"""Plots as files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from report.conftest import RunMaker
from rigctl.report import write_report
from rigctl.report.figure_files import FORMATS, write_figure
from rigctl.report.plot import Look, Mark, Panel, Plot, Span, Trace
from rigctl.report.run_data import RunData
from rigctl.report.signals import overview_plot

X = np.linspace(0.0, 1.0, 11)
PLOT = Plot(
    "odd",
    "a $dollar$ and <b>",
    "x [s]",
    (
        Panel(
            "y [$]",
            (Trace("up", X, X), Trace("down", X, -X, Look.STEP, 1), Trace("dots", X, X, Look.POINTS, 2)),
        ),
        Panel(
            "empty",
            (Trace("none", X, np.full_like(X, np.nan), Look.MARKED),),
            0.5,
            (-1.0, 1.0),
            ((0.0, "off"),),
        ),
    ),
    (Span(0.2, 0.4),),
    (Mark(0.5, "alarm"),),
)


def test_a_logarithmic_axis_has_plain_numbers(tmp_path: Path) -> None:
    x = np.geomspace(0.01, 10.0, 20)
    plot = Plot("bode", "of x", "f [Hz]", (Panel("y", (Trace("", x, x),)),), log_x=True)
    texts = [one.text for one in ET.parse(write_figure(plot, tmp_path, "svg")).iter() if one.text]
    assert {"0.01", "0.1", "1", "10"} <= set(texts)
    assert not [text for text in texts if "math" in text]


@pytest.mark.parametrize("form", FORMATS)
def test_a_plot_is_drawn_into_a_file(tmp_path: Path, form: str) -> None:
    path = write_figure(PLOT, tmp_path / "figures", form)
    content = path.read_bytes()
    assert path.name == f"odd.{form}"
    assert content.startswith(b"\x89PNG" if form == "png" else b"<?xml")
    assert write_figure(PLOT, tmp_path / "again", form).read_bytes() == content


def test_svg_figures_contain_their_text(tmp_path: Path) -> None:
    tree = ET.parse(write_figure(PLOT, tmp_path, "svg"))
    texts = {"".join(element.itertext()).strip() for element in tree.iter("{http://www.w3.org/2000/svg}text")}
    assert {"a $dollar$ and <b>", "y [$]", "x [s]", "off"} <= texts


def test_every_plot_of_a_report_is_written_as_a_figure(make_run: RunMaker, tmp_path: Path) -> None:
    run = make_run(temperatures=(20.0, 30.0), pressures=(30.0,), idle_rows=5, measure=False)
    written = write_report([run], tmp_path / "page.html", figures=tmp_path / "figures", form="svg")
    names = [path.name for path in written.figures]
    assert names == ["response-0.svg", "record-r0-0.svg", "record-r0-1.svg", "overview-0.svg"]
    assert all(path.stat().st_size > 5_000 for path in written.figures)


def test_the_overview_shades_records_and_marks_alarms(published_data: RunData) -> None:
    alarm = replace(published_data.events[0], kind="alarm", time=120.0, message="Oil over-temperature")
    plot = overview_plot(replace(published_data, events=(alarm,)), points=500, key="overview")
    assert len(plot.spans) == 28
    assert [(mark.x, mark.label) for mark in plot.marks] == [(2.0, "Oil over-temperature")]
    assert plot.x_title.endswith("[min]")
    assert [panel.title for panel in plot.panels] == [
        "position [mm]",
        "pressure [bar]",
        "temperature [°C]",
        "commands",
    ]
