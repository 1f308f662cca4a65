"""The plan as a whole: its size, its depth, its paths, its digest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import pytest

from rigctl.errors import RigctlError
from rigctl.plan import Loop, Plan, RecordNode, cleanup_blocks, iteration_path, walk
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig


def test_paths_are_unique_and_follow_the_file(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - for: {oil: [20 degC, 30 degC]}
          do:
            - heat: $oil
            - record: {name: r}
              do: [wait: 1 s]
              finally: [wait: 2 s]
        - repeat: 2
          do: [wait: 1 s]
        """)
    paths = [node.path for node in walk(plan.root)]
    assert len(paths) == len(set(paths))
    assert paths[:5] == [
        "procedure",
        "1/for",
        "1/for[oil=20 degC]",
        "1/for[oil=20 degC]/1/heat",
        "1/for[oil=20 degC]/2/block",
    ]
    assert "2/repeat/1/wait" in paths


def test_nodes_have_the_line_of_their_step(planned: Callable[..., Plan]) -> None:
    plan = planned("""
        steps:
          - wait: 1 s
          - record: {name: r}
            do:
              - wait: 2 s
        """)
    lines = {node.path: node.where.line for node in walk(plan.root)}
    assert (lines["1/wait"], lines["2/record"], lines["2/record/1/wait"]) == (4, 5, 7)


def test_each_round_of_a_loop_has_its_own_path(steps: Callable[..., Plan]) -> None:
    plan = steps("- repeat: 3\n  do:\n    - record: {name: r}\n      do: [wait: 1 s]")
    (loop,) = plan.root.children
    assert isinstance(loop, Loop)
    (record,) = [node for node in walk(loop) if isinstance(node, RecordNode)]
    assert iteration_path(loop, 3, record.path) == "1/repeat#3/1/record"


def test_a_plan_that_grows_too_large_is_refused(steps: Callable[..., Plan]) -> None:
    text = "- wait: 1 s"
    for name in "abcdef":
        inner = "\n".join(f"    {line}" for line in text.splitlines())
        text = f"- for: {{{name}: {{from: 1 s, to: 10 s, step: 1 s}}}}\n  do:\n{inner}"
    with pytest.raises(RigctlError, match="the plan grows too large"):
        steps(text)


@pytest.mark.parametrize("verb", ["do", "repeat: 1\n{pad}do", "for: {{v{n}: [1 s]}}\n{pad}do", "record"])
def test_steps_may_be_nested_up_to_a_limit(planned: Callable[..., Plan], verb: str) -> None:
    if verb == "record":
        verb = "if: position < 1 mm\n{pad}do"

    def nested(depth: int) -> str:
        lines = ["steps:"]
        for n in range(depth):
            pad = "  " * (2 * n + 1)
            lines.append(f"{pad}- {verb.format(pad=pad + '  ', n=n)}:")
        lines.append(f"{'  ' * (2 * depth + 1)}- wait: 1 s")
        return "\n".join(lines)

    plan = planned(nested(40))
    assert len(plan.digest) == 64
    with pytest.raises(RigctlError, match="nested too deep"):
        planned(nested(60))


def test_calls_inside_calls_count_as_depth(tmp_path: Path, rig: Rig) -> None:
    for n in range(60):
        text = f"procedure: p{n}\nsteps: [{{call: p{n + 1}.yaml}}]\n"
        (tmp_path / f"p{n}.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "p60.yaml").write_text("procedure: last\nsteps: [wait: 1 s]\n", encoding="utf-8")
    first = parse_procedure((tmp_path / "p0.yaml").read_text(encoding="utf-8"), tmp_path / "p0.yaml")
    with pytest.raises(RigctlError, match="steps are nested too deep"):
        expand(first, rig)


CAMPAIGN = """
    steps:
      - for: {oil: [20 degC, 30 degC]}
        do:
          - heat: {to: $oil, settle: 60 s}
          - extend: {until: position > 50 mm}
      - measure: {name: a, value: mean(position), unit: mm, last: 1 s}
    """


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("", "", True),
        ("settle: 60 s", "settle: 1 min", True),
        ("steps:", "description: other words   # and a comment\n    steps:", True),
        ("settle: 60 s", "settle: 61 s", False),
        ("30 degC", "31 degC", False),
        ("position > 50 mm", "position > 51 mm", False),
        ("mean(position)", "max(position)", False),
        ("last: 1 s", "last: 2 s", False),
    ],
)
def test_the_digest_depends_only_on_the_meaning_of_the_plan(
    planned: Callable[..., Plan], old: str, new: str, same: bool
) -> None:
    changed = dedent(CAMPAIGN.replace(old, new) if old else CAMPAIGN)
    assert (planned(dedent(CAMPAIGN)).digest == planned(changed).digest) is same


def test_cleanup_blocks_change_the_digest(planned: Callable[..., Plan]) -> None:
    plain = planned("steps: [wait: 1 s]")
    cleaned = planned("steps: [wait: 1 s]\nfinally: [wait: 1 s]")
    assert plain.digest != cleaned.digest
    assert cleanup_blocks(cleaned.root) == ()
