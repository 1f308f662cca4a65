"""What Windows tells a console program, and what is done about it."""

from __future__ import annotations

import pytest

from rigctl.backends.console_end import handled


def test_a_closed_window_is_noted_before_the_wait_that_keeps_the_process() -> None:
    happened: list[str] = []
    assert handled(2, lambda: happened.append("noted"), lambda wait: happened.append(f"waits {wait > 5.0}"))
    assert happened == ["noted", "waits True"]


@pytest.mark.parametrize(
    ("event", "answered"),
    [
        pytest.param(0, False, id="Ctrl-C: the C library's signal"),
        pytest.param(1, False, id="Ctrl-Break: the C library's signal"),
        pytest.param(5, True, id="some user logs off: no signal, a service goes on"),
        pytest.param(6, False, id="a service at shutdown: the C library's signal"),
    ],
)
def test_nothing_else_is_an_end_of_the_console(event: int, answered: bool) -> None:
    happened: list[str] = []
    assert handled(event, lambda: happened.append("noted"), lambda _: happened.append("waits")) is answered
    assert happened == []
