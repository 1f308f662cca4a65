"""Text from files and devices made safe for a terminal: nothing in it moves the cursor or hides text."""

from __future__ import annotations

import unicodedata
from pathlib import PurePath

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


def shown_path(path: object) -> str:
    """A path as messages and commands have it: with forward slashes, which Windows' programs read too.

    A text is an address, or was typed by the user, and is shown as it is; without a path nothing is shown.
    """
    return path.as_posix() if isinstance(path, PurePath) else str(path or "")


def _controls(character: str) -> bool:
    return unicodedata.category(character)[0] == "C" or character in "\u2028\u2029"
