"""The workbench: a model on its runs that follows sliders and switches, without any page."""

from rigctl.workbench.picture import Picture
from rigctl.workbench.session import Workbench
from rigctl.workbench.state import State, Track

__all__ = ["Picture", "State", "Track", "Workbench"]
