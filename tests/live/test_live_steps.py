"""Where a run is in its plan."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from live.shipped import campaign
from rigctl.live.steps import PlanPlaces, Stage, outline
from rigctl.plan import Leaf, Loop, Plan, iteration_path, walk


def test_only_the_sweep_in_progress_is_expanded(plan: Plan) -> None:
    place = "2/for[oil=40 degC]/2/for[supply=30 bar]/1/call/3/record/2/extend"
    lines = outline(PlanPlaces(plan), place, most=30)
    shown = [(line.depth, line.label, line.stage, line.note) for line in lines]
    assert (0, "do 7 steps", Stage.DONE, "") in shown
    assert (1, "oil=40 degC", Stage.CURRENT, "3 of 7") in shown
    assert (3, "supply=30 bar", Stage.CURRENT, "2 of 4") in shown
    current = [line for line in lines if line.stage is Stage.CURRENT]
    assert current[-1].label == "extend for 1.05 s"
    assert [line.depth for line in current] == list(range(len(current)))


def test_every_step_of_the_campaign_is_shown(plan: Plan) -> None:
    places = PlanPlaces(plan)
    for node in walk(plan.root):
        if isinstance(node, Leaf):
            lines = outline(places, node.path, most=12)
            current = [line for line in lines if line.stage is Stage.CURRENT]
            assert current[-1].label == node.label


@given(data=st.data(), most=st.integers(0, 40))
def test_the_view_fits_and_keeps_the_plan_s_order(data: st.DataObject, most: int) -> None:
    plan = campaign()
    places = PlanPlaces(plan)
    leaf = data.draw(st.sampled_from([node for node in walk(plan.root) if isinstance(node, Leaf)]))
    lines = outline(places, leaf.path, most)
    current = [line for line in lines if line.stage is Stage.CURRENT]
    assert len(lines) <= max(most, len(current))
    for depth in range(len(current)):
        stages = [line.stage for line in lines if line.depth == depth]
        order = [Stage.DONE, Stage.CURRENT, Stage.AHEAD]
        assert stages == sorted(stages, key=order.index)


def test_rounds_of_a_loop_are_counted(looping: Plan) -> None:
    loop = next(node for node in walk(looping.root) if isinstance(node, Loop))
    leaf = next(node for node in walk(loop) if isinstance(node, Leaf))
    lines = outline(PlanPlaces(looping), iteration_path(loop, 2, leaf.path), most=10)
    assert [line.note for line in lines if line.stage is Stage.CURRENT] == ["round 2 of 3", ""]
    assert [line.label for line in lines if line.stage is Stage.AHEAD] == ["wait 2 s"]


def test_cleanup_steps_appear_in_the_outline(looping: Plan) -> None:
    assert looping.finally_ is not None
    cleanup = next(node for node in walk(looping.finally_) if isinstance(node, Leaf))
    assert outline(PlanPlaces(looping), cleanup.path, most=10)[-1].label == cleanup.label


def test_an_unknown_step_path_shows_nothing(plan: Plan) -> None:
    places = PlanPlaces(plan)
    assert outline(places, "", most=10) == []
    assert outline(places, "9/nowhere", most=10) == []
    assert places.record("9/nowhere") is None


def test_the_record_of_a_step_is_found_from_its_path(plan: Plan) -> None:
    record = PlanPlaces(plan).record("2/for[oil=40 degC]/2/for[supply=30 bar]/1/call/3/record/2/extend")
    assert record is not None
    assert record.name == "stroke"
