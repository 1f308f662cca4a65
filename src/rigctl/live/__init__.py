"""A run in progress on a terminal: a view that redraws itself, or plain lines where there is no terminal."""

from rigctl.live.display import redrawable, view
from rigctl.live.monitor import MonitorDisplay
from rigctl.live.readings import Readings, readings_table

__all__ = ["MonitorDisplay", "Readings", "readings_table", "redrawable", "view"]
