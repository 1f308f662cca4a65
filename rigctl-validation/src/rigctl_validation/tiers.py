"""The trials of the benchmark: a quick tier for every day, a full one for the published figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal, TypeAlias

import numpy as np

from rigctl_validation.hidden_effect import HiddenEffect, Shape
from rigctl_validation.hidden_library import HIDDEN_EFFECTS, find_hidden
from rigctl_validation.scenario import NOISES, NoiseVariant, Scenario, Wanted

Tier: TypeAlias = Literal["quick", "full", "shape"]

#: sizes λ of hidden effects
SIZES = (6.0, 10.0, 30.0)
#: sizes of two effects hidden together, each
_TOGETHER = (10.0, 30.0)
_REMOVED = 30.0
#: number of conditions measured twice; more if scatter must be estimated from them
_REPEATED, _REPEATED_SCATTER = 4, 8
#: effects of the quick tier: one of each family of causes
_QUICK = (
    "piston_leakage",
    "relief_thermal_drift",
    "laminar_throttle",
    "entrained_air",
    "coulomb_friction",
    "spring_load",
    "valve_open_delay",
    "position_backlash",
)
#: conditions of the quick tier: fewer, so that a trial takes half as long; sizes are in sigmas in any case
_FEW_TEMPERATURES = (20.0, 40.0, 60.0, 80.0)
_FEW_PRESSURES = (20.0, 35.0, 50.0)
#: trials of the full tier, about: nothing hidden for each noise and set of sensors, one for each size
_NOTHING_SEEDS = 20
_KNOWN_SEEDS = 30
_ONE_SEEDS = 4
_SHAPE_SEEDS = 2
_PAIRS = 60
#: sizes of the shape tier, and of its pairs: a strong effect and a weaker one
_SHAPE_SIZES = (30.0, 100.0, 300.0)
_STRONG = ((100.0, 30.0), (300.0, 30.0), (1000.0, 30.0), (1000.0, 100.0))
_STRONG_PAIRS = 32
#: effects whose usual range is narrower than what a bench may have, and amplitudes beyond it
_USUAL = {"viscous_friction": 2e4, "piston_leakage": 2e-13}
_BEYOND = 3.0


def acting() -> tuple[HiddenEffect, ...]:
    """Effects that a campaign of strokes can show and that a fit does not absorb by itself.

    The others are base physics, cannot act in so short a record, or are equivalent to a fitted parameter.
    """
    same_as_fitted = ("load_mass", "thermocouple_offset")
    return tuple(
        hidden
        for hidden in HIDDEN_EFFECTS
        if not hidden.base and not hidden.cannot_act and hidden.effect not in same_as_fitted
    )


def scenarios(tier: Tier) -> tuple[Scenario, ...]:
    """The trials of a tier, in an order in which any part of them is a fair sample of all."""
    if tier == "quick":
        trials = [
            replace(scenario, temperatures=_FEW_TEMPERATURES, pressures=_FEW_PRESSURES)
            for scenario in _quick()
        ]
    elif tier == "shape":
        trials = [
            replace(scenario, temperatures=_FEW_TEMPERATURES, pressures=_FEW_PRESSURES)
            for scenario in _shape()
        ]
    else:
        effects = acting()
        trials = [
            *_nothing(_NOTHING_SEEDS),
            *_known(_KNOWN_SEEDS),
            *_one(effects, SIZES, "other", range(_ONE_SEEDS)),
            *_one([e for e in effects if e.shaped], (10.0, 30.0), "wrong", range(_SHAPE_SEEDS)),
            *_one([e for e in effects if e.comparable], (30.0,), "same", range(_SHAPE_SEEDS)),
            *_two(effects, _PAIRS),
            *_removed(effects, range(3)),
        ]
    order = np.random.default_rng(0).permutation(len(trials))
    return tuple(trials[int(i)] for i in order)


def _quick() -> Iterator[Scenario]:
    effects = [find_hidden(name) for name in _QUICK]
    yield from _nothing(1)
    yield from _one(effects, (10.0,), "other", range(1))
    yield from _one(effects, (30.0,), "other", range(1, 2))
    yield from _two(effects, 3)
    yield from _removed(effects[:4], range(1))


def _shape() -> Iterator[Scenario]:
    """Effects of every size whose laws are not the library's: alone, in pairs, out of range, removed.

    No rate may decrease with their size: the larger an effect is, the more clearly a wrong shape shows.
    """
    effects = acting()
    yield from _nothing(4)
    yield from _one([e for e in effects if e.shaped], _SHAPE_SIZES, "wrong", range(1))
    yield from _one([e for e in effects if not e.shaped], _SHAPE_SIZES[:1], "other", range(1))
    yield from _strong_and_weak(effects)
    for row, (name, largest) in enumerate(_USUAL.items()):
        for chambers in (False, True):
            wanted = Wanted(name, 1000.0, amplitude=_BEYOND * largest)
            yield _scenario("one", (wanted,), "other", "white", 50_000 + row, chambers=chambers)
    for size in _SHAPE_SIZES:
        for scenario in _removed(effects, range(1)):
            sized = tuple(replace(each, size=size) for each in scenario.hidden)
            yield replace(scenario, hidden=sized)


def _strong_and_weak(effects: Sequence[HiddenEffect]) -> Iterator[Scenario]:
    """Two effects at once, the first far above the noise in another shape."""
    strong = [effect for effect in effects if effect.shaped]
    pairs = [(one, other) for one in strong for other in effects if other is not one]
    drawn = np.random.default_rng(2).choice(len(pairs), size=_STRONG_PAIRS, replace=False)
    for row, index in enumerate(sorted(int(i) for i in drawn)):
        large, small = _STRONG[row % len(_STRONG)]
        first, second = pairs[index]
        wanted = (Wanted(first.effect, large, first.signs[0]), Wanted(second.effect, small, second.signs[0]))
        yield _scenario(
            "two", wanted, "other", NOISES[row % len(NOISES)], 40_000 + row, chambers=bool(row % 2)
        )


def _scenario(
    kind: Literal["nothing", "one", "two", "removed"],
    hidden: Sequence[Wanted],
    shape: Shape,
    noise: NoiseVariant,
    seed: int,
    *,
    chambers: bool,
) -> Scenario:
    repeated = _REPEATED_SCATTER if noise in ("scatter", "all") else _REPEATED
    return Scenario(
        kind=kind,
        hidden=tuple(hidden),
        shape=shape,
        noise=noise,
        chamber_pressures=chambers,
        repeated=repeated,
        seed=seed,
    )


def _nothing(seeds: int) -> Iterator[Scenario]:
    for index, noise in enumerate(NOISES):
        for chambers in (False, True):
            for seed in range(seeds):
                yield _scenario("nothing", (), "other", noise, 1000 * index + seed, chambers=chambers)


def _known(seeds: int) -> Iterator[Scenario]:
    """Nothing hidden, with known noise: only white noise can be specified."""
    for chambers in (False, True):
        for seed in range(seeds):
            plain = _scenario("nothing", (), "other", "white", 5000 + seed, chambers=chambers)
            yield replace(plain, noise_known=True)


def _one(
    effects: Sequence[HiddenEffect], sizes: Sequence[float], shape: Shape, seeds: range
) -> Iterator[Scenario]:
    """Noise, sensors and direction vary from trial to trial, so that every effect meets several."""
    for index, effect in enumerate(effects):
        for row, size in enumerate(sizes):
            for seed in seeds:
                turn = index + row + seed
                wanted = Wanted(effect.effect, size, effect.signs[seed // 2 % len(effect.signs)])
                noise = NOISES[turn % len(NOISES)]
                yield _scenario(
                    "one", (wanted,), shape, noise, 10_000 + 10 * seed + row, chambers=bool(seed % 2)
                )


def _two(effects: Sequence[HiddenEffect], count: int) -> Iterator[Scenario]:
    pairs = list(combinations(effects, 2))
    drawn = np.random.default_rng(1).choice(len(pairs), size=count, replace=False)
    for row, index in enumerate(sorted(int(i) for i in drawn)):
        for turn, size in enumerate(_TOGETHER):
            wanted = [Wanted(effect.effect, size, effect.signs[0]) for effect in pairs[index]]
            noise = NOISES[(row + turn) % len(NOISES)]
            yield _scenario("two", wanted, "other", noise, 20_000 + row, chambers=bool((row + turn) % 2))


def _removed(effects: Sequence[HiddenEffect], seeds: range) -> Iterator[Scenario]:
    for index, effect in enumerate(effects):
        for seed in seeds:
            wanted = Wanted(effect.effect, _REMOVED, effect.signs[seed % len(effect.signs)])
            noise = NOISES[(index + seed) % len(NOISES)]
            yield _scenario("removed", (wanted,), "other", noise, 30_000 + seed, chambers=bool(seed % 2))
