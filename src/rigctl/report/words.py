"""What the words of an answer mean: a page lists those that it uses, and the glossary has all of them."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from typing import Final

#: meaning by word, in the order of a page
WORDS: Final[Mapping[str, str]] = {
    "noise": "the scatter of a reading when nothing changes; no model can predict it",
    "error": "measured less modelled; RMSE is the root of its mean square",
    "systematic error": "what is left of the error when the noise is subtracted from it",
    "times as strong as chance": "how much an effect explains, in standard deviations of what noise alone "
    "makes of it: hardly ever above 3 for one effect that is not there, nor above 4 for the largest of a "
    "library",
    "R²": "share of a channel's variance that a model explains; 100 % is all of it",
    "p": "probability of seeing as much by chance alone; below 0.01 it counts as seen",
    "effect": "one piece of physics that a model may have or lack; in brackets its name in the library",
    "misfit": "the part of the error that is more than noise",
    "ambiguous": "several effects explain the data, and the data cannot tell which of them is right",
    "evidence against": "what speaks against the effect that was named; the folded part has it in full",
    "held out": "not seen by any fit, so that it tests the model's predictions",
    "conditions left out": "predicted by a fit to all other conditions, one at a time",
    "probability": "of an effect among those of the library, given these data",
    "sigma": "standard deviation: of a reading, that of its noise",
    "mBIC": "a score of a model, misfit plus a penalty for each effect it has; lower is better",
    "χ²": "squared error in units of the noise; per value it is about 1 for a right model",
    "cos": "similarity of what two effects change, 1 for the same and 0 for nothing in common",
    "slot": "a place in the equations where an effect may act",
}


def words_in(text: str) -> dict[str, str]:
    """The words that the visible text of a piece of HTML uses, with their meanings."""
    visible = re.sub(r"<(script|style)\b.*?</\1>", " ", text, flags=re.DOTALL | re.IGNORECASE)
    plain = html.unescape(re.sub(r"<[^>]*>", " ", visible))
    return {word: meaning for word, meaning in WORDS.items() if _pattern(word).search(plain)}


def _pattern(word: str) -> re.Pattern[str]:
    if word == "p":
        return re.compile(r"\bp [<=] ")
    return re.compile(rf"(?<!\w){re.escape(word)}s?(?!\w)", re.IGNORECASE if word.islower() else 0)
