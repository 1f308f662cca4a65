"""One self-contained page about one or more runs, and its figures as files.

The modules of the page are loaded on first use: a command that only prints an answer does not need them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.report.write import Report, write_report

__all__ = ["Report", "write_report"]


if not TYPE_CHECKING:  # so that a type checker reports an unknown name

    def __getattr__(name: str) -> Any:
        """The object of that name, loaded on first use."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module("rigctl.report.write"), name)
        return value
