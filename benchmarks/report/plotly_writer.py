"""The usual approach: one plotly figure per record and one of the whole run, written by ``to_html``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl.dataset import Run


def write_page(run: Run, page: Path) -> int:
    """Write the same samples as our page, without decimation; return the number of bytes."""
    samples = run.samples()
    parts = [_figure(run, samples[samples["record"] == index]) for index in range(run.info["records"])]
    parts.append(_figure(run, samples))
    html = [
        figure.to_html(full_html=False, include_plotlyjs=number == 0) for number, figure in enumerate(parts)
    ]
    page.write_text("<!DOCTYPE html><body>" + "\n".join(html), encoding="utf-8", newline="\n")
    return page.stat().st_size


def _figure(run: Run, samples: Any) -> Any:
    from plotly.subplots import make_subplots

    names = run.layout.signals
    figure = make_subplots(rows=len(names), cols=1, shared_xaxes=True)
    for row, name in enumerate(names, start=1):
        figure.add_scatter(x=samples["time"], y=samples[name], name=name, row=row, col=1)
    return figure
