"""Clocks of several runs: which of them are one unknown, and what each is called."""

from __future__ import annotations

from rigctl.model.reading_errors import ClockError, clock_errors
from rigctl.rig.clock import Clock


def clock(*channels: str, stated: str = "50 ms") -> Clock:
    return Clock.model_validate({"channels": channels, "uncertainty": stated})


def errors(*runs: dict[str, Clock]) -> tuple[ClockError, ...]:
    return clock_errors({f"run-{number}": one for number, one in enumerate(runs)}, {"p", "x"})


def test_the_order_of_its_channels_makes_no_other_clock() -> None:
    (one,) = errors({"logger": clock("p", "x")}, {"logger": clock("x", "p")})
    assert one.runs == ()


def test_no_two_clocks_have_the_same_unknown() -> None:
    found = errors({"logger": clock("p", "x")}, {"logger": clock("x"), "logger_2": clock("p")})
    assert len({one.name for one in found}) == len(found) == 3


def test_the_clock_of_the_last_run_is_the_one_of_further_records() -> None:
    first, second = errors({"b": clock("p")}, {"b": clock("p", stated="20 ms")}, {"b": clock("p")})
    assert (first.latest, second.latest) == (True, False)
    assert first.runs == ("run-0", "run-2")


def test_another_offset_is_another_clock() -> None:
    """Its records are read at other times, and what is left of the offset is another number."""
    measured = clock("p").model_copy(update={"offset": 0.012})
    first, second = errors({"b": clock("p")}, {"b": measured})
    assert (first.offset, second.offset) == (0.0, 0.012)
    assert first.name != second.name
