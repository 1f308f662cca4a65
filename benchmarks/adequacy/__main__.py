"""How often is ``adequate`` right? ``python -m benchmarks.adequacy``

200 campaigns of the separate bench with nothing hidden, and 200 with one hidden effect of at least 30 sigmas,
the effects in turn. Each has 32 records, 28 conditions and four of them twice; noise correlated from sample
to sample (0.6), read by a ten-bit converter; the relief valve is set to within 0.2 %. The comparison has to find
all that out by itself. Half of the campaigns have the chambers' pressures too.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.record import keep, table
from rigctl.compare.compare import judge
from rigctl.compare.fitting import fit_model
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.measured.noise import noise_of
from rigctl.validation.in_memory import measure
from rigctl.validation.rates import wilson
from rigctl.validation.scenario import Scenario, Wanted
from rigctl.validation.tiers import acting
from rigctl.validation.work import bench_model, hidden_amplitudes

SIZE = 31.5  # amplitudes are found to 5 %, so that each is 30 at least
REPEATED = 4


@dataclass(frozen=True)
class Judged:
    """One campaign: what was hidden, and what was said."""

    hidden: str
    chambers: bool
    reached: bool
    adequate: bool
    p_value: float


def nothing(count: int) -> Iterator[Scenario]:
    """Campaigns that hide nothing."""
    for seed in range(count):
        yield Scenario(
            "nothing", noise="all", repeated=REPEATED, chamber_pressures=bool(seed % 2), seed=90_000 + seed
        )


def one(count: int) -> Iterator[Scenario]:
    """Campaigns that hide one effect each, every effect as often."""
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
    found = judge(fit_model(model, measurements, noise_of(measurements)), model.name, locate=False).adequacy
    return Judged(hidden, scenario.chamber_pressures, True, found.adequate, found.p_value)


def attempt(scenario: Scenario) -> Judged | str:
    """The same; what cannot be judged is told."""
    try:
        return carry_out(scenario)
    except RigctlError as problem:
        return f"{scenario.name}: {problem}"


def rates(found: Sequence[Judged]) -> dict[str, Any]:
    """Counts and Wilson's bounds, and the effects that were missed."""
    right = [one.adequate if not one.hidden else not one.adequate for one in found]
    low, high = wilson(sum(right), len(right))
    return {
        "right": sum(right),
        "of": len(right),
        "low": low,
        "high": high,
        "wrong": [
            f"{one.hidden or 'nothing'}, {'chambers' if one.chambers else 'published'}: p = {one.p_value:.2g}"
            for one, good in zip(found, right, strict=True)
            if not good
        ],
    }


def main() -> int:
    """Carry out and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200, help="of each kind")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    results: dict[str, Any] = {"size": SIZE, "records": 28 + REPEATED}
    with ProcessPoolExecutor(asked.workers, mp_context=get_context("spawn")) as pool:
        for kind, scenarios in (("nothing hidden", nothing), ("one effect", one)):
            found = []
            for place, judged in enumerate(pool.map(attempt, scenarios(asked.campaigns)), start=1):
                if isinstance(judged, str):
                    print(f"\n{judged}", file=sys.stderr)
                else:
                    found.append(judged)
                print(f"\r{kind}: {place} of {asked.campaigns}", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
            results[kind] = rates([one for one in found if one.reached])
            results[kind]["not reached"] = sorted({one.hidden for one in found if not one.reached})
    rows = [
        [kind, word, f"{one['right']} of {one['of']}", f"{100 * one['low']:.1f} to {100 * one['high']:.1f} %"]
        for kind, word in (("nothing hidden", "adequate"), ("one effect", "not adequate"))
        for one in (results[kind],)
    ]
    table("the verdict of compare", [["campaigns", "right is", "right", "Wilson, 95 %"], *rows])
    for kind in ("nothing hidden", "one effect"):
        for line in results[kind]["wrong"]:
            print(f"wrong: {line}")
    keep(Path(__file__).parent, results, "numpy", "scipy", "numba")
    return 0


if __name__ == "__main__":
    sys.exit(main())
