"""What results below `answers` ask it for exists there: they name it in text, which no type checker reads."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import rigctl
from rigctl.answers import documents

SOURCE = Path(rigctl.__file__).parent
ASKED = r"\bworded\([^\"]*\"([\w.]+)\.(\w+)\"\)"
DOCUMENTED = r"\bdocumented\(\w+, \"(\w+)\"\)"


def test_every_wording_that_a_result_asks_for_exists() -> None:
    texts = {path: path.read_text("utf-8") for path in SOURCE.rglob("*.py")}
    asked = [found for text in texts.values() for found in re.findall(ASKED, text)]
    assert len(asked) >= 9
    for module, function in asked:
        assert callable(getattr(import_module(f"rigctl.answers.{module}"), function))
    for name in (name for text in texts.values() for name in re.findall(DOCUMENTED, text)):
        assert callable(getattr(documents, name))


def test_only_results_and_what_keeps_their_sentences_ask() -> None:
    """Nothing in `answers` or above takes the way from below."""
    above = ("answers", "report", "web", "cli", "live", "proposal", "workbench")
    asking = [
        path
        for room in above
        for path in (SOURCE / room).rglob("*.py")
        if "from rigctl.notebook import worded" in path.read_text("utf-8")
    ]
    assert asking == []
