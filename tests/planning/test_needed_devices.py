"""A step that needs a device without which a run may go on is refused, whatever kind of step it is."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.planning.lost_devices import refuse_needed
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import parse_rig

RIG = """\
name: two
devices:
  a: {kind: simulated}
  spare: {kind: simulated, lost: continue}
channels:
  va: {device: a, unit: V, quantity: voltage}
  ta: {device: a, unit: degC, quantity: temperature}
  vs: {device: spare, unit: V, quantity: voltage}
  ts: {device: spare, unit: degC, quantity: temperature}
actuators:
  heater: {device: a, kind: switch}
  level: {device: a, kind: level, unit: V, low: 0 V, high: 10 V}
  knob: {device: spare, kind: switch, by: operator}
roles:
  heat: {actuator: heater, channel: ts}
safe_state: {heater: off, level: 0 V}
"""


@pytest.mark.parametrize(
    ("step", "needed"),
    [
        ("wait: {until: vs > 1 V, timeout: 9 s}", "vs"),
        ("measure: {name: m, value: mean(vs), unit: V, last: 1 s}", "vs"),
        ("hold: {channel: vs, at: 1 V, within: 1 V, for: 2 s}", "vs"),
        ("heat: {to: 50 degC}", "ts"),
        ("set: {knob: on}", "knob"),
        ("control: {actuator: level, channel: vs, to: 3 V, gain: 1, rate: 10 Hz, for: 3 s}", "vs"),
        ("control: {actuator: level, channel: va, to: 3 V, gain: 1, feed_forward: vs, for: 3 s}", "vs"),
        ("if: vs > 1 V\n    do: [wait: 1 s]", "vs"),
        ("while: vs > 1 V\n    do: [wait: 1 s]\n    at_most: 3", "vs"),
    ],
)  # fmt: skip
def test_each_kind_of_step_that_needs_it_is_named(step: str, needed: str) -> None:
    procedure = parse_procedure(f"procedure: p\nsteps:\n  - wait: 1 s\n  - {step}\n")
    with pytest.raises(RigctlError, match=rf"\(line 4\) needs {needed}\b"):
        refuse_needed(expand(procedure, parse_rig(RIG)))
    refuse_needed(expand(procedure, parse_rig(RIG.replace("lost: continue", "lost: pause"))))


def test_steps_of_cleanup_blocks_count_too() -> None:
    text = "procedure: p\nsteps: [wait: 1 s]\nfinally:\n  - wait: {until: vs > 1 V, timeout: 9 s}\n"
    with pytest.raises(RigctlError, match=r"\(line 4\) needs vs"):
        refuse_needed(expand(parse_procedure(text), parse_rig(RIG)))


def test_a_record_needs_no_device() -> None:
    text = (
        "procedure: p\nsteps:\n  - record: {name: r, rate: 10 Hz, channels: [va, vs]}\n    do: [wait: 1 s]\n"
    )
    refuse_needed(expand(parse_procedure(text), parse_rig(RIG)))


def test_a_limit_on_an_output_that_it_has_counts() -> None:
    text = RIG + "limits:\n  stuck: {channel: va, unchanged: 9 s, while_on: knob, action: warn}\n"
    with pytest.raises(RigctlError, match="cannot go on without 'spare': limit 'stuck' needs knob"):
        parse_rig(text)
