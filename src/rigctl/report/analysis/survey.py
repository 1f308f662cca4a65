"""The page of a survey: what has changed, and the trend of every quantity over the runs.

In: a `Survey`. Out: a page of its own with three sections. It is not made by `rigctl.report.write`, which
reads and shows every run that it is given: a survey may have a thousand, and all that its page needs is
in the result. The page around the sections is the same, given an empty `RunData` that has only a title.

Each quantity is drawn with the interval of each run, the change that was fitted, and the run at which it
was first significant, which is later than the one at which it began. What changed comes first; at most
`_DRAWN` quantities are drawn, the tables have all.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import INTERVAL, SURVEY_ALPHA
from rigctl.answers.blocks import Block, Details, Figure, Note, Sentence
from rigctl.answers.numbers import plural, symbol
from rigctl.answers.survey import (
    changes_table,
    failures,
    note_text,
    remarks,
    runs_table,
    statement,
    survey_answer,
    tests_table,
)
from rigctl.dataset.outputs import is_page, require_output
from rigctl.files.write import write_text
from rigctl.monitoring.entries import DATE, ORDER
from rigctl.monitoring.multiplicity import QuantitySeries
from rigctl.monitoring.result import Survey
from rigctl.report.blocks import page_blocks
from rigctl.report.page import page
from rigctl.report.plot import Look, Mark, Panel, Plot, Trace
from rigctl.report.run_data import RunData
from rigctl.report.section import MOST_ROWS, Section, plot_slot
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

_LEVEL = (
    f"where nothing changes, {100 * SURVEY_ALPHA:g} of 100 surveys report a change, provided that the level "
    "does not drift slowly by itself: the p-values are corrected for the number of quantities, of runs at "
    "which a change could have begun, and of runs after which it could have been detected"
)
_NO_OTHERS = "there are no other quantities"
_AGREES = "agrees: the model, with what is free in each run, agrees with it within the noise"
#: trends that are drawn
_DRAWN = 12
_DAY = 86_400.0


def survey_sections(survey: Survey) -> list[Section]:
    """The statement with a chart of what changed and of the parameters, and the table of runs."""
    plots = [_plot(survey, course, k) for k, course in enumerate(survey.shown()[:_DRAWN])]
    first = tuple(plots[: max(1, len(survey.changes))])
    others = tuple(plots[len(first) :])
    answer = survey_answer(survey)
    notes = [note_text(survey, note) for note in survey.data_notes]
    blocks: list[Block] = [
        Sentence(statement(survey), answer.tone, answer.title),
        *(Figure(plot.id, plot.caption) for plot in first),
        *changes_table(survey),
        Note(_LEVEL),
        *map(Note, (*remarks(survey), *survey.notes, *notes)),
        Details("all quantities that were tested", (tests_table(survey),)),
    ]
    rest: list[Block] = [Figure(plot.id, plot.caption) for plot in others]
    runs = [runs_table(survey, MOST_ROWS), Note(_AGREES), *failures(survey)]
    return [
        Section("survey", "What has changed", page_blocks(blocks, _slots(first)), first),
        Section(
            "courses",
            "Every quantity over the runs",
            page_blocks(rest or [Note(_NO_OTHERS)], _slots(others)),
            others,
        ),
        Section("runs", "The runs", page_blocks(runs), ()),
    ]


def _slots(plots: Sequence[Plot]) -> dict[str, Markup]:
    return {plot.id: plot_slot(plot) for plot in plots}


def write_survey_page(survey: Survey, rig: str, output: Path, *, force: bool = False) -> None:
    """Write one self-contained page of a survey.

    Raises
    ------
    RigctlError
        another file is there, or it cannot be written.
    """
    require_output(output, replaces=is_page, force=force)
    about = {
        "procedure": {"name": f"Survey of {plural(len(survey.lines), 'run')}"},
        "rig": {"name": rig},
    }
    nothing = np.empty(0)
    shown = RunData("survey", about, nothing, {}, (), (), (), None)
    write_text(output, page([shown], survey_sections(survey)))


def _places(survey: Survey) -> tuple[NDArray[np.float64], str]:
    """The positions of the runs on the chart, and the title of that axis."""
    positions = np.array([line.entry.place for line in survey.read])
    if survey.axis.name == DATE:
        start = datetime.fromtimestamp(float(positions[0]), UTC) if positions.size else datetime.now(UTC)
        return (positions - float(positions[0])) / _DAY, f"days since {start:%Y-%m-%d}"
    if survey.axis.name == ORDER:
        return positions, "run number"
    unit = parse_unit(survey.axis.unit)
    return (
        np.array([unit.from_si(float(position)) for position in positions]),
        f"{plain_name(survey.axis.name)} [{symbol(survey.axis.unit)}]",
    )


def _plot(survey: Survey, course: QuantitySeries, number: int) -> Plot:
    """The values of one quantity with their 95 % intervals, and where the change was first significant."""
    quantity = course.quantity
    unit = parse_unit(quantity.unit)
    values = np.array([unit.from_si(float(v), difference=quantity.difference) for v in course.values])
    wide = INTERVAL * course.std / unit.factor
    x, title = _places(survey)
    bars_x, bars_y = np.repeat(x, 3), np.full(3 * x.size, np.nan)
    bars_y[0::3], bars_y[1::3] = values - wide, values + wide
    shown = symbol(quantity.unit)
    traces = [
        Trace("95 % interval, from the run alone", bars_x, bars_y, Look.LINE, 0, shown),
        Trace("value", x, values, Look.POINTS, 0, shown),
    ]
    change = next((one for one in survey.changes if one.quantity.name == quantity.name), None)
    marks = []
    if change is not None:
        marks.append(Mark(float(x[min(change.first_sure, x.size) - 1]), "first significant"))
        traces.append(Trace("fitted change", *_shape(survey, number, x), Look.LINE, 1, shown))
    label = f"{plain_name(quantity.name)} [{shown}]" if shown not in ("", "1") else plain_name(quantity.name)
    return Plot(
        f"course-{number + 1}",
        f"{plain_name(quantity.name)}{f': {quantity.meaning}' if quantity.meaning else ''}",
        title,
        (Panel(label, tuple(traces), 1.3),),
        marks=tuple(marks),
    )


def _shape(
    survey: Survey, number: int, x: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The fitted change: a ramp from its onset, or steps."""
    change = survey.changes[number]
    quantity, unit = change.quantity, parse_unit(change.quantity.unit)

    def shown(si: float) -> float:
        return unit.from_si(si, difference=quantity.difference)

    if change.steps:
        edges = [0, *change.steps, x.size]
        levels = [shown(level) for level in change.levels]
        pairs = [(first, last) for first, last in pairwise(edges) if last > first]
        xs = [position for first, last in pairs for position in (x[first], x[last - 1], np.nan)]
        ys = [value for level in levels for value in (level, level, np.nan)]
        return np.array(xs), np.array(ys)
    begins = max(change.shape.begins - 1, 0)
    before, after = shown(change.shape.before), shown(change.shape.after)
    return np.array([x[0], x[begins], x[-1]]), np.array([before, before, after])
