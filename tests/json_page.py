"""The page that documents JSON answers, and the names of an answer that it lacks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "json-answers.md"
#: sections of the page by the first word of a command; each says "as above" of what an earlier one has
_SECTIONS = {
    "compare": ("compare",),
    "diagnose": ("compare", "diagnose", "design"),
    "design": ("compare", "diagnose", "design"),
    "discover": ("compare", "diagnose", "discover"),
    "learn": ("compare", "diagnose", "design", "learn"),
    "demo": ("compare", "diagnose", "design", "demo"),
    "compensate": ("compare", "compensate"),
    "survey": ("compare", "survey"),
    "run": ("run, simulate, resume",),
    "simulate": ("run, simulate, resume",),
    "resume": ("run, simulate, resume",),
    "model fit": ("compare", "model fit, add, remove"),
    "model add": ("compare", "model fit, add, remove"),
    "model remove": ("compare", "model fit, add, remove"),
    "check": ("check",),
    "family new": ("family new",),
    "frequency": ("frequency",),
}
#: objects whose names are a user's: of channels, parameters, tests, conditions
_BY_NAME = {
    *("channels", "parameters", "tests", "beside", "outputs", "actuators", "assume"),
    *("rmse", "heldout_rmse", "noise", "units", "states", "inputs", "slots", "settings"),
    *("weights", "probabilities", "gains", "expected", "error", "sizes", "shares"),
    *("residuals", "cross_correlation", "input_p_values"),
}


def undocumented(arguments: tuple[str, ...], answer: dict[str, Any]) -> set[str]:
    """Names in an answer that the page lacks; an empty result for commands that it does not describe."""
    command = " ".join(arguments[:2]) if arguments[0] in {"model", "family"} else arguments[0]
    if command not in _SECTIONS or "--dry-run" in arguments or answer.get("kind") == "procedure":
        return set()
    return set(_names(answer)) - _documented(command)


@cache
def _documented(command: str) -> set[str]:
    parts = re.split(r"^## (.*)$", PAGE.read_text("utf-8"), flags=re.MULTILINE)
    texts = dict(zip(parts[1::2], parts[2::2], strict=True))
    return set(
        re.findall(
            r"\w+", " ".join(re.findall(r"`(.+?)`", " ".join(texts[one] for one in _SECTIONS[command])))
        )
    )


def _names(value: object, *, by_name: bool = False) -> Iterator[str]:
    if isinstance(value, dict):
        for name, one in value.items():
            if not by_name:
                yield name
            yield from _names(one, by_name=not by_name and name in _BY_NAME)
    elif isinstance(value, list):
        for one in value:
            yield from _names(one)
