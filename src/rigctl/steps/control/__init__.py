"""`control`: a closed loop from a channel to an actuator, carried out on the host."""

from rigctl.steps.control.step import Control, ControlStep

__all__ = ["Control", "ControlStep"]
