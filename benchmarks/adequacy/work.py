"""One campaign of the benchmark, from the bench to the verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rigctl.analysis.comparison import judge
from rigctl.analysis.fitting import fit_model
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.measured.noise import noise_of
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario, Wanted
from rigctl_validation.tiers import acting
from rigctl_validation.work import bench_model, hidden_amplitudes

SIZE = 31.5  # amplitudes are solved to 5 %, so that each is at least 30
REPEATED = 4


@dataclass(frozen=True)
class Judged:
    """One campaign: the hidden effect and the verdict."""

    hidden: str
    chambers: bool
    reached: bool
    adequate: bool
    p_value: float


def nothing(count: int) -> Iterator[Scenario]:
    """Campaigns without a hidden effect."""
    for seed in range(count):
        yield Scenario(
            "nothing", noise="all", repeated=REPEATED, chamber_pressures=bool(seed % 2), seed=90_000 + seed
        )


def one(count: int) -> Iterator[Scenario]:
    """Campaigns with one hidden effect each, all effects equally often."""
    effects = acting()
    for place in range(count):
        effect, turn = effects[place % len(effects)], place // len(effects)
        plain = Scenario("nothing", noise="all", repeated=REPEATED, seed=91_000 + place)
        wanted = Wanted(effect.effect, SIZE, effect.signs[turn // 2 % len(effect.signs)])
        yield replace(plain, kind="one", hidden=(wanted,), chamber_pressures=bool(turn % 2))


@one_thread()
def carry_out(scenario: Scenario) -> Judged:
    """Make a campaign, fit the textbook model to it and judge it."""
    hidden = scenario.truth[0] if scenario.hidden else ""
    amplitudes = hidden_amplitudes(scenario)
    if not all(each.reached for each in amplitudes):
        return Judged(hidden, scenario.chamber_pressures, reached=False, adequate=False, p_value=0.0)
    model, rig = bench_model(scenario.chamber_pressures)
    measurements = measure(scenario.campaign([each.value for each in amplitudes]), model, rig)
    found = judge(fit_model(model, measurements, noise_of(measurements)), model.name).adequacy
    return Judged(hidden, scenario.chamber_pressures, True, found.adequate, found.p_value)


def attempt(scenario: Scenario) -> Judged | str:
    """Carry out one campaign, and report a failure."""
    try:
        return carry_out(scenario)
    except RigctlError as problem:
        return f"{scenario.name}: {problem}"
