"""The description of a bench: channels, actuators, calibration, limits and the safe state."""

from rigctl.rig.actuator import Actuator
from rigctl.rig.calibration import Calibration, Raw
from rigctl.rig.channel import Channel
from rigctl.rig.layout import Layout
from rigctl.rig.limit import Limit
from rigctl.rig.load import load_rig, parse_rig
from rigctl.rig.protocols.lines import Exchange, KeepAlive, LineActuator, Lines, Query
from rigctl.rig.rig import DEVICES, Backend, Device, Rig
from rigctl.rig.roles import HeatRole, MoveRole, Roles, SetRole
from rigctl.rig.simulation import Simulation

__all__ = [
    "DEVICES",
    "Actuator",
    "Backend",
    "Calibration",
    "Channel",
    "Device",
    "Exchange",
    "HeatRole",
    "KeepAlive",
    "Layout",
    "Limit",
    "LineActuator",
    "Lines",
    "MoveRole",
    "Query",
    "Raw",
    "Rig",
    "Roles",
    "SetRole",
    "Simulation",
    "load_rig",
    "parse_rig",
]
