"""Representations of results: one line as a `repr`, and a summary with a table in a notebook."""

from __future__ import annotations

from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

#: maximum length of a `repr`
_LONGEST = 160


def one_line(kind: object, text: str) -> str:
    """``<Kind text>`` on one line, truncated if it is too long."""
    line = f"<{type(kind).__name__} {' '.join(text.split())}>"
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 2]}…>"


def worded(result: object, how: str) -> str:
    """What a function of `rigctl.answers`, ``module.function``, makes of a result.

    Results are worded above the rooms that compute them. A method that a user calls opens that room from
    outside, as ``import rigctl`` opens all.
    """
    module, _, function = how.rpartition(".")
    text: str = getattr(import_module(f"rigctl.answers.{module}"), function)(result)
    return text


def documented(result: object, how: str) -> dict[str, Any]:
    """The document of a result that has sentences, from a function of `rigctl.answers.documents`."""
    document: dict[str, Any] = getattr(import_module("rigctl.answers.documents"), how)(result)
    return document


def as_html(summary: str, table: pd.DataFrame) -> str:
    """The summary as text, and the table below it; user text is escaped."""
    return f"<pre>{escape(summary)}</pre>{table.to_html(index=False, escape=True, na_rep='')}"
