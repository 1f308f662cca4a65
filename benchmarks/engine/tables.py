"""The stored results as tables, for the terminal and the documentation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

Table = tuple[str, list[tuple[str, ...]]]
Results = Mapping[str, Any]

TITLES = {
    "rigctl": "rigctl: ESDIRK3(2), exact tangents",
    "scipy": "SciPy: LSODA, finite differences",
    "casadi": "CasADi: CVODES",
    "diffrax": "diffrax: Kvaerno3, forward mode",
}
_TASKS = ("simulate", "columns_8", "columns_28")
_HEADS = ("simulate", "+ 8 columns", "+ 28 columns")
_STAGES = {
    "imports": "imports",
    "integrator": "the integrator, once per installation",
    "superset": "the whole library, cold",
    "own_effect": "a user's effect on top of it, cold",
    "cached": "the whole library, from the cache",
}


def tables(results: Results) -> Iterator[Table]:
    """Every table: a title and its rows, the heading first."""
    yield "28 records of 7 s at 100 Hz, 7 stiff states: processor seconds", _campaign(results["campaign"])
    yield "errors and memory of these", _errors(results["campaign"])
    yield "rigctl's own work on that model", _own(results)
    yield (
        "the default tolerance and the tight one, beside independent solvers",
        _oracle(results["solvers"]),
    )
    yield "the shipped cylinder with its whole library at null, 28 records", _superset(results["superset"])
    yield "its errors against a tolerance of 1e-9", _superset_errors(results["superset"])
    yield "growing records, 8 columns each", _growth(results["scaling"]["records"], "records")
    yield "growing columns, 28 records", _growth(results["scaling"]["columns"], "columns")
    yield "the start of a model", _starts(results["building"])


def _campaign(campaign: Results) -> list[tuple[str, ...]]:
    ours = campaign["rigctl"]
    rows = [("all threads together, and how many times rigctl's", *_HEADS)]
    for name, found in campaign.items():
        cells = [
            "-"
            if found[task] is None
            else f"{found[task]['cpu']:.3f} ({found[task]['cpu'] / ours[task]['cpu']:.1f}x)"
            for task in _TASKS
        ]
        rows.append((TITLES[name], *cells))
    return rows


def _errors(campaign: Results) -> list[tuple[str, ...]]:
    rows = [("", "largest error of an output", "of a column", "peak memory")]
    for name, found in campaign.items():
        off = [f"{found[key]:.1e}" for key in ("output_error", "column_error")]
        rows.append((TITLES[name], *off, f"{found['peak_memory_mb']:.0f} MB"))
    return rows


def _oracle(found: Results) -> list[tuple[str, ...]]:
    rows = [("tolerance", "outputs off Radau at 1e-9", "columns off CVODES at 1e-8: median", "largest")]
    for name in ("default", "tight"):
        one = found[name]
        keys = ("output_error", "column_error_median", "column_error_largest")
        rows.append((name, *(f"{one[key]:.1e}" if key in one else "-" for key in keys)))
    return rows


def _own(results: Results) -> list[tuple[str, ...]]:
    ours, fit, stepper = results["campaign"]["rigctl"], results["fit"], results["stepper"]
    scipy = fit["scipy"]
    calls = f"{min(fit['evaluations'])} to {max(fit['evaluations'])} calls"
    return [
        ("", "wall s", "processor s"),
        *(
            (f"28 records, {head}", f"{ours[task]['wall']:.3f}", f"{ours[task]['cpu']:.3f}")
            for task, head in zip(_TASKS, _HEADS, strict=True)
        ),
        (f"8 parameters fitted from 30 % off, {calls}", f"{fit['wall']:.2f}", f"{fit['cpu']:.2f}"),
        (
            f"the same by SciPy's TRF with rigctl's columns, {scipy['evaluations']} calls; "
            f"its optimum is {scipy['largest_difference']:.3f} standard deviations away",
            f"{scipy['wall']:.2f}",
            f"{scipy['cpu']:.2f}",
        ),
        (f"{stepper['calls']} calls of a stepper", f"{stepper['wall']:.2f}", f"{stepper['cpu']:.2f}"),
    ]


def _superset(found: Results) -> list[tuple[str, ...]]:
    rows = [(f"{found['states']} states, {found['outputs']} outputs", "wall s", "processor s")]
    for title, task in (("simulate", "simulate"), (f"+ all {found['columns']} columns", "all_columns")):
        rows.append((title, f"{found[task]['wall']:.3f}", f"{found[task]['cpu']:.3f}"))
    return rows


def _superset_errors(found: Results) -> list[tuple[str, ...]]:
    rows = [("tolerance", "largest error of an output", "rms", "error of a column: median", "largest")]
    keys = ("output_error", "output_error_rms", "column_error_median", "column_error_largest")
    rows += [(name, *(f"{found[name][key]:.1e}" for key in keys)) for name in ("default", "tight")]
    return rows


def _growth(found: list[Results], kind: str) -> list[tuple[str, ...]]:
    rows = [(kind, "wall s", "processor s", "processor ms per record", "peak memory", "of it the columns")]
    for one in found:
        memory = [f"{one[key]:.0f} MB" for key in ("peak_memory_mb", "columns_mb")]
        times = (f"{one['wall']:.3f}", f"{one['cpu']:.3f}", f"{1e3 * one['cpu'] / one['records']:.2f}")
        rows.append((str(one[kind]), *times, *memory))
    return rows


def _starts(found: Results) -> list[tuple[str, ...]]:
    rows = [("", "wall s", "processor s")]
    rows += [
        (title, f"{found[stage]['wall']:.2f}", f"{found[stage]['cpu']:.2f}")
        for stage, title in _STAGES.items()
    ]
    return rows
