"""A schedule as files: a table for people and programs, and an array for a controller."""

from __future__ import annotations

import re
from functools import partial

from rigctl.answers.schedule.schedule import end_text
from rigctl.compensation.result import Schedule
from rigctl.units import show


def csv_text(schedule: Schedule) -> str:
    """One line for each operating point that the rig reaches, with units in the heading."""
    q, v, o = schedule.unit, schedule.vary_unit, schedule.over_unit
    lines = [f"{schedule.over} [{o}],{schedule.vary} [{v}],std [{v}],{schedule.quantity} [{q}],scatter [{q}]"]
    names = ("over", "vary", "std", "kept", "scatter")
    reached = [row for row in schedule.numbers() if row["vary"] is not None]
    lines += [",".join(f"{row[name]:.6g}" for name in names) for row in reached]
    return "\n".join(lines) + "\n"


def header_text(schedule: Schedule) -> str:
    """A header in C: the points of the schedule, and a function that interpolates and holds at its ends."""
    rows = [row for row in schedule.numbers() if row["vary"] is not None]
    name = re.sub(r"\W+", "_", f"{schedule.vary}_over_{schedule.over}".casefold())
    over, vary = (", ".join(f"{row[key]:.6g}f" for row in rows) for key in ("over", "vary"))
    over, vary = (_floats(text) for text in (over, vary))
    worst = max(row.std for row in schedule.reached)
    box = ", ".join(f"{n} {show(low, u)} to {show(high, u)}" for n, low, high, u in schedule.valid)
    guard = f"{name.upper()}_H"
    remarks = [
        f"{schedule.vary} in {schedule.vary_unit} over {schedule.over} in {schedule.over_unit}: keeps "
        f"{schedule.quantity} at {show(schedule.target, schedule.unit)}.",
        f"By {schedule.model} fitted to {', '.join(schedule.runs)}.",
        f"Standard deviation of a set-point: {show(worst, schedule.vary_unit, difference=True)} at most.",
        f"Interpolating is off by {show(schedule.off, schedule.unit, difference=True)} at most.",
        f"Measured over: {box}.",
        *map(partial(end_text, schedule), schedule.ends),
    ]
    comment = "\n".join(f" * {line}" for line in remarks)
    return f"""/*
{comment}
 */
#ifndef {guard}
#define {guard}

#define {name.upper()}_POINTS {len(rows)}

static const float {name}_at[{len(rows)}] = {{{over}}}; /* {schedule.over_unit} */
static const float {name}_set[{len(rows)}] = {{{vary}}}; /* {schedule.vary_unit} */

/* The set-point at an operating point: straight lines between the points, constant beyond the ends. */
static inline float {name}(float at)
{{
    int k = 1;
    if (at <= {name}_at[0]) return {name}_set[0];
    if (at >= {name}_at[{len(rows) - 1}]) return {name}_set[{len(rows) - 1}];
    while (at > {name}_at[k]) k++;
    return {name}_set[k - 1] + ({name}_set[k] - {name}_set[k - 1])
        * (at - {name}_at[k - 1]) / ({name}_at[k] - {name}_at[k - 1]);
}}

#endif
"""


def _floats(text: str) -> str:
    """C source with a decimal point in every literal: ``30f`` is not valid in C."""
    return re.sub(r"(?<![\d.eE+-])(-?\d+)f\b", r"\1.0f", text)
