"""Where a model leaves the ranges over which the laws of its effects were learned.

In: a fit (`departures`), or a simulated bench as it runs (`RangeWatch`). Out: where a law is extrapolated, at
the worst place of each range. It is a remark and ends nothing: to leave the range is the way to find out
whether a law extends further (decision 67).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.record_level import RECORD
from rigctl.effects.validity import ValidRange
from rigctl.engine.symbols import Scalar
from rigctl.model.fit.fit import FitResult
from rigctl.model.model import Model
from rigctl.model.values import choices
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Scope
from rigctl.rig.rig import Rig
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: margin beyond a range, as a share of its width, that is not reported, because a fit moves the states a
#: little
_MARGIN = 0.01


@dataclass(frozen=True)
class Departure:
    """Where a quantity is furthest outside the range over which the law of an effect was learned.

    Attributes
    ----------
    effect, side: the law, and which of its ranges.
    value: of the quantity there, SI.
    record: the record's label; `time` from its first sample, s.
    records: number of records in which it is outside; `of` the number of all.
    share: of all samples that are outside.
    row: the record is a row of a table, without a time axis.
    """

    effect: str
    side: ValidRange
    value: float
    record: str
    time: float
    records: int = 1
    of: int = 1
    share: float = 0.0
    row: bool = False

    @property
    def statement(self) -> str:
        """In words, with its location."""
        side = self.side
        when = "" if self.row else f" at {self.time:.3g} s"
        many = f", and {self.records} of {self.of} records leave it" if self.records > 1 else ""
        return (
            f"{self.effect} was learned for {side}; in {self.record}{when} it is {side.shown(self.value)}"
            f"{many}: beyond its range nothing is known of its law"
        )

    def document(self) -> dict[str, Any]:
        """Its machine-readable form; `value` in the unit of the range."""
        value = parse_unit(self.side.unit).from_si(self.value, difference=self.side.difference)
        return {
            "effect": self.effect,
            **self.side.document(),
            "value": value,
            "record": self.record,
            "time": None if self.row else self.time,
            "records": self.records,
            "share": self.share,
            "statement": self.statement,
        }


def departures(fit: FitResult) -> tuple[Departure, ...]:
    """Where the model of a fit leaves the ranges of validity of its effects on its data, the furthest first.

    Nothing for effects whose laws hold everywhere, and for a model that cannot be simulated there.
    """
    problem = fit.problem
    rig = problem.measurements.rig or problem.model.rig
    effects = [problem.model.effect(name) for name in problem.model.effects]
    if not any(effect.valid for effect in effects):
        return ()
    simulated = problem.simulate(fit.values, fit.local)
    if not simulated.ok:
        return ()
    # a range may be of any formula of the model's variables: it is evaluated along the trajectories of the
    # fit
    every = [_known(fit, index, states) for index, states in enumerate(simulated.states)]
    worst = [
        _worst(fit, effect, side, [quantity(side, problem.model.family, effects, one, rig) for one in every])
        for effect in effects
        for side in effect.valid
    ]
    return tuple(sorted((one for one in worst if one is not None), key=lambda one: -_distance(one)))


class RangeWatch:
    """Reports once for each range when a simulated bench leaves it.

    Attributes
    ----------
    sides: the effects with the ranges of their laws; none for a model whose laws hold everywhere.
    """

    def __init__(self, model: Model, rig: Rig) -> None:
        self._model = model
        self._rig = rig
        self._effects = [model.effect(name) for name in model.effects]
        self.sides = [(effect.name, side) for effect in self._effects for side in effect.valid]

    def left(self, known: Mapping[str, float]) -> list[str]:
        """In words, the ranges that states and inputs leave; each is reported once."""
        sentences: list[str] = []
        for name, side in list(self.sides):
            everything: dict[str, Scalar] = {**self._model.values, **known}
            value = float(quantity(side, self._model.family, self._effects, everything, self._rig))
            margin = _MARGIN * (side.high - side.low)
            if not side.low - margin <= value <= side.high + margin and np.isfinite(value):
                self.sides.remove((name, side))
                sentences.append(
                    f"{name} was learned for {side}, and it is {side.shown(value)}: beyond its range nothing "
                    "is known of its law"
                )
        return sentences


def quantity(
    side: ValidRange,
    family: ModelFamily,
    effects: Iterable[Effect],
    known: Mapping[str, Scalar],
    rig: Rig | None = None,
) -> Floats:
    """The quantity of a range, with `known` the equations' variables: numbers, or time series."""
    additions = [addition for effect in effects for addition in effect.additions()]
    scope = Scope(family, known, additions=additions, options=choices(family, rig))
    with np.errstate(all="ignore"):
        return np.asarray(side.formula(scope), dtype=float)


def _known(fit: FitResult, index: int, states: Floats) -> dict[str, Scalar]:
    """Every variable of the equations along a record, as fitted."""
    problem, record = fit.problem, fit.problem.records[index]
    system = problem.compiled.system
    # from the general to the special, each overriding the one before: the family, the model, what was held in
    # the fit, what was fitted, the record's own, and then states and inputs as series
    known: dict[str, Any] = {parameter.name: parameter.value for parameter in problem.model.family.parameters}
    known |= problem.model.values
    known |= dict(zip(system.parameter_names, problem.base.tolist(), strict=True))
    known |= {one.name: float(value) for one, value in zip(problem.shared, fit.values, strict=True)}
    for one, value in zip(problem.local[index], fit.local[index], strict=True):
        if one.kind == "parameter":
            known[one.name] = known.get(one.name, 0.0) + float(value)
    known |= {name: states[:, k] for k, name in enumerate(system.state_names)}
    for k, name in enumerate(system.input_names):
        known[name] = record.input_course(k)
        if name in record.unrecorded:
            known[name] = known[name] + known.get(qualified(RECORD, name), 0.0)
    return known


def _worst(fit: FitResult, effect: Effect, side: ValidRange, courses: Sequence[Floats]) -> Departure | None:
    """The largest excess over one range."""
    records = fit.problem.records
    margin = _MARGIN * (side.high - side.low)
    # how far outside, zero inside; NaN, where a formula has no value, is not outside
    beyond = [
        np.broadcast_to(np.nan_to_num(np.maximum(side.low - x, x - side.high), nan=0.0), record.times.shape)
        for x, record in zip(courses, records, strict=True)
    ]
    outside = [distance > margin for distance in beyond]
    where = [k for k, one in enumerate(outside) if one.any()]
    if not where:
        return None
    k = max(where, key=lambda index: float(beyond[index].max()))
    at = int(np.argmax(beyond[k]))
    return Departure(
        effect=effect.name,
        side=side,
        value=float(np.broadcast_to(courses[k], records[k].times.shape)[at]),
        record=records[k].label,
        time=float(records[k].times[at]),
        records=len(where),
        of=len(records),
        share=sum(int(one.sum()) for one in outside) / max(1, sum(one.size for one in outside)),
        row=records[k].row,
    )


def _distance(one: Departure) -> float:
    """The excess, in widths of the range."""
    side = one.side
    return max(side.low - one.value, one.value - side.high) / (side.high - side.low)
