"""A finding of `rigctl doctor`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """The result of one check: `fix` is the remedy if it failed."""

    subject: str
    state: Literal["ok", "optional", "broken"]
    detail: str
    fix: str = ""
