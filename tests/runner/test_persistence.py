"""How long a signal has been outside, as counted from all of its readings each time."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from rigctl.runner.persistence import Persistence


@given(
    st.sampled_from([0.125, 0.25, 1.0]),
    st.sampled_from([0.0, 0.5, 1.0, 3.0]),
    st.sampled_from([1.0, 2.0, 4.0, 16.0]),
    st.lists(st.booleans(), min_size=1, max_size=70),
)
@example(0.25, 0.5, 2.0, [True, False] * 3 + [False] * 9 + [True, False] * 3)
@example(1.0, 3.0, 2.0, [True, False] * 20)
@example(1.0, 0.5, 16.0, [True, False, True, False, True, False])
@example(1.0, 1.0, 1.0, [True, True, False, True, True])
def test_outside_without_a_break_or_for_its_share_of_the_window_is_long_enough(
    step: float, duration: float, times: float, flags: list[bool]
) -> None:
    """The steps are powers of two, so that sums of them are exact."""
    one = Persistence(duration, times * duration)
    window = max(times * duration, 8.0 * step)
    run = 0.0
    for index, outside in enumerate(flags):
        now = index * step
        recent = [j for j in range(index + 1) if j * step >= now - window]
        known = sum(flags[j] for j in recent)
        lasted = step * sum(flags[j] for j in recent if j < index)
        if outside:
            run = run if index and flags[index - 1] else now
            share = known >= 3 and lasted * times >= window
            assert one.outside(now) is (now - run >= duration or share)
            assert one.share[0] == known
            assert one.unbroken(now) is (now - run >= duration)
        else:
            one.inside(now)
            assert not one.unbroken(now)
        assert one.calm is (known == 0)


def test_rounding_of_times_neither_delays_nor_shortens() -> None:
    one = Persistence(0.05, 0.1)
    assert not one.outside(0.9)
    assert not one.outside(0.9495)
    assert one.outside(0.95)
    assert 0.95 - 0.9 < 0.05
