"""The reference of the steps: its examples work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigctl.plan import Plan, RecordNode, walk
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig, load_rig
from rigctl.steps.registry import BY_VERB

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("verb", BY_VERB)
def test_every_example_expands_on_the_shipped_rig(steps: Callable[..., Plan], verb: str) -> None:
    kind = BY_VERB[verb]
    plan = steps(kind.example, load_rig(ROOT / "rigs" / kind.example_rig))
    assert {child.path.split("/")[1] for child in plan.root.children} <= {verb, "block"}


def test_the_procedure_of_the_how_to_page_expands(rig: Rig) -> None:
    page = (ROOT / "docs" / "how-to" / "write-a-procedure.md").read_text(encoding="utf-8")
    text = page.split("```yaml\n", 1)[1].split("```", 1)[0]
    plan = expand(parse_procedure(text, ROOT / "procedures" / "mine.yaml"), rig)
    assert sum(isinstance(node, RecordNode) for node in walk(plan.root)) == 2
