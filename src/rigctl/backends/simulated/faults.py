"""Faults that can be injected: ``KIND[:CHANNEL]@TIME`` or ``KIND[:CHANNEL]@TIME..TIME``.

With ``sensor_stuck:position@12 s`` the reading is stuck from 12 s after opening the bench until the end;
``samples_stop@30 s..33 s`` ends after three seconds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig import Rig
from rigctl.units import read_si

#: kind -> its effect, as described in the help text
KINDS: Mapping[str, str] = {
    "sensor_stuck": "the channel holds the value it has then",
    "sensor_open": "the channel gives no value any more",
    "sensor_noisy": "the channel's noise grows to a tenth of its range",
    "sensor_out_of_range": "the channel reads beyond what is physically possible",
    "heater_stuck_on": "the heater heats, whatever it is told",
    "valve_stuck": "the directional valve stays where it is",
    "setpoint_never_reached": "what drives the channel (all of them, if none is named) has no effect",
    "samples_stop": "the bench stops sampling, but obeys",
    "backend_lost": "the bench cannot be reached; its watchdog makes it safe",
}

_GRAMMAR = re.compile(r"^\s*([^:@]*?)\s*(?::\s*([^@]*?)\s*)?@\s*(.+?)\s*(?:\.\.\s*(.+?)\s*)?$")
_EXPECTED = "KIND@TIME, KIND:CHANNEL@TIME or KIND@TIME..TIME, e.g. 'sensor_stuck:position@12 s'"


@dataclass(frozen=True)
class Fault:
    """A fault between two times.

    Parameters
    ----------
    kind: one of `KINDS`.
    channel: the affected channel, if the kind needs one or the user named one.
    begin, end: s since the bench was opened; `end` is infinite for a permanent fault.
    """

    kind: str
    channel: str | None
    begin: float
    end: float = math.inf

    def __str__(self) -> str:
        target = f":{self.channel}" if self.channel else ""
        until = "" if math.isinf(self.end) else f"..{self.end:g} s"
        return f"{self.kind}{target}@{self.begin:g} s{until}"


def parse_fault(text: str, rig: Rig) -> Fault:
    """Read one fault and check it against the rig.

    Raises
    ------
    RigctlError
        the text is not a fault, or its kind, channel or time is invalid; the message names the nearest valid
        one.
    """
    match = _GRAMMAR.match(text)
    if not match:
        raise RigctlError("not a fault", value=text, expected=_EXPECTED)
    kind, channel, begin_text, end_text = match.groups()
    if kind not in KINDS:
        raise unknown_name("fault", kind, KINDS)
    begin = _time(text, begin_text)
    end = math.inf if end_text is None else _time(text, end_text)
    if end <= begin:
        raise RigctlError("the fault ends before it begins", value=text, expected="a later second time")
    _check_target(text, kind, channel, rig)
    return Fault(kind, channel or None, begin, end)


def _time(fault: str, text: str) -> float:
    try:
        time = read_si(text, "s")
    except RigctlError as problem:
        raise RigctlError(
            f"the fault's time: {problem.what}",
            value=text,
            expected=problem.expected or "e.g. '12 s' or '5 min'",
            nearest=problem.nearest,
        ) from problem
    if time < 0.0:
        raise RigctlError("the fault's time is before the start", value=fault, expected="0 s or later")
    return time


def _check_target(text: str, kind: str, channel: str | None, rig: Rig) -> None:
    """Check that the rig has the channel of a fault, and the actuator that it affects."""
    by_channel = controlled_channels(rig)
    if kind.startswith("sensor_"):
        if not channel:
            raise RigctlError(f"{kind} needs a channel", value=text, expected=f"{kind}:CHANNEL@TIME")
        if channel not in rig.channels:
            raise unknown_name("channel", channel, rig.channels)
    elif kind == "setpoint_never_reached":
        if channel and channel not in by_channel:
            raise unknown_name("controlled channel", channel, by_channel)
        if not by_channel:
            raise RigctlError("nothing on this rig controls a channel", value=text)
    elif channel:
        raise RigctlError(f"{kind} takes no channel", value=text, expected=f"{kind}@TIME")
    elif kind == "heater_stuck_on" and rig.roles.heat is None:
        raise RigctlError("this rig has no heater", value=text, expected="a rig with the role 'heat'")
    elif kind == "valve_stuck" and not directional_valves(rig):
        raise RigctlError("this rig has no directional valve", value=text)


def seized_by(fault: Fault, rig: Rig) -> dict[str, float | None]:
    """Return the actuators that ignore commands, each with the SI value at which it sticks; None: its present
    one."""
    if fault.kind == "heater_stuck_on" and rig.roles.heat is not None:
        heater = rig.roles.heat.actuator
        return {heater: full_value(rig, heater)}
    if fault.kind == "valve_stuck":
        return dict.fromkeys(directional_valves(rig))
    if fault.kind == "setpoint_never_reached":
        return {
            actuator: 0.0 if rig.actuators[actuator].kind == "switch" else None
            for channel, actuator in controlled_channels(rig).items()
            if fault.channel in (None, channel)
        }
    return {}


def full_value(rig: Rig, actuator: str) -> float:
    """Return the largest SI value of a switch or a level."""
    high = rig.actuators[actuator].high
    return 1.0 if high is None else float(high)


def controlled_channels(rig: Rig) -> dict[str, str]:
    """Return the channels controlled by an actuator, each with that actuator."""
    roles = (rig.roles.heat, rig.roles.set_pressure)
    return {role.channel: role.actuator for role in roles if role is not None}


def directional_valves(rig: Rig) -> tuple[str, ...]:
    """Return the actuators that are directional valves."""
    return tuple(name for name, actuator in rig.actuators.items() if actuator.kind == "directional_valve")
