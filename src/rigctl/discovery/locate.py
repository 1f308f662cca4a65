"""At which slot does the model lack a term, and over which variable does the term change?

At each slot and over each variable x a term ``w = Σ_k b_k·B_k(x)`` is tested, with cubic B-splines B_k, by
Rao's score test at b = 0: ``χ² = r̃ᵀS̃(S̃ᵀS̃)⁺S̃ᵀr̃``, S̃ the columns by b with the fitted unknowns projected
off. At the most probable slots, terms of two variables are tested too. Slots at which a term has the same
signature in these data count as one location.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import ALPHA, LEAST_DIFFERENCE
from rigctl.analysis.fitting import OnProgress, no_progress
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.shape_tolerance import FUNCTIONS
from rigctl.discovery.chance import Chance, draw_chance, log_tail, span
from rigctl.discovery.open_slots import OpenSlots, products_at, splines_at
from rigctl.effects.drivers import Driver
from rigctl.engine.one_thread import one_thread
from rigctl.engine.splines import SplineArgument
from rigctl.physics.family import Slot
from rigctl.tasks import counted

Floats = NDArray[np.float64]

#: number of splines over each of two variables, of locations tested that way, and of those tested once more
FEW, PLACES, AGAIN = 5, 8, 6
#: number of samples of a record used for the correlation of hypotheses
_SAMPLES = 100
#: number of slots simulated at once
_AT_ONCE = 4
#: slots are one location if their χ² differ by less than this share for every variable
_ALIKE = 1e-3
#: number of locations over one variable whose formulas are tried, and of pairs of variables at the first
#: locations
_SINGLES, _PAIRS = 4, (4, 2, 1)
#: of those that explain as much as the best: number over one variable, and of pairs at each of the first
#: locations
_MORE_SINGLES, _MORE_PAIRS = 16, (5, 3, 3, 3, 2, 2, 1, 1)
#: possible error of a linear model of a large effect, as a share of χ²: a smaller difference excludes no
#: location
_AS_MUCH = 0.05
#: power at which a term counts as detectable
_POWER = 0.8


@dataclass(frozen=True)
class Located:
    """A slot and a variable, and how much a smooth term of the variable there would explain.

    Attributes
    ----------
    over: the variables: one, or two for a term of both.
    statistic, dof: χ² and its degrees of freedom; dof is 0 if the data cannot show it.
    p_value: family-wise, of the best of all hypotheses.
    share: of the misfit that it explains, 0 … 1.
    alike: other slots at which a term has the same signature in these data.
    log_alone: logarithm of its p-value as the only hypothesis.
    """

    slot: Slot
    over: tuple[Driver, ...]
    statistic: float
    dof: int
    p_value: float
    share: float
    alike: tuple[str, ...] = ()
    log_alone: float = field(default=0.0, repr=False)

    @property
    def name(self) -> str:
        """``friction over velocity``."""
        return f"{self.slot.name} over {' and '.join(driver.name for driver in self.over)}"

    @property
    def size(self) -> float:
        """λ, its size in sigmas."""
        return math.sqrt(max(self.statistic - self.dof, 0.0))

    def cost(self, samples: float) -> float:
        """The ranking criterion: less is better."""
        return self.dof * math.log(samples) - self.statistic

    def explains_as_much_as(self, best: Located) -> bool:
        """Whether the difference is no reason to exclude it."""
        return self.statistic >= best.statistic - max(LEAST_DIFFERENCE, _AS_MUCH * best.statistic)

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
    """All hypotheses that were tested.

    Attributes
    ----------
    located: by decreasing ``χ² − dof·ln N_eff``; one slot for each location.
    hidden: slots at which a term cannot be seen, as it is equivalent to record-level or fitted unknowns.
    tests, independent: number of hypotheses, and of equivalent independent ones.
    needed: λ at which one of them would be detected with probability 0.8.
    """

    located: tuple[Located, ...]
    hidden: tuple[Located, ...]
    tests: int
    independent: float
    needed: float

    @property
    def sure(self) -> bool:
        """Whether any location is significant."""
        return bool(self.located) and self.located[0].p_value < ALPHA

    @property
    def most_wanted(self) -> tuple[Located, ...]:
        """Where formulas are tried: over one variable the best locations, over two the best of several slots,
        because what is missing at a slot may be hidden in several pairs of variables that change together.

        Where the data hardly distinguish locations or variables, there are more: any may be the true one.
        """
        seen = [one for one in self.located if one.p_value < ALPHA]
        single = [one for one in seen if len(one.over) == 1]
        chosen = [
            one
            for k, one in enumerate(single[:_MORE_SINGLES])
            if k < _SINGLES or one.explains_as_much_as(single[0])
        ]
        double: dict[str, list[Located]] = {}
        for one in seen:
            if len(one.over) == 2:
                double.setdefault(one.slot.name, []).append(one)
        for k, (pairs, more) in enumerate(zip(double.values(), _MORE_PAIRS, strict=False)):
            few = _PAIRS[k] if k < len(_PAIRS) else 0
            # by what they explain: a formula does not pay for the splines' degrees of freedom
            as_much = sorted(
                (one for one in pairs if one.explains_as_much_as(seen[0])), key=lambda one: -one.statistic
            )
            chosen += dict.fromkeys([*pairs[:few], *as_much[:more]])
        return tuple(chosen)


@one_thread()
def locate(
    opened: OpenSlots, samples: float, only: str | None = None, on_progress: OnProgress = no_progress
) -> Map:
    """Every slot and variable that these data can show, singly and, for the best, in pairs.

    Parameters
    ----------
    samples: N_eff, the effective sample size.
    only: restricts the search to the slot with this name.
    """
    # 1. One variable: every slot, every variable, some slots in one simulation.
    slots = [slot for slot in opened.slots if only is None or slot.name == only]
    tried: list[Located] = []
    seen_at = _Thinned(opened)
    batches = [slots[first : first + _AT_ONCE] for first in range(0, len(slots), _AT_ONCE)]
    for chosen in counted(batches, "Testing places in the equations", on_progress):
        tried += _at_slots(opened, chosen, seen_at)
    singles = sorted(_one_place_each(tried), key=lambda one: one.cost(samples))
    seen = [one for one in singles if one.dof]
    if not seen:
        return Map((), tuple(singles), tests=len(singles), independent=0.0, needed=math.inf)
    on_progress("Testing two variables together")
    # 2. Two variables, where one shows something. Products of splines are many columns: all pairs at all
    #    slots would cost too much.
    pairs = _pairs(opened, seen, samples)
    on_progress("Simulating the null distribution")
    # 3. Family-wise p-values. Pairs were chosen by what singles showed, and are not simulated: they count in
    #    full.
    chance = replace(seen_at.chance(seen), more=len(pairs))
    located = [
        replace(one, p_value=chance.family_wise(one.log_alone))
        for one in sorted([*seen, *pairs], key=lambda one: one.cost(samples))
    ]
    return Map(
        located=tuple(located),
        hidden=tuple(one for one in singles if not one.dof),
        tests=chance.tests + chance.more,
        independent=chance.independent,
        needed=_needed(chance),
    )


@dataclass
class _Thinned:
    """The readings of every hypothesis at some samples, from which their correlation is computed."""

    opened: OpenSlots
    readings: dict[tuple[str, tuple[Driver, ...]], list[NDArray[np.float32]]] = field(default_factory=dict)

    def keep(self, slot: Slot, over: tuple[Driver, ...], readings: Sequence[Floats]) -> None:
        """Remember a hypothesis by its columns of readings."""
        at = self.opened.chosen(_SAMPLES)
        kept = [one[rows].astype(np.float32) for one, rows in zip(readings, at, strict=True)]
        self.readings[slot.name, over] = kept

    def chance(self, searched: Sequence[Located]) -> Chance:
        """The null distribution of the whole search."""
        groups: list[slice] = []
        parts: list[list[NDArray[np.float32]]] = []
        first = 0
        for one in searched:
            columns = self.readings[one.slot.name, one.over]
            count = columns[0].shape[2]
            groups.append(slice(first, first + count))
            parts.append(columns)
            first += count
        every = [np.concatenate(rows, axis=2, dtype=float) for rows in zip(*parts, strict=True)]
        return draw_chance(self.opened.thinned(_SAMPLES).project(every), groups)


def _at_slots(opened: OpenSlots, slots: Sequence[Slot], seen_at: _Thinned) -> Iterator[Located]:
    """Every variable at some slots, in one simulation."""
    arguments = [
        (driver, SplineArgument(dict(driver.weights), knots))
        for driver in opened.drivers
        if (knots := opened.knots(driver, FUNCTIONS)) is not None
    ]
    every = opened.readings(splines_at([(slot, argument) for slot in slots for _, argument in arguments]))
    width = len(arguments) * FUNCTIONS
    for k, slot in enumerate(slots):
        readings = [one[:, :, k * width : (k + 1) * width] for one in every]
        projected = opened.project(readings)
        for index, (driver, _) in enumerate(arguments):
            chosen = slice(index * FUNCTIONS, (index + 1) * FUNCTIONS)
            seen_at.keep(slot, (driver,), [one[:, :, chosen] for one in readings])
            yield _located(projected, chosen, slot, (driver,))


def _located(projected: Projected, chosen: slice, slot: Slot, over: tuple[Driver, ...]) -> Located:
    # χ² = |Uᵀr̃|² with U an orthonormal basis of S̃, its rank as degrees of freedom. Directions that the
    # fitted unknowns absorb are not in U; if none is left, the data cannot show a term here (dof = 0).
    basis = span(projected, chosen)
    statistic, dof = float(np.square(basis.T @ projected.residual).sum()), basis.shape[1]
    excess = max(float(projected.residual @ projected.residual) - projected.dof, statistic, 1.0)
    tail = log_tail(statistic, dof, projected.noise_degrees).item() if dof else 0.0
    return Located(slot, over, statistic, dof, math.exp(tail), statistic / excess, log_alone=tail)


def _one_place_each(tried: Sequence[Located]) -> list[Located]:
    """Slots whose χ² is the same for every variable are one location, named after the first of them."""
    by_slot: dict[str, dict[tuple[Driver, ...], Located]] = {}
    for one in tried:
        by_slot.setdefault(one.slot.name, {})[one.over] = one
    leaders: dict[str, list[str]] = {}
    for name, of_slot in by_slot.items():
        same = next((other for other in leaders if _same(of_slot, by_slot[other])), None)
        if same is None:
            leaders[name] = []
        else:
            leaders[same].append(name)
    return [replace(one, alike=tuple(leaders[one.slot.name])) for one in tried if one.slot.name in leaders]


def _same(of_slot: dict[tuple[Driver, ...], Located], other: dict[tuple[Driver, ...], Located]) -> bool:
    return all(
        one.dof == other[over].dof
        and abs(one.statistic - other[over].statistic) <= _ALIKE * (one.statistic + one.dof)
        for over, one in of_slot.items()
    )


@dataclass
class _Pairs:
    """The terms of two variables, ``w = Σ_kl b_kl·B_k(x)·B_l(y)``, that have been tested.

    Attributes
    ----------
    best: for each slot that can be seen, the best term of one variable.
    """

    opened: OpenSlots
    best: Mapping[str, Located]
    samples: float
    tested: dict[tuple[str, frozenset[Driver]], Located] = field(default_factory=dict)
    with_all: set[tuple[str, Driver]] = field(default_factory=set)

    def test(self, slot: str, driver: Driver, others: Sequence[Driver]) -> None:
        """Test a variable at a slot together with each of others."""
        new = [other for other in others if (slot, frozenset((driver, other))) not in self.tested]
        if new:
            for one in _with_others(self.opened, self.best[slot], driver, new):
                self.tested.setdefault((one.slot.name, frozenset(one.over)), one)

    def test_with_all(self, slot: str, driver: Driver) -> None:
        """Test a variable at a slot together with every other one."""
        if (slot, driver) not in self.with_all:
            self.with_all.add((slot, driver))
            self.test(slot, driver, self.opened.drivers)

    def first(self, count: int) -> list[Located]:
        """The best pair of each slot, of the best slots."""
        of_slot: dict[str, Located] = {}
        for one in sorted(self.tested.values(), key=lambda one: one.cost(self.samples)):
            of_slot.setdefault(one.slot.name, one)
        return list(of_slot.values())[:count]


def _pairs(opened: OpenSlots, singles: Sequence[Located], samples: float) -> list[Located]:
    """The terms of two variables at the most probable locations.

    x is the best single variable at a location, y any other. At every further location the globally best
    variable is tested together with the location's own best: a drag at one position shows little over either
    alone, and would otherwise be missing from the list of possible locations. Then, at the locations of the
    best pairs, each of the pair's variables is tested with any other, because either may have acted as a
    proxy for another that changes with it, as the spool's position for the sign of the speed. Last, the best
    pair of each of these locations is tested at all others: a damper near the end of the stroke depends on
    position and speed, whether it acts as friction or as a resistance of the lines.
    """
    best: dict[str, Located] = {}
    for one in singles:
        best.setdefault(one.slot.name, one)
    pairs = _Pairs(opened, best, samples)
    for name, one in list(best.items())[:PLACES]:
        pairs.test_with_all(name, one.over[0])
    (most,) = singles[0].over
    for name in list(best)[PLACES:]:
        own = [one.over[0] for one in singles if one.slot.name == name]
        pairs.test(name, most, [other for other in own if not other.variables & most.variables][:1])
    for one in pairs.first(AGAIN):
        for driver in one.over:
            pairs.test_with_all(one.slot.name, driver)
    partners: dict[Driver, dict[Driver, None]] = {}
    for one in pairs.first(AGAIN):
        shared, other = sorted(one.over, key=lambda driver: driver != most)
        partners.setdefault(shared, {})[other] = None
    for name in best:
        for shared, others in partners.items():
            pairs.test(name, shared, list(others))
    return list(pairs.tested.values())


def _with_others(
    opened: OpenSlots, place: Located, driver: Driver, others: Sequence[Driver]
) -> Iterator[Located]:
    """Terms of one variable and each of others at a location, in one simulation."""
    arguments = {
        other: SplineArgument(dict(other.weights), knots)
        for other in (driver, *others)
        if (knots := opened.knots(other, FEW)) is not None
    }
    paired = [other for other in arguments if not other.variables & driver.variables]
    if driver not in arguments or not paired:
        return
    every = opened.readings(
        products_at(place.slot, arguments[driver], *(arguments[other] for other in paired))
    )
    projected = opened.project(every)
    for k, other in enumerate(paired):
        chosen = slice(k * FEW * FEW, (k + 1) * FEW * FEW)
        located = _located(projected, chosen, place.slot, (driver, other))
        if located.dof:
            yield replace(located, alike=place.alike)


def _needed(chance: Chance) -> float:
    """λ of a detectable term with as many degrees of freedom as one variable has."""
    from scipy.special import chndtrinc, gammainccinv

    critical = 2.0 * gammainccinv(0.5 * FUNCTIONS, max(chance.level(ALPHA), 1e-12))
    return math.sqrt(float(chndtrinc(critical, FUNCTIONS, 1.0 - _POWER)))
