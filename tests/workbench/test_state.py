"""Undo and redo of the workbench's state."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.workbench import State, Track

START = State({"area": 4e-6, "leak.conductance": 1e-15}, frozenset())

moves = st.one_of(
    st.tuples(st.just("move"), st.sampled_from(sorted(START.values)), st.floats(1e-18, 1.0)),
    st.tuples(st.just("switch"), st.sampled_from(("leak", "friction")), st.booleans()),
)


def made(state: State, move: tuple[str, str, float | bool]) -> State:
    kind, name, value = move
    return state.moved({name: float(value)}) if kind == "move" else state.switched([name], on=bool(value))


@given(st.lists(moves, max_size=12), st.data())
def test_undo_returns_the_same_states_and_redo_goes_forward_again(
    steps: list[tuple[str, str, float | bool]], data: st.DataObject
) -> None:
    track, seen = Track(START), [START]
    for step in steps:
        state = made(track.present, step)
        track = track.then(state)
        if state != seen[-1]:
            seen.append(state)
    back = data.draw(st.integers(0, len(seen) - 1))
    for expected in reversed(seen[: len(seen) - 1][len(seen) - 1 - back :]):
        track = track.undone()
        assert track.present == expected
    for expected in seen[len(seen) - back :]:
        track = track.redone()
        assert track.present == expected


def test_a_step_after_undo_discards_the_undone_steps() -> None:
    track = Track(START).then(START.switched(["leak"], on=True)).undone()
    other = track.then(START.moved({"area": 5e-6}))
    with pytest.raises(RigctlError, match="nothing to redo"):
        other.redone()
    assert other.undone().present == START
    with pytest.raises(RigctlError, match="nothing to undo"):
        Track(START).undone()


def test_the_size_of_an_effect_that_is_off_is_remembered() -> None:
    sized = START.switched(["leak"], on=True).moved({"leak.conductance": 3e-15})
    assert sized.switched(["leak"], on=False).switched(["leak"], on=True) == sized


def test_an_unknown_slider_is_refused_by_name() -> None:
    with pytest.raises(RigctlError, match="slider"):
        START.moved({"aera": 1.0})
