"""Text from files and devices made safe for a terminal: nothing in it moves the cursor or hides text."""

from __future__ import annotations

import unicodedata

_REPLACED = "\N{REPLACEMENT CHARACTER}"


def printable(text: str, keep: str = "") -> str:
    """The text with everything that controls a terminal replaced: escape sequences, bidirectional overrides.

    Replaced are the Unicode categories C (control, format, surrogate, private, unassigned) and the separators
    of lines and paragraphs.

    Parameters
    ----------
    keep: control characters to keep, for example ``"\\n\\t"`` in a text of several lines.
    """
    if text.isprintable():
        return text
    return "".join(one if one in keep or not _controls(one) else _REPLACED for one in text)


def _controls(character: str) -> bool:
    return unicodedata.category(character)[0] == "C" or character in "\u2028\u2029"
