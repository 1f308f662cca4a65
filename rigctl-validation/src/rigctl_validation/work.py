"""One scenario from the bench to the verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison import judge
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.fitting import fit_model
from rigctl.analysis.laws.power_law import EXPONENT
from rigctl.analysis.linear.detectability import Unexplained, unexplained
from rigctl.analysis.linear.linearisation import linearise
from rigctl.analysis.search.identity import Levels
from rigctl.effects.declaration import qualified
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.load import load_model
from rigctl.model.measured.noise import DataNoise, noise_of, without_edges
from rigctl.model.measured.record import Measurements
from rigctl.model.model import Model
from rigctl.noise import ChannelNoise, NoiseModel
from rigctl.rig.load import load_rig
from rigctl.rig.rig import Rig
from rigctl_validation.amplitude import Amplitude, Amplitudes, Clean
from rigctl_validation.bench.campaign import Campaign, clean_outputs
from rigctl_validation.bench.record import RATE
from rigctl_validation.bench.sensing import Noise
from rigctl_validation.hidden_effect import HiddenEffect, hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.in_memory import measure
from rigctl_validation.outcome import Claim, Interval, Outcome
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.similarity import Likeness, likeness, sizes_beside_each_other

Floats = NDArray[np.float64]

#: sizes are needed to a few per cent, and so is the misfit from which they are computed
_COST = 1e-3
#: two-sided 95 % quantile of the normal distribution
_WIDTH = 1.959963984540054
_NOTHING: Mapping[str, Outcome] = MappingProxyType({})


@one_thread()
@switched_off()
def carry_out(scenario: Scenario, earlier: Mapping[str, Outcome] = _NOTHING) -> Outcome:
    """Make the campaign of a scenario on the separate bench, diagnose it, and return the outcome.

    The model is the shipped textbook model with its free parameters fitted; the data are passed in memory,
    and equal those that `make_run` would have kept.

    Parameters
    ----------
    earlier: outcomes by the names of their scenarios: what does not depend on the search and its decisions is
        taken from there. It does depend on the models, the effects and the linearisation.

    Raises
    ------
    RigctlError
        the tool cannot diagnose the campaign.
    BenchFailure
        the bench cannot be simulated with its hidden effects.
    """
    began = time.process_time()
    known = earlier.get(scenario.name)
    reusable = known is not None and known.scenario == scenario and _complete(known)
    hidden = _known_part(known) if known is not None and reusable else _hidden_part(scenario)
    if hidden.untested:
        return hidden
    diagnosis = diagnose_scenario(scenario, hidden.amplitudes)
    return replace(
        hidden,
        verdict=diagnosis.verdict.value,
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        claims=tuple(claim_of(one) for one in diagnosis.levels),
        all_of_it=diagnosis.remainder is None,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        intervals=tuple(_intervals(scenario, hidden.amplitudes, diagnosis)),
        exponents=tuple(_exponents(scenario, hidden.amplitudes, diagnosis)),
        seconds=time.process_time() - began,
    )


def _hidden_part(scenario: Scenario) -> Outcome:
    """What is known of a trial without any diagnosis: amplitudes, and the information in its readings."""
    amplitudes = hidden_amplitudes(scenario)
    outcome = Outcome(
        scenario,
        sizes=tuple(each.size for each in amplitudes),
        amplitudes=tuple(each.value for each in amplitudes),
    )
    short = [w.effect for w, each in zip(scenario.hidden, amplitudes, strict=True) if not each.reached]
    if short:
        return replace(outcome, untested=f"no amplitude of {', '.join(short)} has the size wanted")
    alike = _alike(scenario, amplitudes)
    beside, beyond_laws = _beside(scenario, outcome.amplitudes, alike)
    return replace(
        outcome,
        rival_cosine=max((each.cosine for each in alike), default=None),
        separation=min((one.separation for one in alike if one.separation is not None), default=None),
        beside=beside,
        beyond_laws=beyond_laws,
    )


def _known_part(known: Outcome) -> Outcome:
    """The part of an outcome that does not depend on the search."""
    return Outcome(
        known.scenario,
        sizes=known.sizes,
        amplitudes=known.amplitudes,
        rival_cosine=known.rival_cosine,
        separation=known.separation,
        beside=known.beside,
        beyond_laws=known.beyond_laws,
        untested=known.untested,
    )


def _complete(known: Outcome) -> bool:
    """Whether an outcome has everything that does not depend on the search."""
    return not known.failure and bool(known.beside) == bool(known.beyond_laws)


def claim_of(levels: Levels) -> Claim:
    """The levels that a diagnosis claims for an effect."""
    return Claim(levels.effect, place=levels.place_sure, driver=levels.driver_sure, law=levels.law_sure)


def hidden_amplitudes(scenario: Scenario) -> list[Amplitude]:
    """The amplitude of each hidden effect of a scenario that has the wanted size."""
    return [
        reference_of(plain_of(scenario)).find(scenario, wanted)
        if wanted.amplitude is None
        else Amplitude(wanted.sign * wanted.amplitude, wanted.size, reached=True)
        for wanted in scenario.hidden
    ]


@dataclass(frozen=True)
class Reference:
    """The reference for sizes: the textbook model fitted to a noise-free campaign that hides nothing.

    Attributes
    ----------
    fitted: there, with whiteners for the noise in question.
    unexplained: its linearisation, in which sizes are nearly right if the fitted parameters move little.
    """

    fitted: FitResult = field(repr=False)
    unexplained: Unexplained = field(repr=False)
    by_slopes: Amplitudes = field(repr=False)
    by_fit: Amplitudes = field(repr=False)

    def find(self, scenario: Scenario, wanted: Wanted) -> Amplitude:
        """The amplitude that leaves the wanted size after a fit, starting from the linearisation's
        estimate."""
        return self.amplitude(find_hidden(wanted.effect), wanted.size, scenario, wanted.sign)

    def amplitude(self, hidden: HiddenEffect, size: float, scenario: Scenario, sign: int = 1) -> Amplitude:
        """Amplitude of anything that the bench can hide."""
        near = self.by_slopes.find(hidden, size, scenario.plain, shape=scenario.shape, sign=sign)
        if not near.reached:
            return near
        nearby = replace(hidden, typical=abs(near.value))
        return self.by_fit.find(nearby, size, scenario.plain, shape=scenario.shape, sign=sign)


def plain_of(scenario: Scenario) -> Scenario:
    """The scenario that hides nothing with the same noise: one for all that share it."""
    return replace(scenario, kind="nothing", hidden=(), shape="other", seed=0)


@lru_cache(maxsize=32)
def reference_of(plain: Scenario) -> Reference:
    """The reference for sizes, with the noise of a scenario that hides nothing."""
    model, rig = bench_model(plain.chamber_pressures)
    measurements = measure(plain.plain, model, rig)
    noisy = fit_model(model, measurements, _noise(plain, measurements))
    clean = clean_outputs(replace(plain.plain, seed=0))
    fitted = refitted(noisy, clean)
    rebuilt = fitted.problem.rebuilt(fitted.at_end, library=True)
    projected = unexplained(linearise(fitted, rebuilt), rebuilt)

    def by_slopes(with_it: Clean, without: Clean) -> float:
        return projected.size(_changes(with_it, without, measurements.outputs))

    def by_fit(with_it: Clean, _: Clean) -> float:
        return math.sqrt(max(0.0, _squares(refitted(fitted, with_it)) - _squares(fitted)))

    return Reference(fitted, projected, Amplitudes(by_slopes), Amplitudes(by_fit))


def refitted(fitted: FitResult, clean: Clean) -> FitResult:
    """The model refitted to other readings of the same records, starting at its fit."""
    problem = fitted.problem
    outputs = problem.measurements.outputs
    records = tuple(
        replace(record, values=np.column_stack([channels[name] for name in outputs]))
        for record, (_, channels) in zip(problem.records, clean, strict=True)
    )
    shared = [
        replace(unknown, start=min(max(float(value), unknown.lower), unknown.upper))
        for unknown, value in zip(problem.shared, fitted.values, strict=True)
    ]
    other = replace(problem, measurements=replace(problem.measurements, records=records))
    return fit(other.with_shared(shared), local=fitted.local, cost=_COST, largest_step=1.0)


def _squares(fitted: FitResult) -> float:
    assert fitted.solution is not None  # noqa: S101 - the textbook model has parameters to fit
    return 2.0 * fitted.solution.cost


def _changes(with_it: Clean, without: Clean, outputs: Sequence[str]) -> list[Floats]:
    return [
        np.column_stack([changed[name] - plain[name] for name in outputs])
        for (_, changed), (_, plain) in zip(with_it, without, strict=True)
    ]


@lru_cache(maxsize=2)
def bench_model(chamber_pressures: bool) -> tuple[Model, Rig]:
    """The textbook model, and the rig with the recorded channels."""
    name = "hl32-bench-instrumented.yaml" if chamber_pressures else "hl32-bench.yaml"
    rig = load_rig(shipped("rigs", name))
    return load_model(shipped("models", "hl32-textbook.yaml")), rig


def _noise(scenario: Scenario, measurements: Measurements) -> DataNoise:
    """As estimated from the data, or as known by the scenario."""
    if not scenario.noise_known:
        return noise_of(measurements)
    sigma = Noise().sigma
    channels = tuple(
        ChannelNoise(name, sigma[name], source="rig", guessed=False, statement="known")
        for name in measurements.outputs
    )
    valid = tuple(record.here for record in measurements.records)
    return without_edges(DataNoise(NoiseModel(channels, 1.0 / RATE, "known"), valid), measurements)


def diagnose_scenario(scenario: Scenario, amplitudes: Sequence[float]) -> Diagnosis:
    """Diagnose a scenario's campaign, with its effects hidden at these amplitudes (SI, signed)."""
    return diagnose_campaign(scenario, scenario.campaign(amplitudes))


def diagnose_campaign(scenario: Scenario, campaign: Campaign) -> Diagnosis:
    """Diagnose a campaign as specified by a scenario: with its channels, its noise, and its library."""
    model, rig = bench_model(scenario.chamber_pressures)
    measurements = measure(campaign, model, rig)
    fitted = fit_model(model, measurements, _noise(scenario, measurements))
    compared = judge(fitted, model.name, excluded=scenario.left_out)
    return diagnose_comparison(compared, measurements.runs)


def _alike(scenario: Scenario, amplitudes: Sequence[Amplitude]) -> list[Likeness]:
    """The similarity of other effects to each hidden effect by itself."""
    unexplained = reference_of(plain_of(scenario)).unexplained
    return [
        likeness(
            unexplained,
            _fit_without_effects(scenario, [(each[0], each[1].value)]),
            each[0].effect,
            each[1].size,
        )
        for each in zip(scenario.hidden, amplitudes, strict=True)
    ]


def _beside(
    scenario: Scenario, amplitudes: Sequence[float], alike: Sequence[Likeness]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """λ of each hidden effect beside the others, and beyond the shape tolerance of their laws; empty for a
    single one, or if unknown."""
    chosen = [each.own for each in alike if each.own is not None]
    if len(chosen) < 2 or len(chosen) < len(amplitudes):
        return (), ()
    return sizes_beside_each_other(
        _fit_without_effects(scenario, list(zip(scenario.hidden, amplitudes, strict=True))), chosen
    )


def _fit_without_effects(scenario: Scenario, hidden: Sequence[tuple[Wanted, float]]) -> FitResult:
    """The textbook model fitted to noise-free readings of a bench that hides something."""
    return refitted(reference_of(plain_of(scenario)).fitted, _without_noise(scenario, hidden))


def _without_noise(scenario: Scenario, hidden: Sequence[tuple[Wanted, float]]) -> Clean:
    steady = replace(scenario.plain, seed=0)
    chosen = [(find_hidden(wanted.effect), amplitude) for wanted, amplitude in hidden]
    return clean_outputs(hide(steady, chosen, scenario.shape))


def _exponents(scenario: Scenario, amplitudes: Sequence[float], diagnosis: Diagnosis) -> Iterator[Interval]:
    """The exponents of the laws of hidden effects that are corrected to another power.

    The bench's law need not be a power: the true value is the exponent of the nearest power, fitted to
    noise-free readings of the same bench.
    """
    corrected = [law for law in diagnosis.laws if law.offered == "power" and law.effect in scenario.truth]
    if not corrected:
        return
    clean = _without_noise(scenario, list(zip(scenario.hidden, amplitudes, strict=True)))
    for law in corrected:
        assert law.power is not None  # noqa: S101 - it is what is offered
        name = qualified(law.power.effect.name, EXPONENT)
        steady = refitted(law.power.fit, clean)
        names = [unknown.name for unknown in steady.problem.shared]
        wide = _WIDTH * law.exponent_std
        yield Interval(
            law.effect,
            f"exponent of {law.law.driver.name}",
            float(steady.values[names.index(name)]),
            law.exponent - wide,
            law.exponent + wide,
        )


def _intervals(scenario: Scenario, amplitudes: Sequence[float], diagnosis: Diagnosis) -> list[Interval]:
    """For the parameters of hidden effects that were found and whose fitted value has a true value."""
    intervals: list[Interval] = []
    values = _estimates(diagnosis)
    for wanted, truth in zip(scenario.hidden, amplitudes, strict=True):
        hidden = find_hidden(wanted.effect)
        name = f"{hidden.effect}.{hidden.parameter}"
        if hidden.comparable and wanted.effect in diagnosis.effects and name in values:
            value, std = values[name]
            if math.isfinite(std) and std > 0.0:
                intervals.append(
                    Interval(
                        hidden.effect, hidden.parameter, truth, value - _WIDTH * std, value + _WIDTH * std
                    )
                )
    return intervals


def _estimates(diagnosis: Diagnosis) -> Mapping[str, tuple[float, float]]:
    """Value and standard deviation of each parameter of the effects found, SI."""
    best = diagnosis.best
    return {column: best.value(column) for one in best.candidates for column in one.columns}
