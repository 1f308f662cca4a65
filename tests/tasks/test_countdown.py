"""The count and the time left of a long loop."""

from __future__ import annotations

from rigctl.tasks import Countdown, counted


def test_the_time_left_is_that_of_the_pieces_done_so_far() -> None:
    said: list[str] = []
    clock = [0.0]
    countdown = Countdown("Refitting", said.append, now=lambda: clock[0])
    for number in range(1, 4):
        countdown.begin(number, 3)
        clock[0] += 40.0
    countdown(3, 3)
    assert said == [
        "Refitting: 1 of 3",
        "Refitting: 2 of 3, about 1 min 20 s left",
        "Refitting: 3 of 3, about 40 s left",
        "Refitting: 3 of 3",
    ]


def test_a_single_piece_is_not_counted_and_none_is_not_mentioned() -> None:
    said: list[str] = []
    assert list(counted(["leak"], "Refitting", said.append)) == ["leak"]
    assert list(counted([], "Exchanging", said.append)) == []
    assert said == ["Refitting"]
