"""Campaigns of the separate bench whose effect has a shape that is wrong on purpose."""

from __future__ import annotations

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.engine.one_thread import one_thread
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.work import diagnose_scenario


def diagnosed(effect: str, amplitude: float) -> Diagnosis:
    """The diagnosis of a campaign at two temperatures and two pressures with that hidden effect."""
    scenario = Scenario(
        "one",
        (Wanted(effect, 100.0),),
        "wrong",
        repeated=1,
        temperatures=(20.0, 80.0),
        pressures=(20.0, 50.0),
        seed=5,
    )
    with one_thread():
        return diagnose_scenario(scenario, (amplitude,))
