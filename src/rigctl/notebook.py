"""Representations of results: one line as a `repr`, and a summary with a table in a notebook."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

#: maximum length of a `repr`
_LONGEST = 160


def one_line(kind: object, text: str) -> str:
    """``<Kind text>`` on one line, truncated if it is too long."""
    line = f"<{type(kind).__name__} {' '.join(text.split())}>"
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 2]}…>"


def as_html(summary: str, table: pd.DataFrame) -> str:
    """The summary as text, and the table below it; user text is escaped."""
    return f"<pre>{escape(summary)}</pre>{table.to_html(index=False, escape=True, na_rep='')}"
