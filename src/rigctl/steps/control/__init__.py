"""`control`: a closed loop from a channel to an actuator, executed by the host or by the bench's board."""

from rigctl.steps.control.action import Control
from rigctl.steps.control.on_board import ControlOnBoard
from rigctl.steps.control.step import ControlStep

__all__ = ["Control", "ControlOnBoard", "ControlStep"]
