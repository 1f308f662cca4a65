"""The content of a plot, independent of how it is drawn: interactively on the page, or into a file by
`figure_files`."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

#: a second mark, so that series can be distinguished in black-and-white print
MARKERS = ("circle", "square", "diamond", "triangle-up", "cross", "triangle-down", "x", "star")


class Look(Enum):
    """How a trace is drawn."""

    LINE = "line"  #: a line through samples
    STEP = "step"  #: the value holds until the next sample
    POINTS = "points"  #: marks only
    MARKED = "marked"  #: marks joined by a line


@dataclass(frozen=True)
class Trace:
    """One line: points x, y of equal length; NaN in y interrupts it. `unit` is that of y, as printed."""

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    look: Look = Look.LINE
    colour: int = 0
    unit: str = ""
    faint: bool = False  #: a set value beside what was measured
    in_legend: bool = True


@dataclass(frozen=True)
class Panel:
    """One pair of axes; those of a plot are stacked and share the x axis."""

    title: str
    traces: tuple[Trace, ...]
    height: float = 1.0  #: relative to the other panels
    range: tuple[float, float] | None = None  #: of y; from the data when None
    ticks: tuple[tuple[float, str], ...] | None = None  #: values with their names, e.g. of a valve


@dataclass(frozen=True)
class Span:
    """A stretch of x that is shaded, e.g. a record."""

    start: float
    end: float


@dataclass(frozen=True)
class Mark:
    """A moment that is marked by a line, e.g. an alarm."""

    x: float
    label: str


@dataclass(frozen=True)
class Plot:
    """A figure: an `id` unique on the page (and the file's name), its caption, panels over one x axis."""

    id: str
    caption: str
    x_title: str
    panels: tuple[Panel, ...]
    spans: tuple[Span, ...] = ()
    marks: tuple[Mark, ...] = field(default=())
    log_x: bool = False  #: whether the axis of x is logarithmic
