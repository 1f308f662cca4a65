"""Definition of a tier of the benchmark: its trials, how they are carried out, and the rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias

from rigctl_validation.outcome import AnyTrial, TrialOutcome

if TYPE_CHECKING:
    from rigctl_validation.figures import Figures

TierName: TypeAlias = Literal[
    "quick", "full", "anyone", "moving", "coverage", "real", "shape", "discovery", "design", "devices"
]


@dataclass(frozen=True)
class TierDefinition(Generic[AnyTrial]):
    """One tier.

    Attributes
    ----------
    trials: in an order in which the first N are a representative sample of all.
    carry_out: makes the campaign of a trial, and returns what the tool answered.
    read: makes a trial from plain data.
    figures: the rates of some outcomes, with their targets.
    reusing: `carry_out`, with what does not depend on the search taken from earlier outcomes, by the names of
        their trials; None if a tier cannot do that.
    """

    trials: tuple[AnyTrial, ...]
    carry_out: Callable[[AnyTrial], TrialOutcome[AnyTrial]]
    read: Callable[[Mapping[str, Any]], AnyTrial]
    figures: Callable[[Sequence[TrialOutcome[AnyTrial]]], Figures]
    reusing: (
        Callable[[Mapping[str, TrialOutcome[AnyTrial]]], Callable[[AnyTrial], TrialOutcome[AnyTrial]]] | None
    ) = None


def tier_definition(name: TierName) -> TierDefinition[Any]:  # noqa: PLR0911 - one for each tier
    """The tier of a name; only what it needs is imported."""
    if name == "anyone":
        from rigctl_validation.small_benches.rates import bench_figures
        from rigctl_validation.small_benches.tier import bench_trials
        from rigctl_validation.small_benches.trial import BenchTrial
        from rigctl_validation.small_benches.work import carry_out_trial

        return TierDefinition(bench_trials(), carry_out_trial, BenchTrial.read, bench_figures)
    if name == "moving":
        from rigctl_validation.moving.rates import moving_figures
        from rigctl_validation.moving.tier import moving_trials
        from rigctl_validation.moving.trial import MovingTrial
        from rigctl_validation.moving.work import carry_out_moving

        return TierDefinition(moving_trials(), carry_out_moving, MovingTrial.read, moving_figures)
    if name == "coverage":
        from rigctl_validation.coverage.rates import coverage_figures
        from rigctl_validation.coverage.trial import CoverageTrial, coverage_trials
        from rigctl_validation.coverage.work import carry_out_coverage

        return TierDefinition(coverage_trials(), carry_out_coverage, CoverageTrial.read, coverage_figures)
    if name == "real":
        from rigctl_validation.real.rates import real_figures
        from rigctl_validation.real.trial import RealTrial, real_trials
        from rigctl_validation.real.work import carry_out_real

        return TierDefinition(real_trials(), carry_out_real, RealTrial.read, real_figures)
    if name == "discovery":
        from rigctl_validation.planted.rates import planted_figures
        from rigctl_validation.planted.trial import PlantedTrial, planted_trials
        from rigctl_validation.planted.work import carry_out_planted

        return TierDefinition(planted_trials(), carry_out_planted, PlantedTrial.read, planted_figures)
    if name == "design":
        from rigctl_validation.designed.rates import design_figures
        from rigctl_validation.designed.trial import DesignTrial, design_trials
        from rigctl_validation.designed.work import carry_out_design

        return TierDefinition(design_trials(), carry_out_design, DesignTrial.read, design_figures)
    if name == "devices":
        from rigctl_validation.devices.rates import devices_figures
        from rigctl_validation.devices.trial import DevicesTrial, devices_trials
        from rigctl_validation.devices.work import carry_out_devices

        return TierDefinition(devices_trials(), carry_out_devices, DevicesTrial.read, devices_figures)
    from rigctl_validation.rates import figures
    from rigctl_validation.scenario import Scenario
    from rigctl_validation.shape_rates import shape_figures
    from rigctl_validation.tiers import scenarios
    from rigctl_validation.work import carry_out

    counted = shape_figures if name == "shape" else figures
    return TierDefinition(
        scenarios(name),
        carry_out,
        Scenario.read,
        counted,
        reusing=lambda earlier: partial(carry_out, earlier=earlier),
    )
