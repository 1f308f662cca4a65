"""Channels that are temperature differences."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.plan import Leaf, walk
from rigctl.plan.action import SetPoint
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import parse_rig
from rigctl.runner.interlocks import Interlocks

RIG = """
name: exchanger
channels:
  rise: {{unit: degC, quantity: temperature, difference: true, range: [{low}, 50 K]}}
actuators:
  pump: {{kind: level, unit: "%", low: 0 %, high: 100 %}}
safe_state: {{pump: 0 %}}
limits:
  too_much: {{channel: rise, above: {bound}}}
simulation:
  initial: {{rise: {initial}}}
"""
EXCHANGER = RIG.format(low="-50 K", bound="5 K", initial="0 K")


def set_point(step: str) -> SetPoint | None:
    """The set-point of a single step."""
    plan = expand(parse_procedure(f"procedure: p\nsteps:\n  - {step}\n"), parse_rig(EXCHANGER), {})
    (leaf,) = (node for node in walk(plan.root) if isinstance(node, Leaf))
    return leaf.action.set_point()


def test_a_limit_of_a_difference_is_an_interval() -> None:
    assert parse_rig(EXCHANGER).limits["too_much"].threshold == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("low", "bound", "initial"),
    [("-50 K", "5 degC", "0 K"), ("-50 degC", "5 K", "0 K"), ("-50 K", "5 K", "1 degC")],
)
def test_a_difference_in_celsius_in_the_rig_file_is_refused(low: str, bound: str, initial: str) -> None:
    with pytest.raises(RigctlError, match=r"temperature difference.*kelvin"):
        parse_rig(RIG.format(low=low, bound=bound, initial=initial))


@pytest.mark.parametrize(
    "step",
    [
        "hold: {for: 1 s, channel: rise, at: AT, within: 0.5 K}",
        "control: {actuator: pump, channel: rise, to: AT, gain: 1 %/K, for: 1 s}",
    ],
)
def test_the_set_point_of_a_difference_is_an_interval_also_in_celsius(step: str) -> None:
    for text in ("2 K", "2 degC"):
        found = set_point(step.replace("AT", text))
        assert found is not None
        assert found.to == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("at", "told"),
    [("6 K", "'too_much' of 'rise', got '6 K'; expected at most 5 K"), ("60 K", "expected -50 K to 50 K")],
)
def test_a_refused_set_point_of_a_difference_is_shown_in_kelvin(at: str, told: str) -> None:
    with pytest.raises(RigctlError, match=told):
        set_point(f"hold: {{for: 1 s, channel: rise, at: {at}, within: 0.5 K}}")


def test_an_impossible_difference_is_shown_in_kelvin() -> None:
    interlocks = Interlocks(parse_rig(EXCHANGER))
    alarms = [alarm for time in (0.0, 2.0) for alarm in interlocks.check((time, -1.0, -60.0, 0.0))]
    assert [alarm.message for alarm in alarms] == [
        "rise reads -60 K, which is impossible: sensor or line broken"
    ]
