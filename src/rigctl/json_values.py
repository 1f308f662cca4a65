"""Values as JSON has them, and JSON that is not trusted."""

from __future__ import annotations

import json
import math
import re
from typing import Any, Final

#: the escape of half a character, of which UTF-8 has none
_HALF: Final = re.compile(r"\\u[dD][89a-fA-F]")


def finite_or_none(value: float) -> float | None:
    """The value, or None for NaN and infinities, which JSON does not have."""
    return value if math.isfinite(value) else None


def parse_json(content: str | bytes) -> Any:
    """Parse a JSON document.

    Raises
    ------
    ValueError
        it is none, it is nested too deeply for the parser, or a text in it is no Unicode: half of a character
        outside the first 65536, which could be neither printed nor stored.
    """
    text = content if isinstance(content, str) else content.decode("utf-8")
    try:
        value = json.loads(text)
        if _HALF.search(text):
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError as problem:
        raise ValueError("it is nested too deeply") from problem
    return value
