"""A value is changed in a YAML file, and every other byte stays."""

from __future__ import annotations

import difflib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.files.edit import set_entries
from rigctl.files.yaml import parse_document

NEW = {"coefficients": "[1.5, 2.5]", "date": "2026-11-21"}


def changed_lines(before: str, after: str) -> list[str]:
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


def edited(text: str) -> str:
    after = set_entries(text, ("channels", "p", "calibration"), NEW)
    found = parse_document(after).data["channels"]["p"]["calibration"]
    assert (found["coefficients"], found["date"]) == ([1.5, 2.5], "2026-11-21")
    return after


def test_editing_a_block_keeps_comments_and_alignment() -> None:
    text = """\
# the bench
channels:
  p:
    unit: bar     # aligned
    calibration:
      coefficients: [-31.25, 0.305474]     # two points
      date:   2026-01-01      # long ago
      # nobody knows why
      reference: 'a gauge'
    noise: 0.2 bar

  q: {unit: mm}     # untouched
"""
    after = edited(text)
    assert changed_lines(text, after) == [
        "-       coefficients: [-31.25, 0.305474]     # two points",
        "+       coefficients: [1.5, 2.5]             # two points",  # the comment keeps its column
        "-       date:   2026-01-01      # long ago",
        "+       date:   2026-11-21      # long ago",
    ]


def test_a_new_field_is_added_at_the_end_of_its_block() -> None:
    text = "channels:\n  p:\n    calibration:\n      date: 2026-01-01   # old\n      # end\n    noise: 1\n"
    after = edited(text)
    assert after.splitlines()[3:5] == ["      date: 2026-11-21   # old", "      coefficients: [1.5, 2.5]"]
    assert "      # end\n    noise: 1\n" in after


def test_a_flow_mapping_is_edited_in_place() -> None:
    text = (
        "channels:\n  p: {unit: bar, calibration: {coefficients: [0, 1], valid_for: 1 day}, noise: 1}  # c\n"
    )
    wanted = (
        "channels:\n  p: {unit: bar, calibration: {coefficients: [1.5, 2.5], valid_for: 1 day, "
        "date: 2026-11-21}, noise: 1}  # c\n"
    )
    assert edited(text) == wanted


@pytest.mark.parametrize(
    "text",
    [
        "channels:\n  p:\n    unit: bar   # no calibration at all\n\n# end\nname: x\n",
        "channels:\n  p: {unit: bar}\nname: x\n",
        "channels:\n  p: {unit: bar,}\n",
        "channels: {p: {}}\n",
        "channels:\n  p:\n    unit: bar",
        "channels:\n  p:\n    calibration: {}   # empty\n",
        "channels:\n p:\n  calibration:\n   coefficients:\n    - 0\n    - 1   # slope\n   date:\n",
        "channels:\n p:\n  calibration:\n   date: >-\n    2026-01-01\n  # about noise\n  noise: 1\n",
        "channels:\r\n  p:\r\n    unit: bar\r\n    noise: 1\r\n",
        'channels:\n  "p":\n    calibration:\n      date: "2026-01-01" # quoted\n',
        "channels:\n p:\n  calibration:\n   coefficients: [0,\n             1]\n  unit: bar\n",
    ],
)
def test_any_yaml_layout_can_be_edited(text: str) -> None:
    after = edited(text)
    for line in text.splitlines():
        if "#" in line:
            assert line[line.index("#") :] in after
    assert after.count("\r\n") == (after.count("\n") if "\r\n" in text else 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &c {date: 1}\nchannels:\n  p:\n    calibration: *c\n", "alias of another part"),
        ("channels:\n  q: &q {unit: bar}\n  p: *q\n", "alias of another part"),
        ("channels:\n  p:\n    calibration: none\n", "'calibration' is no mapping"),
        ("channels:\n  q: {}\n", "'p' is not in the file"),
        (
            "channels:\n  p:\n    calibration:\n      coefficients: [0,  # offset\n                     1]\n",
            "a comment stands inside 'coefficients'",
        ),
    ],
)
def test_values_that_cannot_be_changed_individually_are_refused(text: str, message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        set_entries(text, ("channels", "p", "calibration"), NEW)


_COMMENT = st.text("abc #:{}[]'\"", max_size=12)


@given(
    st.integers(1, 6),
    _COMMENT,
    st.sampled_from(["block", "flow"]),
    st.permutations(["unit", "calibration", "x"]),
)
def test_editing_changes_no_other_byte_of_the_file(
    indent: int, comment: str, style: str, order: list[str]
) -> None:
    pad = " " * indent
    parts = {"unit": f"unit: bar  # {comment}", "x": f"x: [1, 2]  # {comment}"}
    parts["calibration"] = (
        f"calibration:  # {comment}\n{pad * 3}date: 2026-01-01  # {comment}"
        if style == "block"
        else f"calibration: {{date: 2026-01-01}}  # {comment}"
    )
    text = f"channels:\n{pad}p:\n" + "".join(f"{pad * 2}{parts[name]}\n" for name in order) + "name: end\n"
    after = edited(text)
    assert (
        after.replace("2026-11-21", "2026-01-01")
        .replace(f"{pad * 3}coefficients: [1.5, 2.5]\n", "")
        .replace(", coefficients: [1.5, 2.5]", "")
        == text
    )
