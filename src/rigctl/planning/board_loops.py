"""Loops of a plan that the bench of the rig file cannot carry out itself."""

from __future__ import annotations

from rigctl.backends.arduino.regulation import unfit
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.arduino.wiring import wiring_of
from rigctl.errors import RigctlError
from rigctl.plan.action import Action
from rigctl.rig import Rig
from rigctl.steps.control.on_board import ControlOnBoard

#: kinds of backend that connect to rigctl's board
_BOARDS = ("serial", "emulated")


def not_on_board(rig: Rig, action: Action) -> str | None:
    """Why a loop with ``where: board`` will be refused on the rig file's backend, or None.

    The firmware's version is not known before the bench is open.
    """
    if not isinstance(action, ControlOnBoard) or not action.required:
        return None
    settings = action.settings()
    device = rig.device_of(settings.actuator)
    if rig.device_of(settings.channel) != device:
        return f"'where: board': {settings.channel} and {settings.actuator} belong to different devices"
    rig = rig.parts[device]
    kind = rig.backend.kind
    if kind not in _BOARDS or rig.backend.lines is not None:
        other = kind if rig.backend.lines is None else f"{kind}, with a device of lines"
        return (
            f"'where: board' needs rigctl's board, and the rig file's backend is {other}; with "
            "'where: auto' the host runs the loop there"
        )
    try:
        reason = unfit(Translation(rig, wiring_of(rig, rig.backend.options)), settings)
    except RigctlError:  # a bench that cannot be opened is reported when it is opened
        return None
    return f"'where: board': {reason}" if reason else None
