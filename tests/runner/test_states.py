"""The table of run states and transitions, and the page generated from it."""

from __future__ import annotations

import pytest

from rigctl.runner.states import EVENTS, STATES, Lifecycle, RunState, transitions


def follow(*events: str) -> list[RunState]:
    seen: list[RunState] = []
    life = Lifecycle(lambda _before, _event, after: seen.append(after))
    for event in events:
        life.send(event)
    assert life.state is seen[-1]
    return seen


def test_a_successful_run_passes_through_the_expected_states() -> None:
    states = follow("arm", "start", "pause", "go_on", "finish", "succeed")
    assert [s.value for s in states] == ["arming", "running", "paused", "running", "finishing", "finished"]


def test_safe_can_be_reached_from_every_state_that_is_not_an_end() -> None:
    sources = {source for source, event, target in transitions() if target is RunState.SAFE}
    assert sources == {state for state in RunState if not state.ended}


def test_end_states_have_no_transition_out_and_are_entered_only_from_finishing() -> None:
    assert not [source for source, _, _ in transitions() if source.ended]
    assert {source for source, _, target in transitions() if target.ended} == {RunState.FINISHING}


def test_a_transition_that_is_not_in_the_table_is_an_error() -> None:
    life = Lifecycle(lambda *_: None)
    with pytest.raises(Exception, match="Can't"):
        life.send("go_on")


def test_every_state_and_event_is_explained() -> None:
    assert set(STATES) == set(RunState)
    assert set(EVENTS) == {event for _, event, _ in transitions()}
