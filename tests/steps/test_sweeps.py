"""Sweeps: lists, ranges, nesting, pairing, repetition, order; and how many points they have."""

from __future__ import annotations

from collections.abc import Callable
from math import prod

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.plan import Group, GroupKind, Plan, RecordNode, walk
from rigctl.plan.sweep import combine, paired, repeated, shuffled, spaced, stepped
from rigctl.units import Quantity, parse_quantity, parse_unit


def allow(count: int) -> None:
    assert count >= 0


def points(plan: Plan) -> list[dict[str, str]]:
    """The values of every iteration in order."""
    return [
        dict(node.bindings)
        for node in walk(plan.root)
        if isinstance(node, Group) and node.kind is GroupKind.ITERATION
    ]


def sweep(text: str) -> str:
    return f"- for: {text}\n  do: [wait: 1 s]"


SECONDS = parse_unit("s")


def in_seconds(values: list[int]) -> list[Quantity]:
    return [Quantity(float(value), SECONDS) for value in values]


def test_a_list_keeps_its_units_and_order(steps: Callable[..., Plan]) -> None:
    plan = steps(sweep("{oil: [20 degC, 313.15 K, 30 degC]}"))
    assert [point["oil"] for point in points(plan)] == ["20 degC", "313.15 K", "30 degC"]


def test_a_range_includes_both_ends(steps: Callable[..., Plan]) -> None:
    plan = steps(sweep("{oil: {from: 20 degC, to: 80 degC, step: 10 K}}"))
    assert [point["oil"] for point in points(plan)] == [f"{t} degC" for t in range(20, 90, 10)]


def test_a_range_may_descend_and_never_passes_its_end(steps: Callable[..., Plan]) -> None:
    plan = steps(sweep("{p: {from: 50 bar, to: 1.5 MPa, step: -10 bar}}"))
    assert [point["p"] for point in points(plan)] == ["50 bar", "40 bar", "30 bar", "20 bar"]


def test_a_range_can_be_given_by_its_number_of_points(steps: Callable[..., Plan]) -> None:
    plan = steps(sweep("{x: {from: 0 mm, to: 0.1 m, count: 5}}"))
    assert [point["x"] for point in points(plan)] == ["0 mm", "25 mm", "50 mm", "75 mm", "100 mm"]


def test_several_variables_are_nested_in_the_order_given(steps: Callable[..., Plan]) -> None:
    plan = steps(sweep("{a: [1 s, 2 s], b: [3 s, 4 s]}"))
    assert [(p["a"], p["b"]) for p in points(plan)] == [
        ("1 s", "3 s"), ("1 s", "4 s"), ("2 s", "3 s"), ("2 s", "4 s")
    ]  # fmt: skip


def test_zip_pairs_the_values_of_several_variables(steps: Callable[..., Plan]) -> None:
    plan = steps("- for: {a: [1 s, 2 s], b: [3 s, 4 s]}\n  zip: true\n  do: [wait: $a + $b]")
    assert [(p["a"], p["b"]) for p in points(plan)] == [("1 s", "3 s"), ("2 s", "4 s")]


def test_repeat_visits_all_points_again(steps: Callable[..., Plan]) -> None:
    plan = steps("- for: {a: [1 s, 2 s]}\n  repeat: 2\n  do: [wait: $a]")
    assert [p["a"] for p in points(plan)] == ["1 s", "2 s", "1 s", "2 s"]
    paths = [node.path for node in walk(plan.root)]
    assert len(set(paths)) == len(paths)
    assert "1/for[a=1 s (2)]" in paths


def test_repeat_zero_omits_the_sweep(steps: Callable[..., Plan]) -> None:
    assert points(steps("- for: {a: [1 s, 2 s]}\n  repeat: 0\n  do: [wait: $a]")) == []


def test_shuffle_is_seeded_and_zero_keeps_the_order(steps: Callable[..., Plan]) -> None:
    def order(seed: int) -> list[str]:
        text = f"- for: {{a: {{from: 1 s, to: 12 s, step: 1 s}}}}\n  shuffle: {seed}\n  do: [wait: $a]"
        return [p["a"] for p in points(steps(text))]

    written = [f"{n} s" for n in range(1, 13)]
    assert order(0) == written
    assert order(7) == order(7) != written
    assert order(7) != order(8)
    assert sorted(order(7)) == sorted(written)


def test_an_inner_sweep_has_another_order_at_each_outer_point(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - for: {a: [1 s, 2 s, 3 s]}
          do:
            - for: {b: {from: 1 s, to: 8 s, step: 1 s}}
              shuffle: 3
              do: [wait: $b]
        """)
    inner = [p["b"] for p in points(plan) if "b" in p]
    assert len({tuple(inner[start : start + 8]) for start in (0, 8, 16)}) == 3


def test_records_have_the_values_of_all_enclosing_sweeps(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - for: {oil: [20 degC, 30 degC]}
          do:
            - for: {supply: [20 bar, 30 bar]}
              do:
                - record: {name: r}
                  do: [wait: 1 s]
        """)
    records = [node for node in walk(plan.root) if isinstance(node, RecordNode)]
    assert [dict(record.sweep) for record in records][1] == {"oil": (293.15, "degC"), "supply": (3e6, "bar")}
    assert records[1].path == "1/for[oil=20 degC]/1/for[supply=30 bar]/1/record"


def test_sweep_values_may_be_expressions_of_outer_variables(steps: Callable[..., Plan]) -> None:
    plan = steps("""
        - for: {oil: [20 degC, 30 degC], more: [1 K]}
          do:
            - for: {warmer: [$oil + 5 K, $oil - $more]}
              do:
                - heat: {to: $warmer, within: $more / 2}
        """)
    wanted = [p["warmer"] for p in points(plan) if "warmer" in p]
    assert wanted == ["25 degC", "19 degC", "35 degC", "29 degC"]


@pytest.mark.parametrize(
    ("text", "place", "pieces"),
    [
        ("{a: []}", "3:14", ["this sweep is empty", "at least one value"]),
        ("{}", "3:10", ["too few entries"]),
        ("{a: 3 s}", "3:14", ["this is not a sweep", "'3 s'", "{from, to, step}"]),
        ("{a: }", "3:13", ["this is not a sweep"]),
        ("{a: [1 s, 2 bar]}", "3:20", ["different dimensions", "'2 bar'", "a value like '1 s'"]),
        ("{a: [20, 40 bar]}", "3:15", ["the unit is missing, got '20'", "a value like '40 bar'"]),
        ("{a: [20 bar, 40]}", "3:23", ["the unit is missing, got '40'", "a value like '20 bar'"]),
        ("{a: [1 s, x]}", "3:20", ["not a quantity", "'x'"]),
        ("{a: {from: 1 s, to: 5 s}}", "3:14", ["a range needs a spacing", "'step' or 'count'"]),
        ("{a: {from: 1 s, to: 5 s, step: 0 s}}", "3:41", ["the step of a range is zero"]),
        ("{a: {from: 1 s, to: 5 s, step: -1 s}}", "3:41", ["leads away from 'to'", "a positive step"]),
        ("{a: {from: 1 s, to: 5 s, step: 1 bar}}", "3:41", ["wrong dimension", "'1 bar'"]),
        ("{a: {from: 1 s, to: 5 bar, step: 1 s}}", "3:30", ["wrong dimension", "'5 bar'"]),
        ("{a: {from: 1 s, to: 5 s, count: 0}}", "3:42", ["this sweep is empty"]),
        ("{a: {from: 1 s, to: 5 s, stepp: 1 s}}", "3:35", ["did you mean 'step'?"]),
        ("{a: {from: 1 s, to: 1e9 s, step: 1 s}}", "3:43", ["plan grows too large", "at most 100000"]),
        ("{a: {from: 1 s, to: 2 s, step: 1e-300 s}}", "3:41", ["plan grows too large"]),
        (
            "{a: {from: 1, to: 400, step: 1}, b: {from: 1, to: 400, step: 1}}",
            "3:10",
            ["plan grows too large"],
        ),
        ("{1a: [1 s]}", "3:11", ["no name", "'1a'"]),
        ("{a: $b}", "3:14", ["unknown variable", "'b'"]),
    ],
)
def test_mistakes_in_a_sweep_are_reported_with_their_place(
    planned: Callable[..., Plan], text: str, place: str, pieces: list[str]
) -> None:
    with pytest.raises(RigctlError) as caught:
        planned(f"steps:\n  - for: {text}\n    do: [wait: 1 s]\n")
    message = str(caught.value)
    assert f"test.yaml:{place}: " in message
    for piece in pieces:
        assert piece in message


def test_redefining_a_variable_in_an_inner_sweep_is_refused(steps: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match="this variable exists already"):
        steps("- for: {a: [1 s]}\n  do:\n    - for: {a: [2 s]}\n      do: [wait: $a]")


def test_zip_needs_lists_of_one_length(steps: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match="a has 2, b has 1"):
        steps("- for: {a: [1 s, 2 s], b: [3 s]}\n  zip: true\n  do: [wait: $a]")


def test_set_points_in_a_sweep_are_checked_when_the_plan_is_made(steps: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match=r"'relief_valve', got '60 bar'; expected 10 bar to 55 bar"):
        steps("- for: {p: [20 bar, 60 bar]}\n  do: [set_pressure: $p]")


def test_a_value_that_a_step_refuses_is_located_in_the_list(planned: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError) as caught:
        planned("steps:\n  - for: {supply: [20 bar, 99 bar, 30 bar]}\n    do: [set_pressure: $supply]\n")
    text = str(caught.value)
    line, column = caught.value.where.line, caught.value.where.column
    assert "got '99 bar'" in text
    assert f"Line {(line or 0) + 1} refuses it" in text
    assert column == len("  - for: {supply: [20 bar, ") + 1


@given(st.lists(st.integers(1, 5), min_size=1, max_size=4))
def test_nested_sweeps_have_the_product_of_their_sizes(sizes: list[int]) -> None:
    axes = {f"v{i}": in_seconds(list(range(size))) for i, size in enumerate(sizes)}
    found = combine(axes, allow)
    assert len(found) == prod(sizes)
    assert len({tuple(point.items()) for point in found}) == prod(sizes)


@given(st.lists(st.integers(), min_size=0, max_size=30), st.integers(1, 2**32 - 1), st.text(max_size=5))
def test_shuffling_is_a_permutation_reproducible_from_its_seed(
    values: list[int], seed: int, place: str
) -> None:
    before = [{"a": value} for value in in_seconds(values)]
    after = shuffled(before, seed, place)
    assert after == shuffled(before, seed, place)
    assert sorted(p["a"].value for p in after) == sorted(p["a"].value for p in before)


def test_the_shuffled_order_of_a_seed_does_not_change_between_versions() -> None:
    before = [{"a": value} for value in in_seconds(list(range(6)))]
    assert [int(p["a"].value) for p in shuffled(before, 1, "1/for")] == [1, 0, 3, 2, 4, 5]


@given(st.lists(st.integers(), min_size=1, max_size=5), st.integers(0, 4))
def test_repetition_repeats_the_points_in_order(values: list[int], times: int) -> None:
    before = [{"a": value} for value in in_seconds(values)]
    assert repeated(before, times) == before * times


@given(st.integers(1, 30), st.integers(1, 30))
def test_lists_of_different_lengths_cannot_be_paired(first: int, second: int) -> None:
    axes = {"a": in_seconds([0] * first), "b": in_seconds([0] * second)}
    if first == second:
        assert len(paired(axes)) == first
    else:
        with pytest.raises(RigctlError, match="lists of one length"):
            paired(axes)


@given(st.integers(-1000, 1000), st.integers(1, 200), st.integers(1, 400))
def test_a_stepped_range_reaches_its_end_and_equals_even_spacing(first: int, count: int, step: int) -> None:
    begin, size = Quantity(first / 10.0, SECONDS), step / 10.0
    end = begin.value + (count - 1) * size
    values = stepped(begin, end, size, allow)
    assert len(values) == count
    assert values[-1].value == pytest.approx(end, abs=1e-9)
    assert [v.value for v in spaced(begin, end, count)] == pytest.approx([v.value for v in values])


def test_stepped_values_have_no_rounding_noise() -> None:
    values = stepped(parse_quantity("0 s"), 1.0, 0.1, allow)
    assert [str(value) for value in values[:4]] == ["0 s", "0.1 s", "0.2 s", "0.3 s"]
    assert values[3].value == 0.3
