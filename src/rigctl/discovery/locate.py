"""Where does the model want a term, and over which variable does it change?

At each slot and over each variable x a term ``w = Σ_k b_k·B_k(x)`` is looked for, B_k cubic B-splines, with
Rao's score test at b = 0: ``χ² = r̃ᵀS̃(S̃ᵀS̃)⁺S̃ᵀr̃``, S̃ the columns by b with the fitted unknowns projected off.
At the slots that are wanted most, terms of two variables too. Slots at which a term does the same to these
data are one place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.adequacy import chi2_tail
from rigctl.analysis.levels import ALPHA
from rigctl.analysis.nuisance_projection import Projected
from rigctl.discovery.chance import Chance, draw_chance, span
from rigctl.discovery.open_slots import OnProgress, OpenSlots, products_at, splines_at
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.engine.splines import SplineArgument
from rigctl.physics.family import Slot

Floats = NDArray[np.float64]

#: splines over each variable
FUNCTIONS = 8
#: splines over each of two variables, and the places that are looked at so
FEW, PLACES = 5, 3
#: samples of a record that say how alike what was searched is
_SAMPLES = 150
#: of the χ² at two slots, for every variable: as near they are one place
_ALIKE = 1e-3
#: chance with which a term is to be seen that would just do
_POWER = 0.8


@dataclass(frozen=True)
class Located:
    """A slot and a variable, and how much a smooth term of it there would explain.

    Attributes
    ----------
    over: the variables: one, or two for a term of both.
    statistic, dof: χ² and its degrees of freedom; a dof of 0 says that nothing of it can be seen.
    p_value: of the best of all that was searched.
    share: of the misfit that it explains, 0 … 1.
    alike: other slots at which a term does the same to these data.
    """

    slot: Slot
    over: tuple[Driver, ...]
    statistic: float
    dof: int
    p_value: float
    share: float
    alike: tuple[str, ...] = ()
    chance_alone: float = field(default=1.0, repr=False)

    @property
    def name(self) -> str:
        """``friction over velocity``."""
        return f"{self.slot.name} over {' and '.join(driver.name for driver in self.over)}"

    @property
    def size(self) -> float:
        """λ, by how many sigmas it stands out."""
        return math.sqrt(max(self.statistic - self.dof, 0.0))

    def cost(self, samples: float) -> float:
        """What orders them: less is better."""
        return self.dof * math.log(samples) - self.statistic

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "slot": self.slot.name,
            "meaning": self.slot.meaning,
            "over": [driver.name for driver in self.over],
            "p_value": self.p_value,
            "share": self.share,
            "size": self.size,
            "alike": list(self.alike),
        }


@dataclass(frozen=True)
class Map:
    """Everything that was looked at.

    Attributes
    ----------
    located: the most wanted first: by ``χ² − dof·ln N_eff``; of each place one slot.
    hidden: what these data cannot show: a term there is what each record, or the fit, has of its own.
    tests, independent: how many hypotheses were searched, and as how many independent ones they behave.
    needed: λ at which one of them would be seen in four cases of five.
    """

    located: tuple[Located, ...]
    hidden: tuple[Located, ...]
    tests: int
    independent: float
    needed: float

    @property
    def sure(self) -> bool:
        """Whether any place stands out of chance."""
        return bool(self.located) and self.located[0].p_value < ALPHA


def _silent(_: str) -> None:
    """Nobody listens."""


@one_thread()
def locate(
    opened: OpenSlots, samples: float, only: str | None = None, on_progress: OnProgress = _silent
) -> Map:
    """Every slot and variable that these data can show, one by one and, at the best, two by two.

    Parameters
    ----------
    samples: N_eff, the effective sample size.
    only: the name of the one slot to look at.
    """
    slots = [slot for slot in opened.slots if only is None or slot.name == only]
    tried: list[Located] = []
    for place, slot in enumerate(slots):
        on_progress(f"Looking at {slot.name}, place {place + 1} of {len(slots)}")
        tried += _at_slot(opened, slot)
    singles = sorted(_one_place_each(tried), key=lambda one: one.cost(samples))
    seen = [one for one in singles if one.dof]
    on_progress("Looking at two variables together")
    pairs = list(_pairs(opened, seen))
    on_progress("Drawing what chance alone would show")
    chance = _chance(opened, seen, pairs)
    found = [
        replace(one, p_value=chance.family_wise(one.chance_alone))
        for one in sorted([*seen, *pairs], key=lambda one: one.cost(samples))
    ]
    return Map(
        located=tuple(found),
        hidden=tuple(one for one in singles if not one.dof),
        tests=chance.tests,
        independent=chance.independent,
        needed=_needed(chance),
    )


def _at_slot(opened: OpenSlots, slot: Slot) -> Iterator[Located]:
    asked = [
        (driver, SplineArgument(dict(driver.weights), knots))
        for driver in opened.drivers
        if (knots := opened.knots(driver, FUNCTIONS)) is not None
    ]
    projected = opened.columns([(slot, argument) for _, argument in asked])
    for place, (driver, _) in enumerate(asked):
        yield _located(projected, slice(place * FUNCTIONS, (place + 1) * FUNCTIONS), slot, (driver,))


def _located(projected: Projected, chosen: slice, slot: Slot, over: tuple[Driver, ...]) -> Located:
    basis = span(projected, chosen)
    statistic, dof = float(np.square(basis.T @ projected.residual).sum()), basis.shape[1]
    excess = max(float(projected.residual @ projected.residual) - projected.dof, statistic, 1.0)
    tail = chi2_tail(statistic, dof, projected.noise_degrees) if dof else 1.0
    return Located(slot, over, statistic, dof, tail, statistic / excess, chance_alone=tail)


def _one_place_each(tried: Sequence[Located]) -> list[Located]:
    """Slots whose χ² is the same for every variable are one place, called by the first of them."""
    by_slot: dict[str, dict[tuple[Driver, ...], Located]] = {}
    for one in tried:
        by_slot.setdefault(one.slot.name, {})[one.over] = one
    leaders: dict[str, list[str]] = {}
    for name, own in by_slot.items():
        same = next((other for other in leaders if _same(own, by_slot[other])), None)
        if same is None:
            leaders[name] = []
        else:
            leaders[same].append(name)
    return [replace(one, alike=tuple(leaders[one.slot.name])) for one in tried if one.slot.name in leaders]


def _same(own: dict[tuple[Driver, ...], Located], other: dict[tuple[Driver, ...], Located]) -> bool:
    return all(
        one.dof == other[over].dof
        and abs(one.statistic - other[over].statistic) <= _ALIKE * (one.statistic + one.dof)
        for over, one in own.items()
    )


def _pairs(opened: OpenSlots, singles: Sequence[Located]) -> Iterator[Located]:
    """Terms ``w = Σ_kl b_kl·B_k(x)·B_l(y)`` at the places that are wanted most.

    x is the variable that a place wants most, y any other.
    """
    best: dict[str, Located] = {}
    for one in singles:
        best.setdefault(one.slot.name, one)
    for one in list(best.values())[:PLACES]:
        (driver,) = one.over
        for other in opened.drivers:
            arguments = _arguments(opened, (driver, other))
            if other.variables & driver.variables or arguments is None:
                continue
            projected = opened.project(opened.readings(products_at(one.slot, *arguments)))
            found = _located(projected, slice(0, FEW * FEW), one.slot, (driver, other))
            if found.dof:
                yield replace(found, alike=one.alike)


def _arguments(
    opened: OpenSlots, over: tuple[Driver, Driver]
) -> tuple[SplineArgument, SplineArgument] | None:
    knots = [opened.knots(driver, FEW) for driver in over]
    if knots[0] is None or knots[1] is None:
        return None
    return (
        SplineArgument(dict(over[0].weights), knots[0]),
        SplineArgument(dict(over[1].weights), knots[1]),
    )


def _chance(opened: OpenSlots, singles: Sequence[Located], pairs: Sequence[Located]) -> Chance:
    """What chance makes of all of it, read off some of the samples."""
    few = opened.thinned(_SAMPLES)
    readings: list[list[Floats]] = []
    asked = [
        (one.slot, SplineArgument(dict(one.over[0].weights), knots))
        for one in singles
        if (knots := few.knots(one.over[0], FUNCTIONS)) is not None
    ]
    groups = [slice(k * FUNCTIONS, (k + 1) * FUNCTIONS) for k in range(len(asked))]
    readings.append(few.readings(splines_at(asked)))
    first = len(asked) * FUNCTIONS
    for one in pairs:
        arguments = _arguments(few, (one.over[0], one.over[1]))
        if arguments is not None:
            readings.append(few.readings(products_at(one.slot, *arguments)))
            groups.append(slice(first, first + FEW * FEW))
            first += FEW * FEW
    every = [np.concatenate(parts, axis=2) for parts in zip(*readings, strict=True)]
    return draw_chance(few.project(every), groups)


def _needed(chance: Chance) -> float:
    """λ of a term of as many degrees of freedom as one variable has that would be seen."""
    from scipy.special import chndtrinc, gammainccinv

    level = float(np.quantile(chance.least, ALPHA))
    critical = 2.0 * gammainccinv(0.5 * FUNCTIONS, max(level, 1e-12))
    return math.sqrt(float(chndtrinc(critical, FUNCTIONS, 1.0 - _POWER)))
