"""Work for other processes: it must lie in a module that they can import."""

from __future__ import annotations

import os

from rigctl.errors import RigctlError
from rigctl_validation.outcome import Outcome
from rigctl_validation.scenario import Scenario


def quick(scenario: Scenario) -> Outcome:
    """Report "adequate" without a diagnosis; odd seeds fail."""
    if scenario.seed % 2:
        raise RigctlError("odd seeds fail")
    return Outcome(scenario, verdict="adequate", first=f"{os.getpid()}", seconds=0.01)


def dying(scenario: Scenario) -> Outcome:
    """Ends its process with the fourth scenario, as the system does when memory runs out."""
    if scenario.seed == 6:
        os._exit(9)
    return quick(scenario)
