"""Reads the board's outputs back after they were made safe."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.arduino.board import Board
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.transport.conversation import Conversation
from rigctl.backends.transport.port import Refused
from rigctl.clock import Clock
from rigctl.rig import Rig

_QUERY = "MEAS:ALL?"
_FIELDS = 7  # of its answer: microseconds, three inputs, outputs, PWM, trips
_FOLLOWS = 0.2  # s for the outputs to follow the commands: the board lets a solenoid rest first


def reading_back(
    board: Board, translation: Translation, rig: Rig, clock: Clock, timeout: float, tries: int
) -> Conversation[Mapping[str, float]]:
    """Return the outputs that are not safe according to the board, with their SI values.

    Parameters
    ----------
    timeout, tries: for each answer, s.

    Raises
    ------
    Refused
        the answer has no such form.
    PortLost
        the board does not answer.
    """
    safe = {name: float(at) for name, at in rig.safe_state.items() if rig.actuators[name].by == "driven"}
    give_up = clock.now() + _FOLLOWS
    while True:
        answer = yield from board.line.asking(_QUERY, timeout, tries)
        try:
            _, _, _, _, outputs, pwm, _ = map(int, answer.text.split(",", _FIELDS - 1))
        except ValueError:
            raise Refused(f"the board answers {answer.text!r} to '{_QUERY}'") from None
        states = translation.states(outputs, pwm)
        wrong = {
            name: value
            for name, value in states.items()
            if name in safe and translation.raw(name, value) != translation.raw(name, safe[name])
        }
        if not wrong or clock.now() >= give_up:
            return wrong


def still(rig: Rig, wrong: Mapping[str, float]) -> Refused:
    """Return what to raise where outputs are not safe."""
    found = [
        f"{name} is {rig.actuators[name].show(value)}, though it was commanded to be "
        f"{rig.actuators[name].show(float(rig.safe_state[name]))}"
        for name, value in wrong.items()
    ]
    return Refused("; ".join(found))
