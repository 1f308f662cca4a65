"""The wiring: which input or output of the board each channel and actuator is connected to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig import Rig

#: the board's inputs, and their default channels
INPUTS = ("A0", "A1", "A2")
_QUANTITIES = {"pressure": "A0", "position": "A1", "temperature": "A2"}
#: the board's outputs, and the kind of actuator for each
OUTPUTS = {"heater": "switch", "valve": "directional_valve", "pressure": "level"}
BITS = 10  #: resolution of the board's converter, bits


@dataclass(frozen=True)
class Wiring:
    """Connections of a rig to the board.

    Parameters
    ----------
    inputs: for each channel of the rig's layout, the index of its input.
    outputs: the board's output -> the actuator on it.
    """

    inputs: tuple[int, ...]
    outputs: Mapping[str, str]

    def output_of(self, actuator: str) -> str:
        """Return the board's output to which an actuator is connected.

        Raises
        ------
        RigctlError
            it is connected to none, since it is operated by hand.
        """
        placed = {name: output for output, name in self.outputs.items()}
        if actuator not in placed:
            raise RigctlError("this actuator is on no output of the board", value=actuator)
        return placed[actuator]


def wiring_of(rig: Rig, options: Mapping[str, object]) -> Wiring:
    """Return the connections from the backend's options ``inputs`` and ``outputs``, or else the defaults.

    By default the rig's only pressure is on A0, its only position on A1 and its only temperature on A2; a
    driven switch is on the heater's relay, a driven directional valve on the solenoids, and a driven level on
    the relief valve's PWM.

    Raises
    ------
    RigctlError
        a channel or a driven actuator has no connection, or two share one.
    """
    inputs = _inputs(rig, _mapping("inputs", options.get("inputs")))
    outputs = _outputs(rig, _mapping("outputs", options.get("outputs")))
    return Wiring(tuple(INPUTS.index(inputs[name]) for name in rig.layout.channels), outputs)


def _mapping(name: str, given: object) -> Mapping[str, str]:
    if given is None:
        return {}
    if isinstance(given, Mapping) and all(isinstance(value, str) for value in given.values()):
        return {str(key): str(value) for key, value in given.items()}
    raise RigctlError(
        f"{name} says what is on which connection", value=str(given), expected="{position: A1, …}"
    )


def _inputs(rig: Rig, given: Mapping[str, str]) -> dict[str, str]:
    for name, wanted in given.items():
        if name not in rig.channels:
            raise unknown_name("channel", name, rig.channels)
        if wanted not in INPUTS:
            raise unknown_name("input of the board", wanted, INPUTS)
    chosen: dict[str, str] = {}
    for name, channel in rig.channels.items():
        pin: str | None = given.get(name) or _QUANTITIES.get(channel.quantity)
        if pin is None or pin in chosen.values():
            by = {used: other for other, used in chosen.items()}
            taken = f"{pin} is taken by '{by[pin]}'" if pin else ""
            raise RigctlError(
                "a channel that is on no input of the board",
                value=name,
                expected=f"'inputs: {{{name}: A0}}' in the backend's options, one channel on each",
                hint=taken or None,
            )
        bits = channel.raw.bits if channel.raw else None
        if bits != BITS:
            raise RigctlError(
                f"channel '{name}': the board's converter has {BITS} bits",
                value=f"{bits} bits" if bits else "no 'raw:' in the rig file",
                hint="Use a rig file for the board, e.g. rigs/hl32-bench-uno.yaml",
            )
        chosen[name] = pin
    return chosen


def _outputs(rig: Rig, given: Mapping[str, str]) -> dict[str, str]:
    for name, output in given.items():
        if name not in rig.actuators:
            raise unknown_name("actuator", name, rig.actuators)
        if output not in OUTPUTS:
            raise unknown_name("output of the board", output, OUTPUTS)
    chosen: dict[str, str] = {}
    for name, actuator in rig.actuators.items():
        if actuator.by == "operator":
            continue
        of_kind = [one for one, kind in OUTPUTS.items() if kind == actuator.kind]
        output = given.get(name) or (of_kind[0] if of_kind else "")
        if OUTPUTS.get(output) != actuator.kind or output in chosen:
            raise RigctlError(
                "an actuator that is on no output of the board",
                value=name,
                expected="one switch, one directional valve and one level at the most",
            )
        if actuator.kind == "level" and (actuator.low is None or actuator.high is None):
            raise RigctlError(
                "a level on the board's PWM needs its range", value=name, expected="low and high"
            )
        chosen[output] = name
    return chosen
