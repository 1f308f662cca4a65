"""Plots for plotly.js; numbers are base64 of 32-bit floats, which a browser decodes quickly.

In: a `Plot`, which knows nothing of plotly. Out: plain data for JSON, in two parts: a template with axes,
colours and names, and the arrays of its traces. Records with the same signals differ in their arrays
only, so that a page has one template for all of them; times that traces share are contained once.

The texts come from users' files, and the JSON is inside a script element. `embed` replaces the characters
that could end it, and every text is escaped, because plotly.js takes some HTML in texts for markup.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rigctl.report import colours
from rigctl.report.plot import MARKERS, Look, Mark, Panel, Plot, Span, Trace

_PANEL_PIXELS = 168
_GAP_PIXELS = 16
_MARGINS = {"l": 78, "r": 18, "t": 34, "b": 46}
#: characters that could end the script element with the JSON, or start a comment in it
_UNSAFE = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def figure(plot: Plot) -> dict[str, Any]:
    """A complete plot: ``data``, ``layout``, and the required height in pixels."""
    return {**template(plot), "arrays": arrays(plot)}


def template(plot: Plot) -> dict[str, Any]:
    """A plot without its numbers, which records with the same signals have in common."""
    height = _height(plot.panels)
    data = [
        {**_style(trace), "xaxis": "x", "yaxis": _axis("y", number)}
        for number, panel in enumerate(plot.panels)
        for trace in panel.traces
    ]
    return {"data": data, "layout": _layout(plot, height), "height": height}


def arrays(plot: Plot) -> dict[str, list[str | int]]:
    """The numbers of every trace in the order of ``data``: ``x``, ``y``.

    An x that occurred before is given as its index in the list.
    """
    xs: list[str | int] = []
    indices: dict[int, int] = {}
    for trace in (trace for panel in plot.panels for trace in panel.traces):
        first = indices.setdefault(id(trace.x), len(xs))
        xs.append(encode(trace.x) if first == len(xs) else first)
    ys: list[str | int] = [encode(trace.y) for panel in plot.panels for trace in panel.traces]
    return {"x": xs, "y": ys}


def encode(values: NDArray[np.float64]) -> str:
    """Little-endian 32-bit floats in base64; seven digits, NaN stays NaN."""
    with np.errstate(over="ignore"):
        return b64encode(values.astype("<f4").tobytes()).decode("ascii")


def embed(value: object) -> Markup:
    """JSON that is safe inside a script element whatever its texts contain."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character, replacement in _UNSAFE.items():
        text = text.replace(character, replacement)
    return Markup(text)  # noqa: S704 - made safe above


def _text(text: str) -> str:
    """Text that plotly.js shows literally: it would interpret some HTML in it as markup."""
    return escape(text, quote=False)


def _axis(letter: str, number: int) -> str:
    return letter if number == 0 else f"{letter}{number + 1}"


def _style(trace: Trace) -> dict[str, Any]:
    colour = colours.SERIES[trace.colour % len(colours.SERIES)]
    unit = f" {_text(trace.unit)}" if trace.unit else ""
    style: dict[str, Any] = {
        "type": "scatter",
        "name": _text(trace.name),
        "mode": {Look.POINTS: "markers", Look.MARKED: "lines+markers"}.get(trace.look, "lines"),
        "line": {"color": colour, "width": 1 if trace.faint else 1.7},
        "hovertemplate": f"%{{y:.4~g}}{unit}",
        "showlegend": trace.in_legend,
    }
    if trace.look is Look.STEP:
        style["line"]["shape"] = "hv"
    if trace.look in (Look.POINTS, Look.MARKED):
        symbol = MARKERS[trace.colour % len(MARKERS)]
        style["marker"] = {"color": colour, "size": 8, "symbol": symbol}
    if trace.faint:
        style["line"]["dash"] = "dot"
    return style


def _height(panels: Sequence[Panel]) -> int:
    gaps = _GAP_PIXELS * (len(panels) - 1)
    pixels = sum(panel.height for panel in panels) * _PANEL_PIXELS
    return round(max(pixels, 1.6 * _PANEL_PIXELS)) + gaps + _MARGINS["t"] + _MARGINS["b"]


def _layout(plot: Plot, height: int) -> dict[str, Any]:
    inner = height - _MARGINS["t"] - _MARGINS["b"]
    gap = _GAP_PIXELS / inner
    total = sum(panel.height for panel in plot.panels)
    scale = (1.0 - gap * (len(plot.panels) - 1)) / total
    layout: dict[str, Any] = {
        "height": height,
        "margin": _MARGINS,
        "hovermode": "x unified",
        "hoversubplots": "axis",
        "dragmode": "zoom",
        "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"},
        "showlegend": True,
        "xaxis": {
            "title": {"text": _text(plot.x_title)},
            "anchor": _axis("y", len(plot.panels) - 1),
            **({"type": "log", "dtick": "D2"} if plot.log_x else {}),
        },
        "shapes": [*map(_span, plot.spans), *map(_mark, plot.marks)],
        "annotations": [_flag(mark) for mark in plot.marks],
    }
    top = 1.0
    for number, panel in enumerate(plot.panels):
        bottom = max(top - scale * panel.height, 0.0)
        layout[f"yaxis{number + 1 if number else ''}"] = _y_axis(panel, bottom, top)
        top = bottom - gap
    return layout


def _y_axis(panel: Panel, bottom: float, top: float) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "domain": [round(bottom, 6), round(top, 6)],
        "title": {"text": _text(panel.title), "standoff": 6},
        "exponentformat": "power",  # plotly's default would be 400B for 4·10¹¹
    }
    if panel.range is not None:
        axis["range"] = list(panel.range)
    if panel.ticks is not None:
        axis["tickvals"] = [value for value, _ in panel.ticks]
        axis["ticktext"] = [_text(name) for _, name in panel.ticks]
    return axis


def _span(span: Span) -> dict[str, Any]:
    return {
        "type": "rect",
        "yref": "paper",
        "x0": span.start,
        "x1": span.end,
        "y0": 0,
        "y1": 1,
        "line": {"width": 0},
        "fillcolor": colours.SPAN,
        "opacity": colours.SPAN_OPACITY,
        "layer": "below",
    }


def _flag(mark: Mark) -> dict[str, Any]:
    """The meaning of a mark is shown on hovering: the texts of neighbouring marks would overlap."""
    return {
        "x": mark.x,
        "y": 1,
        "yref": "paper",
        "yanchor": "bottom",
        "text": "▼",
        "font": {"color": colours.MARK, "size": 13},
        "showarrow": False,
        "hovertext": _text(mark.label),
    }


def _mark(mark: Mark) -> dict[str, Any]:
    return {
        "type": "line",
        "yref": "paper",
        "x0": mark.x,
        "x1": mark.x,
        "y0": 0,
        "y1": 1,
        "line": {"color": colours.MARK, "width": 1.5, "dash": "dash"},
    }
