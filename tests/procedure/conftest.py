"""Procedures written in the test, on the shipped rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import pytest

from rigctl.plan import Leaf, Plan, walk
from rigctl.plan.action import Action
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig, load_rig

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"

Planned = Callable[..., Plan]


@pytest.fixture(scope="session")
def rig() -> Rig:
    return load_rig(RIG)


@pytest.fixture
def planned(rig: Rig) -> Planned:
    """Expand the text of a procedure without its name; keywords are arguments."""

    def plan(text: str, on: Rig | None = None, **arguments: str | float) -> Plan:
        procedure = parse_procedure(f"procedure: test\n{dedent(text)}", Path("test.yaml"))
        return expand(procedure, on or rig, arguments)

    return plan


@pytest.fixture
def steps(planned: Planned) -> Planned:
    """Expand steps only; each line of `text` is in the list `steps`."""

    def plan(text: str, on: Rig | None = None) -> Plan:
        body = "\n".join(f"  {line}" for line in dedent(text).strip().splitlines())
        return planned(f"steps:\n{body}\n", on)

    return plan


def actions(plan: Plan) -> list[Action]:
    """Every action of a plan in order."""
    return [node.action for node in walk(plan.root) if isinstance(node, Leaf)]


@pytest.fixture
def only(steps: Planned) -> Callable[[str], Action]:
    """The action of a single step."""

    def action(text: str) -> Action:
        (found,) = actions(steps(text))
        return found

    return action
