"""The 95 % intervals of an answer about a moving twin whose true values are known."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.units import parse_unit
from rigctl_validation.moving_benches.campaign import MovingCampaign
from rigctl_validation.outcome import Interval

#: half of a 95 % interval, in standard deviations
_HALF = 1.959963984540054


def intervals_of(campaign: MovingCampaign, amplitude: float, diagnosis: Diagnosis) -> Iterator[Interval]:
    """Of the hidden effect's size, if it is named; of the bench's own values where nothing is hidden."""
    return (
        _of_values(campaign, diagnosis)
        if campaign.hidden is None
        else _of_size(campaign, amplitude, diagnosis)
    )


def _of_values(campaign: MovingCampaign, diagnosis: Diagnosis) -> Iterator[Interval]:
    fit = diagnosis.before.fit
    truths = {
        each.parameter: each.si * float(value)
        for each, value in zip(campaign.twin.drawn, campaign.drawn, strict=True)
    }
    for unknown, value in zip(fit.problem.shared, fit.values, strict=True):
        std = fit.reported_std.get(unknown.name, 0.0)
        if unknown.name in truths and std > 0.0 and math.isfinite(std):
            yield _interval("", unknown.name, truths[unknown.name], float(value), std)


def _of_size(campaign: MovingCampaign, amplitude: float, diagnosis: Diagnosis) -> Iterator[Interval]:
    hidden = campaign.hidden
    if hidden is None or hidden.exact is None or hidden.exact[0] not in diagnosis.effects:
        return
    effect, parameter = hidden.exact
    found = next((one.parameters.get(parameter) for one in diagnosis.ranking if one.effect == effect), None)
    if found is not None and found.std > 0.0 and math.isfinite(found.std):
        factor = parse_unit(found.unit).factor
        truth = hidden.truth(amplitude, campaign.drawn)
        yield _interval(effect, parameter, truth, factor * found.value, factor * found.std)


def _interval(effect: str, parameter: str, truth: float, value: float, std: float) -> Interval:
    return Interval(effect, parameter, truth, value - _HALF * std, value + _HALF * std)
