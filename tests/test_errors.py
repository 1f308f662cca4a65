"""The error a user sees."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import (
    ExitCode,
    Location,
    RigctlError,
    SeveralErrors,
    nearest_name,
    shorten,
    unknown_name,
)


def test_a_message_has_location_problem_expectation_nearest_name_and_hint() -> None:
    error = RigctlError(
        "unknown field",
        value="rig_",
        expected="one of rig, steps",
        nearest="rig",
        hint="See 'rigctl schema procedure'",
        where=Location(Path("p.yaml"), 3, 7),
    )
    assert str(error) == (
        "p.yaml:3:7: unknown field, got 'rig_'; expected one of rig, steps; did you mean 'rig'? "
        "See 'rigctl schema procedure'"
    )
    assert error.exit_code is ExitCode.USAGE


def test_an_error_without_a_location_is_its_message_alone() -> None:
    assert str(RigctlError("no such run")) == "no such run"


def test_locations_print_as_path_and_line_and_fill_each_others_gaps() -> None:
    assert str(Location()) == ""
    assert str(Location(Path("a.yaml"))) == "a.yaml"
    assert str(Location(Path("a.yaml"), 3)) == "a.yaml:3"
    assert Location(None, 3).or_else(Location(Path("a.yaml"), 1, 2)) == Location(Path("a.yaml"), 3, 2)


def test_only_the_unknown_parts_of_a_location_are_filled_in() -> None:
    error = RigctlError("wrong", where=Location(line=3)).at(Location(Path("a.yaml"), 9, 1))
    assert error.where == Location(Path("a.yaml"), 3, 1)


def test_several_errors_are_shown_one_per_line() -> None:
    error = SeveralErrors([RigctlError("one"), RigctlError("two", exit_code=ExitCode.FAILED)])
    error.at(Location(Path("a.yaml")))
    assert str(error) == "a.yaml: one\na.yaml: two"
    assert error.where.file == Path("a.yaml")


def test_the_nearest_name_ignores_case_and_is_none_without_a_near_match() -> None:
    assert nearest_name("positon", ["position", "pressure"]) == "position"
    assert nearest_name("POSITION", ["position"]) == "position"
    assert nearest_name("xyz", ["position"]) is None
    assert nearest_name("x", []) is None


def test_an_unknown_name_is_reported_with_the_nearest_name_or_the_valid_ones() -> None:
    assert str(unknown_name("channel", "positon", ["position"])) == (
        "unknown channel, got 'positon'; did you mean 'position'?"
    )
    assert (
        str(unknown_name("channel", "zzz", ["b", "a"])) == "unknown channel, got 'zzz'; expected one of a, b"
    )
    assert str(unknown_name("channel", "zzz", [])) == "unknown channel, got 'zzz'"
    many = unknown_name("channel", "zzz", [f"a{i:02}" for i in range(20)])
    assert many.expected is not None
    assert many.expected.endswith("a11, …")


@given(st.text(max_size=200))
def test_a_quoted_value_stays_on_one_short_line(text: str) -> None:
    quoted = shorten(text)
    assert len(quoted) <= 60
    assert "\n" not in quoted
