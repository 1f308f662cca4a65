"""The section on a set-point schedule: the set-points, and the quantity with and without it."""

from __future__ import annotations

import numpy as np

from rigctl.analysis.decision_levels import INTERVAL
from rigctl.answers.blocks import Block, Figure, Points, Sentence
from rigctl.answers.numbers import symbol
from rigctl.answers.schedule.schedule import schedule_answer, schedule_evidence
from rigctl.compensation.result import Schedule
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit, show


def compensation_sections(schedule: Schedule) -> list[Section]:
    """The statement, the schedule as a picture and as a table, and what was measured."""
    plot = _plot(schedule)
    answer = schedule_answer(schedule)
    facts = [f"{head}: {text}" for head, text in answer.facts[1:]]
    blocks: list[Block] = [
        Sentence(answer.sentence, answer.tone, answer.title),
        Figure(plot.id, plot.caption),
        *schedule_evidence(schedule),
        Points.of("", facts),
        *answer.remarks,
    ]
    body = page_blocks(blocks, {plot.id: plot_slot(plot)})
    return [Section("schedule", "A set-point schedule", body, (plot,))]


def _plot(schedule: Schedule) -> Plot:
    over, vary, quantity_unit = (
        parse_unit(unit) for unit in (schedule.over_unit, schedule.vary_unit, schedule.unit)
    )
    x = np.array([over.from_si(row.over) for row in schedule.rows])
    wide = INTERVAL * np.array([row.std for row in schedule.rows]) / vary.factor
    set_point = np.array([vary.from_si(row.vary) for row in schedule.rows])
    scatter = INTERVAL * np.array([row.scatter for row in schedule.rows]) / quantity_unit.factor
    quantity = np.array([quantity_unit.from_si(row.kept) for row in schedule.rows])
    unchanged = np.array([quantity_unit.from_si(row.fixed) for row in schedule.rows])
    v, q = symbol(schedule.vary_unit), symbol(schedule.unit)
    upper = (
        Trace("set-point", x, set_point, Look.MARKED, 0, v),
        Trace("its 95 % band", x, set_point - wide, Look.LINE, 0, v, faint=True),
        Trace("", x, set_point + wide, Look.LINE, 0, v, faint=True, in_legend=False),
    )
    label = f"at constant {show(schedule.fixed, schedule.vary_unit)}"
    lower = (
        Trace("with the schedule", x, quantity, Look.LINE, 0, q),
        Trace("95 % of records", x, quantity - scatter, Look.LINE, 0, q, faint=True),
        Trace("", x, quantity + scatter, Look.LINE, 0, q, faint=True, in_legend=False),
        Trace(label, x, unchanged, Look.LINE, 1, q),
    )
    return Plot(
        "schedule",
        f"{plain_name(schedule.vary)} over {plain_name(schedule.over)}, and {plain_name(schedule.quantity)} "
        "with it and without, as predicted by the model",
        f"{plain_name(schedule.over)} [{symbol(schedule.over_unit)}]",
        (
            Panel(f"{plain_name(schedule.vary)} [{v}]", upper, 1.2),
            Panel(f"{plain_name(schedule.quantity)} [{q}]", lower, 1.2),
        ),
    )
