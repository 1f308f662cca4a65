"""Effects that may be confused with one that was found, and where their predictions differ most.

In: a search with its best set. Out: a `Rival` for each effect that could take the place of a member: those
whose linearised signatures are alike, those that a search has put aside or fitted on its way, and pairs in
place of a single effect. Each is refitted, because the linear problem knows no bounds. Whether a rival is
excluded needs all of: a separation beyond chance, a difference of mBIC, and more than two laws of one effect
may differ by (`Rival.separable`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from rigctl.analysis.decision_levels import (
    AT_LIMIT,
    CHANGE_PLACES,
    DISCREPANCY_LIMIT,
    LEAST_DIFFERENCE,
    LEAST_SEPARATION,
    MANY_FLOORS,
    REFIT_SCATTER,
    STAND_IN,
    TOLERANCE,
)
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.separability import consistent_gain, cosine, directions, separation
from rigctl.analysis.search.identity import same_cause
from rigctl.analysis.search.own_scale import squares, times_the_floor
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.effects.declaration import Effect, qualified
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.tasks import counted
from rigctl.units import parse_unit

#: no cosine is given for a phase that holds less than this share of all that an effect does
_SHOWS = 0.01
_MOST_VARIABLES = 2


@dataclass(frozen=True)
class Differs:
    """Where the readings that two fits predict differ most, in units of the noise.

    Attributes
    ----------
    channel, phase: the reading, and the phase of the record; no phase for a table.
    condition: of the record that shows the difference most, in words; "" if no variable distinguishes
        records.
    largest: the largest difference there, in `unit`.
    alike: for each phase, the cosine between the changes that the two make in that channel, largest first.
    """

    channel: str
    phase: str
    condition: str
    largest: float
    unit: str
    alike: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Rival:
    """Another effect in place of one that was found.

    Attributes
    ----------
    member, name: the effect that was found, and its rival.
    trial: the set with the rival, fitted.
    cos: cosine between their signatures, after projection off the fitted parameters.
    separation: d; the right one of the two wins with probability Φ(d).
    difference: mBIC of the rival set less that of the best; where it could matter, with the discrepancies of
        their laws integrated out.
    differs: where the two differ most; None if they predict the same.
    share: the difference of their χ² as a share of what the found effect explains.
    unusual: which of the rival's parameters are outside their usual range, in words; "" if none is.
    nested: the parameter of the found effect, and its value, at which that effect becomes the rival, if the
        fit is not significantly different from it; else "".
    beside: the second effect of a pair that together replaces a single one; else "".
    both_leave: neither explains the misfit to its noise, and their errors differ by less than what both leave
        may decide.
    """

    member: str
    name: str
    trial: RefittedSet = field(repr=False)
    cos: float
    separation: float
    difference: float
    differs: Differs | None
    share: float = 1.0
    unusual: str = ""
    nested: str = ""
    beside: str = ""
    both_leave: bool = False

    @property
    def separable(self) -> bool:
        """True if these data distinguish the two by more than two laws of one effect may differ."""
        return (
            self.separation >= LEAST_SEPARATION
            and self.difference >= LEAST_DIFFERENCE
            and not self.within_tolerance
            and not self.nested
            and not self.both_leave
        )

    @property
    def within_tolerance(self) -> bool:
        """True if the two differ by less than the shape of an effect's law may: a tenth of its size."""
        return self.share < TOLERANCE**2


def each_once(rivals: Sequence[Rival]) -> list[Rival]:
    """Rivals, of which the two members of a replacing pair are mentioned once."""
    once: list[Rival] = []
    for one in rivals:
        if not any((other.name, other.beside) == (one.beside, one.name) for other in once):
            once.append(one)
    return once


def find_rivals(search: Search, best: RefittedSet) -> list[Rival]:
    """For every member of the best set, the effects with which it may be confused."""
    rivals = []
    for member in counted(best.candidates, "Looking for what could be mistaken for it", search.on_progress):
        # 1. Rivals of the linear problem, refitted in place of the member with all others kept.
        tried = search.rivals(best, member)
        explained = search.explained(best, member)
        for trial, cos, d in tried:
            # the refits also respect sizes that physics forbids
            distance = max(d, _by_refit(trial, best))
            share = (trial.chi2 - best.chi2) / max(explained, 1e-12)
            # Three measures of one difference: the separation in sigmas, mBIC (or the evidence, where the
            # shapes of laws could make up for it), and the share of what the member explains. All three have
            # to be large before the rival is excluded (`Rival.separable`).
            difference = search.mbic(trial) - search.mbic(best)
            if difference >= LEAST_DIFFERENCE and share < DISCREPANCY_LIMIT:
                difference = min(difference, search.evidence(trial) - search.evidence(best))
            if search.left(best) > 0.0 and difference < STAND_IN * explained:
                # neither is right, so the noise no longer gives the probability of a difference
                distance = min(distance, consistent_gain(best.fit, trial.fit, len(tried)))
            rivals += [
                Rival(
                    member.name,
                    other,
                    trial,
                    cos,
                    distance,
                    difference,
                    where_they_differ(search.null.fit, best.fit, trial.fit),
                    share=share,
                    unusual=trial.unusual.get(other, ""),
                    nested=nested_at(best.fit, member.effect, other),
                    both_leave=_both_leave(search, best, trial),
                )
                for other in trial.effects
                if other not in best.effects
            ]
    # 2. What the search met on its way: a better set put aside for an unusual size; for a single effect,
    #    others that were refitted although their signatures differ, and pairs that explain as much.
    rivals += _aside(search, best, {rival.name for rival in rivals})
    if len(best.candidates) == 1:
        rivals += _known(search, best, {rival.name for rival in rivals})
        rivals += _two_instead(search, best)
    return rivals


def nested_at(fit: FitResult, effect: Effect, other: str) -> str:
    """The parameter at whose limit `effect` becomes the other one, if its fit is close to it.

    A fit that stopped at its bound on that side counts as being there.
    """
    # The limit is either another parameter of the effect (static friction equal to sliding friction) or a
    # number, which may lie at or beyond a bound, where a fit can only stop.
    known = {u.name: (u, float(value)) for u, value in zip(fit.problem.shared, fit.values, strict=True)}
    for name, limit, law in effect.becomes:
        qualified_name = qualified(effect.name, name)
        if law != other or qualified_name not in known:
            continue
        if isinstance(limit, str):
            lower = qualified(effect.name, limit)
            if lower in known and _within_chance(fit, lower, qualified_name):
                return f"{name} equal to its {limit}"
            continue
        unknown, value = known[qualified_name]
        beyond = (
            unknown.lower if limit <= unknown.lower else unknown.upper if limit >= unknown.upper else None
        )
        stopped = (
            qualified_name in fit.at_bound
            and beyond is not None
            and math.isclose(value, beyond, rel_tol=1e-6)
        )
        if stopped or abs(value - limit) <= AT_LIMIT * fit.std.get(qualified_name, 0.0):
            return f"{name} {limit:g}"
    return ""


def _within_chance(fit: FitResult, one: str, other: str) -> bool:
    """Whether two unknowns do not differ significantly; those kept apart by their order alone are equal."""
    names = [unknown.name for unknown in fit.problem.shared]
    indices = [names.index(name) for name in (one, other)]
    first, second = (float(value) for value in fit.values[indices])
    if math.isclose(first, second, rel_tol=1e-6):
        return True
    if fit.solution is None:
        return False
    (of_one, both), (_, of_other) = fit.solution.covariance[np.ix_(indices, indices)]
    variance = float(of_one + of_other - 2.0 * both)
    return bool(abs(second - first) <= AT_LIMIT * math.sqrt(max(variance, 0.0)))


def _aside(search: Search, best: RefittedSet, listed: Collection[str]) -> list[Rival]:
    """The better set that was put aside for an unusual size: always a rival, whatever its cosine."""
    trial = search.unusual_best
    if trial is None or not best.effects:
        return []
    members = [name for name in best.effects if name not in trial.effects] or [*best.effects]
    return [
        Rival(
            members[0],
            other,
            trial,
            cos=1.0,
            separation=0.0,
            difference=search.mbic(trial) - search.mbic(best),
            differs=where_they_differ(search.null.fit, best.fit, trial.fit),
            share=0.0,
            unusual=trial.unusual.get(other, ""),
        )
        for other in trial.effects
        if other not in best.effects and other not in listed
    ]


def _known(search: Search, best: RefittedSet, listed: Collection[str]) -> list[Rival]:
    """Of the other effects that were refitted singly, those that fit as well; else the best, worth reporting.

    A refit counts, whatever the cosine: two lags in series differ at the fit of one of them, and either alone
    explains the same.
    """
    others = [
        trial
        for trial in search.trials.values()
        if len(trial.candidates) == 1 and trial.effects[0] not in (*best.effects, *listed)
    ]
    if not others:
        return []
    rivals = [one for trial in others for one in [_known_rival(search, best, trial)] if one is not None]
    close = [one for one in rivals if one.difference < LEAST_DIFFERENCE or one.both_leave]
    return close or [one for one in sorted(rivals, key=lambda one: one.difference)[:1] if one.separable]


def _known_rival(search: Search, best: RefittedSet, trial: RefittedSet) -> Rival | None:
    """A single effect in place of the best one, from its refit; None if it was found in another way."""
    lin = search.before.linearisation
    member, other = best.candidates[0], trial.candidates[0]
    if member not in lin.candidates or other not in lin.candidates:
        return None
    cos = cosine(search.before.projected, lin.candidates.index(member), lin.candidates.index(other))
    difference = search.mbic(trial) - search.mbic(best)
    distance = _by_refit(trial, best)
    differs = where_they_differ(search.null.fit, best.fit, trial.fit)
    share = (trial.chi2 - best.chi2) / max(search.explained(best, member), 1e-12)
    unusual = trial.unusual.get(other.name, "")
    both = _both_leave(search, best, trial)
    return Rival(
        member.name,
        other.name,
        trial,
        cos,
        distance,
        difference,
        differs,
        share,
        unusual,
        both_leave=both,
    )


def _both_leave(search: Search, best: RefittedSet, trial: RefittedSet) -> bool:
    """Whether two sets leave much more than the white floor, and not much more or less than each other.

    What both leave is then no noise but a part of the bench that neither has, and which of them fits better
    beside it is not known: an effect at an input and one in the dynamics may change places.
    """
    if not search.in_own_scale or times_the_floor(best.fit) <= MANY_FLOORS:
        return False
    return squares(trial.fit) < CHANGE_PLACES * squares(best.fit)


def _two_instead(search: Search, best: RefittedSet) -> list[Rival]:
    """Two other effects that explain more than the single leading one, though not significantly so.

    Only if the single effect leaves hardly anything: otherwise pairs were part of the search, and the verdict
    weighs what they explain beyond a single effect. With the discrepancies of the laws integrated out the
    pair must not be distinguished: the scatter of a delay may explain what no pair does. A pair that holds
    another law of the leading one's cause replaces its law alone: the other member of the pair does not count
    as surely missing.
    """
    if not search.sure(best):
        return []
    (member,) = best.candidates
    pairs = [
        trial
        for trial in search.trials.values()
        if len(trial.effects) == 2
        and member.name not in trial.effects
        and search.mbic(trial) < search.mbic(best)
        and search.evidence(trial) < search.evidence(best) + LEAST_DIFFERENCE
    ]
    if not pairs:
        return []
    trial = min(pairs, key=search.mbic)
    laws = {one.name for one in trial.candidates if same_cause(member.effect, one.effect)}
    cos = _likeness(search, member, trial.candidates)
    explained = search.explained(best, member)
    differs = where_they_differ(search.null.fit, best.fit, trial.fit)
    return [
        Rival(
            member.name,
            name,
            trial,
            cos,
            separation(math.sqrt(explained), cos),
            search.evidence(trial) - search.evidence(best),
            differs,
            share=(trial.chi2 - best.chi2) / max(explained, 1e-12),
            unusual=trial.unusual.get(name, ""),
            beside=other,
        )
        for name, other in (trial.effects, trial.effects[::-1])
        if name in laws or not laws
    ]


def _likeness(search: Search, member: Candidate, others: Sequence[Candidate]) -> float:
    """Cosine between an effect's signature and the nearest combination of the others'; 0 if one is not among
    the candidates."""
    known = search.before.linearisation.candidates
    if any(one not in known for one in (member, *others)):
        return 0.0
    first, *rest = (directions(search.before.projected, known.index(one)) for one in (member, *others))
    both = np.linalg.qr(np.hstack(rest))[0]
    return float(np.linalg.svd(both.T @ np.linalg.qr(first)[0], compute_uv=False)[0]) if first.size else 0.0


def _by_refit(trial: RefittedSet, best: RefittedSet) -> float:
    """The least separation that refits show: ``sqrt(Δχ²)/2``, less twice its standard deviation of ½.

    Δχ² has mean 4d² (approximately) and standard deviation 4d.
    """
    return 0.5 * math.sqrt(max(trial.chi2 - best.chi2, 0.0)) - REFIT_SCATTER


def classes_of(best: RefittedSet, rivals: Sequence[Rival]) -> tuple[tuple[str, ...], ...]:
    """Each member with the rivals from which it is not distinguished."""
    return tuple(
        (
            name,
            *dict.fromkeys(rival.name for rival in rivals if rival.member == name and not rival.separable),
        )
        for name in best.effects
    )


def where_they_differ(none: FitResult, one: FitResult, other: FitResult) -> Differs | None:
    """The channel and phase with the largest squared difference in units of the noise, and the record in it.

    None if the two predict the same; `none` is the fit of the model without either.
    """
    problem = one.problem
    # a = W·Δy of one effect, b = W·Δy of the other (here with σ alone, without the correlation of the noise):
    # the place of the largest |a − b|² over phases and channels, then the record that contributes most to it.
    changes = [_changes(none, one, other, k) for k in one.fitted]
    squares = {key: sum(change.get(key, _NOTHING)[2] for change in changes) for key in _keys(changes)}
    if not any(squares.values()):
        return None
    best = max(squares, key=lambda key: squares[key])
    index = max(range(len(changes)), key=lambda index: changes[index].get(best, _NOTHING)[2])
    k = one.fitted[index]
    measurements = problem.measurements
    unit = parse_unit(measurements.units[best[0]])
    return Differs(
        channel=measurements.titles.get(measurements.outputs[best[0]], measurements.outputs[best[0]]),
        phase="" if measurements.table else best[1],
        condition=_point(problem.records[k], measurements),
        largest=_largest(one, other, k, best) / unit.factor,
        unit="K" if unit.offset else unit.text,
        alike=_alike(changes, best[0]),
    )


def _point(record: MeasuredRecord, measurements: Measurements) -> str:
    """The operating point, by the first few of the variables that distinguish records."""
    known = {name: record.condition[name] for name in measurements.variables if name in record.condition}
    return condition_text(dict(list(known.items())[:_MOST_VARIABLES]), variable_units(measurements))


#: by (channel, phase): the squared change by one effect, by the other, and the square of their difference
Changes: TypeAlias = dict[tuple[int, str], tuple[float, float, float]]
_NOTHING = (0.0, 0.0, 0.0)


def _changes(none: FitResult, one: FitResult, other: FitResult, k: int) -> Changes:
    """The changes in one record, in units of the noise."""
    problem, record = one.problem, one.problem.records[k]
    ok, sigma = problem.ok[k], problem.sigma[k]
    first = np.where(ok, one.outputs[k] - none.outputs[k], 0.0) / sigma
    second = np.where(ok, other.outputs[k] - none.outputs[k], 0.0) / sigma
    changes = {}
    for phase, inside in zip(record.phases, record.samples_of_phases, strict=True):
        for c in range(first.shape[1]):
            a, b = first[inside, c], second[inside, c]
            changes[c, phase] = (float(a @ a), float(b @ b), float((a - b) @ (a - b)))
    return changes


def _keys(changes: Sequence[Changes]) -> list[tuple[int, str]]:
    return list(dict.fromkeys(key for change in changes for key in change))


def _alike(changes: Sequence[Changes], channel: int) -> tuple[tuple[str, float], ...]:
    """``cos = (|a|² + |b|² − |a − b|²)/(2·|a|·|b|)`` for each phase in which the effect is visible."""
    sums = {
        phase: np.sum([change.get((c, phase), _NOTHING) for change in changes], axis=0)
        for c, phase in _keys(changes)
        if c == channel
    }
    total = sum(float(a) for a, _, _ in sums.values())
    pairs = [
        (phase, float((a + b - d) / (2.0 * math.sqrt(a * b))))
        for phase, (a, b, d) in sums.items()
        if a > _SHOWS * total and b > 0.0
    ]
    return tuple(sorted(pairs, key=lambda one: -one[1]))


def _largest(one: FitResult, other: FitResult, k: int, key: tuple[int, str]) -> float:
    record = one.problem.records[k]
    inside = (record.phase == record.phases.index(key[1])) & one.problem.ok[k][:, key[0]]
    change = (other.outputs[k] - one.outputs[k])[inside, key[0]]
    return float(change[np.argmax(np.abs(change))])
