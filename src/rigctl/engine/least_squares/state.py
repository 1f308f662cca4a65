"""The values that a fit goes through: what is minimised, a point of it, and how far a step may go.

`Task` is what does not change during a fit. An `Iterate` is one point with everything known there: the cost
and the linearised residuals, from which a damped step and its expected decrease follow. A `State` is an
iterate and what the search has learnt on its way. All are immutable: a step that fails is undone by keeping
the state before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.arrow import Arrow, Vector, reduce_blocks
from rigctl.engine.least_squares.block import Block, Evaluate, Refused
from rigctl.engine.least_squares.bounded_step import bounded_step
from rigctl.engine.least_squares.unknown import Priors, Unknown, starts

Floats = NDArray[np.float64]

_FIRST_DAMPING = 1e-2
LEAST_DAMPING, MOST_DAMPING = 1e-12, 1e12
_CUT_OFF = 0.99  # share of the box: a longer step counts as limited by it
_AS_EXPECTED = 0.5  # ratio of the actual to the expected decrease above which the box of a limited step grows
_LONGER, _LONGEST = 2.0, 4.0  # growth of the box after such a step, and its largest size over the first
_SHORTER = 0.5  # a step after a rejected one is at most this long, relative to it
STRETCHED = 1.4  # ratio of the actual to the expected decrease above which a longer step is tried


@dataclass(frozen=True)
class Options:
    """When a fit ends.

    Attributes
    ----------
    cost: end when the next step is expected to lower the cost by less than this share of it.
    step: end when the next step would change every parameter by less than this share of its size.
    gradient: end when the cosine of the angle between the residuals and every column is below this.
    iterations: largest number of iterations.
    largest_step: largest change of a parameter in the first iteration, in units of its size; while steps
        lower the cost as expected, it may grow to four times that.
    rival: a cost already reached by another fit: far above it, this fit ends when a step is not expected to
        reduce the difference by a hundredth.
    accuracy: of the derivatives, asked at the end: no combination is determined that has less effect; None
        if they are exact.
    """

    cost: float = 1e-9
    step: float = 1e-8
    gradient: float = 1e-10
    iterations: int = 100
    largest_step: float = 0.3
    rival: float = math.inf
    accuracy: Callable[[], float] | None = None


@dataclass(frozen=True)
class Task:
    """What is minimised, and over which unknowns.

    Attributes
    ----------
    unknowns, local: the shared unknowns, and those of each record.
    lower, upper, size, priors: bounds, typical sizes and priors of all of them, in the order of a flat
        `Vector`: the shared ones first.
    nonlinear: which of them are damped, and limited by the box.
    """

    evaluate: Evaluate
    unknowns: tuple[Unknown, ...]
    local: tuple[tuple[Unknown, ...], ...]
    options: Options
    lower: Floats
    upper: Floats
    size: Floats
    nonlinear: NDArray[np.bool_]
    priors: Priors

    @classmethod
    def of(
        cls,
        evaluate: Evaluate,
        unknowns: Sequence[Unknown],
        local: Sequence[Sequence[Unknown]],
        options: Options,
    ) -> Task:
        """With the numbers of all unknowns in arrays."""
        everyone = [*unknowns, *chain.from_iterable(local)]
        numbers = np.array([(u.lower, u.upper, u.size) for u in everyone], dtype=float)
        lower, upper, size = numbers.reshape(-1, 3).T.copy()
        nonlinear = np.array([not unknown.linear for unknown in everyone], dtype=bool)
        own = tuple(tuple(each) for each in local)
        priors = Priors.of(everyone)
        return cls(evaluate, tuple(unknowns), own, options, lower, upper, size, nonlinear, priors)

    @property
    def start(self) -> Vector:
        """The starting values."""
        return Vector(starts(self.unknowns), tuple(starts(record_local) for record_local in self.local))

    def blocks(self, point: Vector, *, derivatives: bool) -> Sequence[Block] | Refused:
        """The residuals of every record at a point; `Refused` if the model has no value there."""
        blocks = self.evaluate(point.shared, point.local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        if any(not np.isfinite(block.residual).all() for block in blocks):
            return Refused("a residual is not a finite number")
        return blocks

    def cost(self, blocks: Sequence[Block], point: Vector) -> float:
        """Half the sum of squares, including the priors'."""
        prior = self.priors.residual(point.flat())
        data = sum(0.5 * float(block.residual @ block.residual) for block in blocks)
        return data + 0.5 * float(prior @ prior)

    def linearised(self, point: Vector, cost: float, blocks: Sequence[Block]) -> Iterate:
        """The iterate at a point whose derivatives are known.

        The blocks are large, and not needed any more: the arrow has their triangles.
        """
        arrow = reduce_blocks(blocks, len(self.unknowns), [len(unknowns) for unknowns in self.local])
        count = sum(block.residual.size for block in blocks)
        return Iterate(self, point, float(cost), arrow, arrow.norms().flat(), count)


@dataclass(frozen=True)
class Iterate:
    """A point, its cost, and the residuals linearised there.

    Attributes
    ----------
    longest: the largest length so far of each unknown's column.
    """

    task: Task
    point: Vector
    cost: float
    arrow: Arrow
    longest: Floats
    residual_count: int

    def moved(self, point: Vector, cost: float, blocks: Sequence[Block]) -> Iterate:
        """The iterate at another point."""
        there = self.task.linearised(point, cost, blocks)
        return replace(there, longest=np.maximum(self.longest, there.longest))

    @cached_property
    def flat(self) -> Floats:
        """The values of all unknowns."""
        return self.point.flat()

    @cached_property
    def scale(self) -> Floats:
        """Marquardt's scaling: the largest length so far of each column, at least the weight of its prior."""
        scale = np.maximum(self.longest, self.task.priors.weight)
        return np.where(scale > 0.0, scale, 1.0 / self.task.size)

    @cached_property
    def gradient(self) -> Floats:
        """The derivatives of the cost."""
        priors = self.task.priors
        return np.asarray(self.arrow.gradient().flat() + priors.weight * priors.residual(self.flat))

    def step(self, damping: float, reach: float) -> Vector:
        """The damped step inside the bounds and the box, in the parameters' own units."""
        # in scaled variables x·scale, in which every column has at most the length 1: there damping acts on
        # all unknowns alike (Marquardt), whatever their units
        task, scale, flat, like = self.task, self.scale, self.flat, self.point.like
        box = np.where(task.nonlinear, reach * np.maximum(task.size, np.abs(flat)), np.inf)
        lower = np.maximum(task.lower - flat, -box) * scale
        upper = np.minimum(task.upper - flat, box) * scale
        # one equation for each unknown beside the data's, total·step = target, for two: a damping's √λ·step =
        # 0, and a prior's weight·step = -residual
        residual, weight = task.priors.residual(flat), task.priors.weight / scale
        total = np.sqrt(weight**2 + damping * task.nonlinear)
        target = -weight * residual / total
        step = bounded_step(
            self.arrow.scaled(like(scale)), like(total), like(target), like(lower), like(upper)
        )
        return like(step.flat() / scale)

    def expected(self, step: Vector) -> float:
        """The decrease of the cost predicted by the linear model."""
        priors = self.task.priors
        residual, moved = priors.residual(self.flat), priors.weight * step.flat()
        return -(self.arrow.change(step) + float(moved @ (residual + 0.5 * moved)))

    def ahead(self, step: Vector, factor: float = 1.0) -> Vector:
        """The point at the end of a step, `factor` times as long, inside the bounds."""
        return self.point.like(np.clip(self.flat + factor * step.flat(), self.task.lower, self.task.upper))

    def change(self, step: Vector) -> Floats:
        """The change of each unknown, in units of its size."""
        return np.asarray(np.abs(step.flat()) / np.maximum(self.task.size, np.abs(self.flat)))

    def largest(self, step: Vector) -> float:
        """The largest change of a nonlinear unknown, in units of its size."""
        return float(self.change(step)[self.task.nonlinear].max(initial=0.0))


@dataclass(frozen=True)
class Trust:
    """How far the linear model is trusted.

    Attributes
    ----------
    reach: half the side of the box, in units of the unknowns' sizes.
    growth: the factor on the damping after the next rejected step.
    """

    reach: float
    damping: float = _FIRST_DAMPING
    growth: float = 2.0

    def after_success(self, gain: float, largest: float, first: float) -> Trust:
        """After a step with this ratio of the actual to the expected decrease.

        Less damping after a step as predicted by the linear model (Nielsen's rule), and a larger box if that
        limited it; `first` is what it was at the start.
        """
        damping, reach = self.damping, self.reach
        if gain <= STRETCHED:
            damping = max(LEAST_DAMPING, damping * max(1 / 3, 1.0 - (2.0 * gain - 1.0) ** 3))
        if largest > _CUT_OFF * reach and gain > _AS_EXPECTED:
            reach = min(_LONGER * reach, _LONGEST * first)
        return replace(self, reach=reach, damping=damping, growth=2.0)

    def for_shorter(self, at: Iterate, largest: float) -> Trust:
        """Damping increased (Nielsen's rule) until the next step is shorter than the rejected one.

        A small increase does not change a step that is limited by bounds or by the box.
        """
        damping, growth = self.damping, self.growth
        while True:
            damping, growth = damping * growth, growth * 2.0
            if damping > MOST_DAMPING or at.largest(at.step(damping, self.reach)) <= _SHORTER * largest:
                return replace(self, damping=damping, growth=growth)


@dataclass(frozen=True)
class State:
    """Where a search is, and what it has learnt.

    Attributes
    ----------
    rejected: whether a step from this iterate was rejected.
    timid: number of steps with little damping that failed.
    eager: whether derivatives are to be computed in the first evaluation of the next step.
    falls: by how much each step lowered the cost.
    """

    at: Iterate
    trust: Trust
    rejected: bool = False
    timid: int = 0
    eager: bool = True
    falls: tuple[float, ...] = ()

    def step(self) -> Vector:
        """The next step."""
        return self.at.step(self.trust.damping, self.trust.reach)
