"""What `rigctl doctor` finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at: `fix` says what to do when it is not well."""

    subject: str
    state: Literal["ok", "optional", "broken"]
    detail: str
    fix: str = ""
