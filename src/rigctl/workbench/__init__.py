"""The workbench: a model on its runs, controlled by sliders and switches; independent of any page."""

from rigctl.workbench.frequency import Asked
from rigctl.workbench.picture import Picture
from rigctl.workbench.session import Workbench
from rigctl.workbench.state import State, Track

__all__ = ["Asked", "Picture", "State", "Track", "Workbench"]
