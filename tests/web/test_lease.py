"""Who may command a run: one window, until it gives up the controls, loses them, or is closed."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.web.lease import Lease


@pytest.fixture
def lease() -> Lease:
    made = Lease()
    for viewer in ("a", "b"):
        made.connected(viewer)
    made.take("a", over=False)
    return made


def test_one_window_commands_until_another_takes_over(lease: Lease) -> None:
    with pytest.raises(RigctlError, match="window 1 has the controls"):
        lease.take("b", over=False)
    lease.take("a", over=False)
    assert (lease.seen_by("a")["mine"], lease.seen_by("b")["mine"], lease.seen_by("b")["holder"]) == (
        True,
        False,
        1,
    )
    lease.take("b", over=True)
    assert (lease.seen_by("a")["mine"], lease.seen_by("b")["mine"]) == (False, True)
    lease.give("a")  # it does not hold the controls
    assert lease.seen_by("b")["mine"] is True
    lease.give("b")
    lease.take("a", over=False)


def test_a_window_keeps_the_controls_only_for_the_time_of_a_reload(lease: Lease) -> None:
    lease.disconnected("a")
    with pytest.raises(RigctlError, match="has the controls"):
        lease.take("b", over=False)
    lease._windows["a"].seen -= 10.0
    assert lease.seen_by("b")["holder"] is None
    lease.take("b", over=False)
    assert lease.seen_by("b") == {"holder": 2, "mine": True, "window": 2, "viewers": 1}


def test_a_window_with_two_connections_is_closed_with_the_second(lease: Lease) -> None:
    lease.connected("a")
    lease.disconnected("a")
    lease._windows["a"].seen -= 10.0
    with pytest.raises(RigctlError, match="has the controls"):
        lease.take("b", over=False)


def test_taking_the_controls_requires_a_name(lease: Lease) -> None:
    with pytest.raises(RigctlError, match="needs a name"):
        lease.take("", over=True)
