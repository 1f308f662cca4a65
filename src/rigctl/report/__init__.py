"""One self-contained page about one or more runs, and its figures as files.

What makes the page is loaded with its first use: a command that prints an answer uses its words alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.report.write import Report, write_report

__all__ = ["Report", "write_report"]


if not TYPE_CHECKING:  # so that a type checker finds a name that is not there

    def __getattr__(name: str) -> Any:
        """The name, loaded with its first use."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module("rigctl.report.write"), name)
        return value
