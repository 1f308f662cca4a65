"""Levenberg-Marquardt for many records, with bounds and priors.

In: `Evaluate`, which gives whitened residuals and their derivatives of every record, and the unknowns, some
of all records and some of one. Out: a `LeastSquaresResult` with the values, their covariance and why it
ended.

One iteration is: a damped step within bounds and box (`_step`); late in a fit, one with less damping if
damping alone keeps it short (`_bolder`, `_dare`); the tests of the end (`_at_end`), before an evaluation
that would be wasted; then the evaluation, after which the step is taken, lengthened or shortened (`_try`).
An evaluation integrates every record, so everything else may be as thorough as it likes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.arrow import Vector, reduce_blocks
from rigctl.engine.least_squares.block import Block, Evaluate, Refused
from rigctl.engine.least_squares.bounded_step import BoundedStep, bounded_step
from rigctl.engine.least_squares.identifiability import null_columns
from rigctl.engine.least_squares.result import Iteration, LeastSquaresResult, Outcome
from rigctl.engine.least_squares.uncertainty import conclude
from rigctl.engine.least_squares.unknown import Priors, Unknown, starts
from rigctl.errors import ExitCode, RigctlError

Floats = NDArray[np.float64]

_FIRST_DAMPING = 1e-2
_STRETCHED = 1.4  # ratio of the actual to the expected decrease above which a longer step is tried
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e12
_LESS = 1e-2  # factor on the damping while damping alone limits the step's expected decrease
# a step is late if its expected decrease is below this multiple of the tolerance; less damping is tried if it
# could increase the decrease by this factor
_LITTLE = 10.0
_LATE = 1e-3  # share of the cost: a step with a larger expected decrease is not one of the last
_BOLD = 2  # number of failed steps with little damping after which no more are tried
_ASIDE = 3  # further steps tried from where such a step has raised the cost
_LEAST_GAIN = 1e-4  # least ratio of the actual to the expected decrease of an accepted step
_NEARER = 0.01  # share of the difference to the rival's cost that a step must be expected to gain
_CUT_OFF = 0.99  # share of the box: a longer step counts as limited by it
_AS_EXPECTED = 0.5  # ratio of the actual to the expected decrease above which the box of a limited step grows
_LONGER, _LONGEST = 2.0, 4.0  # growth of the box after such a step, and its largest size over the first
_SHORTER = 0.5  # a step after a rejected one is at most this long, relative to it
_PATIENCE = 4  # number of steps that together must lower the cost by the tolerance


class NoValueAtStart(RigctlError):
    """A model that cannot be evaluated with the starting values of a fit."""


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
    """

    cost: float = 1e-9
    step: float = 1e-8
    gradient: float = 1e-10
    iterations: int = 100
    largest_step: float = 0.3
    rival: float = math.inf


def least_squares(
    evaluate: Evaluate,
    unknowns: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    *,
    options: Options | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> LeastSquaresResult:
    """Minimise ``sum of residuals²/2 + sum of ((value - mean)/std)²/2`` over all parameters.

    A Levenberg-Marquardt method: Gauss-Newton steps with damping, scaled by the lengths of the columns
    (Marquardt), the damping updated by Nielsen's rule, within a box that grows while steps lower the cost as
    expected. If late in a fit a step lowers the cost little only because of the damping, that is reduced
    until half of the possible decrease is expected; a step that then leaves a curved valley is undone only if
    the next ones do not lead back into it. Parameters of a single record are eliminated record by record, so
    the computing time is linear in the number of records. A parameter at a bound is held there as long as
    it would leave the bounds (see `bounded_step`).

    Parameters
    ----------
    evaluate: residuals and derivatives of every record; see `block.Evaluate`.
    unknowns: the shared parameters.
    local: the parameters of each record alone; () if it has none.
    progress: called after every iteration.

    Raises
    ------
    RigctlError
        the model has no value at the start, a parameter without prior does not act on any residual there, or
        the blocks do not fit the parameters.

    Sources: K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004),
    section 3.2; J. J. Moré, The Levenberg-Marquardt algorithm (1978); R. M. Chamberlain and others, The
    watchdog technique for forcing convergence, Math. Programming Study 16 (1982) 1.
    """
    search = _Search(evaluate, unknowns, local, options or Options(), progress)
    return search.run()


class _Search:
    """One fit: the current point, its linearisation, and the damping."""

    def __init__(
        self,
        evaluate: Evaluate,
        unknowns: Sequence[Unknown],
        local: Sequence[Sequence[Unknown]],
        options: Options,
        progress: Callable[[Iteration], None] | None,
    ) -> None:
        self.evaluate, self.options, self.progress = evaluate, options, progress
        self.unknowns, self.local = tuple(unknowns), tuple(tuple(record_local) for record_local in local)
        self.all = [*self.unknowns, *(unknown for record_local in self.local for unknown in record_local)]
        self.point = Vector(starts(self.unknowns), tuple(starts(record_local) for record_local in self.local))
        self.lower = np.array([unknown.lower for unknown in self.all])
        self.upper = np.array([unknown.upper for unknown in self.all])
        self.size = np.array([unknown.size for unknown in self.all])
        self.nonlinear = np.array([not unknown.linear for unknown in self.all], dtype=bool)
        self.priors = Priors.of(self.all)
        self.damping, self.growth = _FIRST_DAMPING, 2.0
        self.reach = self.options.largest_step
        self.evaluations = self.iterations = 0
        self.column_size = np.zeros(len(self.all))
        self.falls: list[float] = []
        self.turned_down = False  # whether a step from the current point was rejected
        self.timid = 0  # number of steps with little damping that failed

    def run(self) -> LeastSquaresResult:
        """Iterate to an end and conclude."""
        blocks = self._blocks(self.point, derivatives=True)
        if isinstance(blocks, Refused):
            raise NoValueAtStart(
                f"the model has no value at the start of the fit: {blocks.reason}", exit_code=ExitCode.FAILED
            )
        self._linearise(blocks)
        self.cost = self._cost(blocks, self.point)
        self._refuse_null_columns(blocks)
        del blocks  # large, and not needed any more: the arrow has their triangles
        outcome, message = Outcome.ITERATIONS, "The allowed iterations were used up"
        eager = True
        while self.iterations < self.options.iterations:
            self.iterations += 1
            eager, ended = self._iterate(eager)
            if ended is not None:
                outcome, message = ended
                break
        return conclude(
            self.arrow,
            self.unknowns,
            self.local,
            self.point,
            cost=self.cost,
            residual_count=self.residual_count,
            outcome=outcome,
            message=message,
            iterations=self.iterations,
            evaluations=self.evaluations,
        )

    def _iterate(self, eager: bool) -> tuple[bool, tuple[Outcome, str] | None]:
        """One step; returns whether the next one should be eager (see `_try`), and the end if this is it."""
        before = self.cost
        bounded = self._step(self.damping)
        bolder = self._bolder(bounded)
        ended = None
        if bolder is None or not self._dare(*bolder):
            ended = self._at_end(bounded)
            if ended is not None:
                return False, ended
            eager, ended = self._try(bounded, eager)
        self.falls.append(before - self.cost)
        return eager, ended or self._out_of_patience()

    def _blocks(self, point: Vector, *, derivatives: bool) -> Sequence[Block] | Refused:
        self.evaluations += 1
        blocks = self.evaluate(point.shared, point.local, derivatives)
        if isinstance(blocks, Refused):
            return blocks
        if any(not np.isfinite(block.residual).all() for block in blocks):
            return Refused("a residual is not a finite number")
        return blocks

    def _linearise(self, blocks: Sequence[Block]) -> None:
        record_local = [len(unknowns) for unknowns in self.local]
        self.arrow = reduce_blocks(blocks, len(self.unknowns), record_local)
        self.residual_count = sum(block.residual.size for block in blocks)
        norms = self.arrow.norms().flat()
        self.column_size = np.maximum(self.column_size, norms)

    def _cost(self, blocks: Sequence[Block], point: Vector) -> float:
        prior = self.priors.residual(point.flat())
        data = sum(0.5 * float(block.residual @ block.residual) for block in blocks)
        return data + 0.5 * float(prior @ prior)

    def _refuse_null_columns(self, blocks: Sequence[Block]) -> None:
        names = [unknown.name for unknown in self.unknowns]
        without_prior = {unknown.name for unknown in self.unknowns if unknown.prior is None}
        null = [name for name in null_columns(blocks, names) if name in without_prior]
        norms = self.arrow.norms()
        for record_local, lengths in zip(self.local, norms.local, strict=True):
            null += [
                u.name for u, length in zip(record_local, lengths, strict=True) if not length and not u.prior
            ]
        if null:
            raise RigctlError(
                "a parameter of the fit does not act on any residual",
                value=", ".join(dict.fromkeys(null)),
                hint="Fix it, give it a prior, or start away from where it has no effect",
                exit_code=ExitCode.FAILED,
            )

    def _scale(self) -> Floats:
        """Marquardt's scaling: the largest length so far of each column, at least the weight of its prior."""
        scale = np.maximum(self.column_size, self.priors.weight)
        return np.where(scale > 0.0, scale, 1.0 / self.size)

    def _bolder(self, bounded: BoundedStep) -> tuple[float, BoundedStep] | None:
        """(damping, step) with less damping, if only the damping limits the expected decrease; else None.

        Damping restricts a step most in the directions that the data determine least: along a valley in which
        two parameters have nearly the same effect.
        """
        expected = self._expected(bounded.step)
        late = expected <= min(_LITTLE * self.options.cost, _LATE) * self.cost
        if not late or self.turned_down or self.timid >= _BOLD:
            return None
        free = self._expected(self._step(_LEAST_DAMPING).step)
        if free <= max(_LITTLE * expected, self.options.cost * self.cost):
            return None
        damping = self.damping
        while self._expected(bounded.step) < 0.5 * free and damping > _LEAST_DAMPING:
            damping = max(_LEAST_DAMPING, damping * _LESS)
            bounded = self._step(damping)
        return damping, bounded

    def _dare(self, damping: float, bounded: BoundedStep) -> bool:
        """Take a step with less damping if the cost then falls, immediately or after a few further steps.

        Along a curved valley every step of useful length ends on its side, and damping would shorten it to
        almost nothing; from there the next steps lead back to the valley's floor.
        """
        state = self.point, self.cost, self.arrow, self.column_size, self.damping
        before, largest = self.cost, self._largest(bounded.step)
        enough = before - _LEAST_GAIN * self._expected(bounded.step)
        self.damping = damping
        for remaining in range(_ASIDE, -1, -1):
            if not self._went(bounded.step, below=math.inf if remaining else enough):
                break
            if self.cost < enough:
                self.timid += before - self.cost <= self.options.cost * before
                self._report(largest, accepted=True)
                return True
            bounded = self._step(damping)
        self.point, self.cost, self.arrow, self.column_size, self.damping = state
        self.timid += 1
        return False

    def _went(self, step: Vector, *, below: float) -> bool:
        """Move to the end of a step if the cost there is less than `below`; False if it is not, or if the
        model cannot be evaluated.

        With a limit most steps end here: derivatives, the larger part of the work, are computed only below
        it.
        """
        trial, limited = self._ahead(step, 1.0), below < math.inf
        blocks = self._blocks(trial, derivatives=not limited)
        if limited and not isinstance(blocks, Refused):
            if not self._cost(blocks, trial) < below:
                return False
            blocks = self._blocks(trial, derivatives=True)
        if isinstance(blocks, Refused):
            return False
        self._move(trial, self._cost(blocks, trial), blocks)
        return True

    def _step(self, damping: float) -> BoundedStep:
        """The damped step inside the bounds, in the parameters' own units."""
        scale = self._scale()
        flat = self.point.flat()
        reach = np.where(self.nonlinear, self.reach * np.maximum(self.size, np.abs(flat)), np.inf)
        lower = np.maximum(self.lower - flat, -reach) * scale
        upper = np.minimum(self.upper - flat, reach) * scale
        residual, weight = self.priors.residual(flat), self.priors.weight / scale
        total = np.sqrt(weight**2 + damping * self.nonlinear)
        like = self.point.like
        bounded = bounded_step(
            self.arrow.scaled(like(scale)),
            like(total),
            like(-weight * residual / total),
            like(lower),
            like(upper),
        )
        step = like(bounded.step.flat() / scale)
        return BoundedStep(step, bounded.free, bounded.factors)

    def _expected(self, step: Vector) -> float:
        """The decrease of the cost predicted by the linear model."""
        residual, moved = self.priors.residual(self.point.flat()), self.priors.weight * step.flat()
        return -(self.arrow.change(step) + float(moved @ (residual + 0.5 * moved)))

    def _at_end(self, bounded: BoundedStep) -> tuple[Outcome, str] | None:
        step = bounded.step.flat()
        flat = self.point.flat()
        gradient = self.arrow.gradient().flat() + self.priors.weight * self.priors.residual(flat)
        blocked = ((flat <= self.lower) & (gradient > 0.0)) | ((flat >= self.upper) & (gradient < 0.0))
        length = np.sqrt(2.0 * self.cost) or 1.0
        cosine = np.abs(gradient[~blocked] / (self._scale()[~blocked] * length)).max(initial=0.0)
        if cosine <= self.options.gradient:
            return Outcome.GRADIENT, "The residuals cannot be made smaller"
        change = np.abs(step) / np.maximum(self.size, np.abs(flat))
        if change.max(initial=0.0) <= self.options.step:
            if self.damping > 1.0:
                return Outcome.STALLED, "No step lowers the cost"
            return Outcome.STEP, "No parameter moves any more"
        if self.damping < 1.0 and 0.0 <= self._expected(bounded.step) <= self._enough():
            return Outcome.COST, "The cost does not fall any more"
        return None

    def _out_of_patience(self) -> tuple[Outcome, str] | None:
        """End if the last steps lowered the cost by less than expected: the model's values are not accurate
        enough for more.

        This does not apply if all of them were rejected: then the damping is still too small.
        """
        last = sum(self.falls[-_PATIENCE:])
        if len(self.falls) >= _PATIENCE and 0.0 < last <= self._enough():
            return Outcome.COST, "The cost does not fall any more"
        return None

    def _enough(self) -> float:
        """The decrease of the cost below which the fit ends."""
        return max(self.options.cost * self.cost, _NEARER * (self.cost - self.options.rival))

    def _try(self, bounded: BoundedStep, eager: bool) -> tuple[bool, tuple[Outcome, str] | None]:
        """Evaluate the cost at the end of the step, and move there, or further, if it is lower.

        With `eager`, derivatives are computed in the first evaluation: most steps are accepted, and then one
        call does the work of two. Returns whether the next step should be eager, and the outcome if the fit
        ends.
        """
        trial = self._ahead(bounded.step, 1.0)
        expected = self._expected(bounded.step)
        blocks = self._blocks(trial, derivatives=eager)
        cost = np.inf if isinstance(blocks, Refused) else self._cost(blocks, trial)
        gain = (self.cost - cost) / expected if expected > 0.0 else -1.0
        accepted = gain > _LEAST_GAIN
        complete = eager
        if gain > _STRETCHED:
            trial, cost, complete = self._stretch(bounded.step, trial, cost, eager)
        largest, reason = self._largest(bounded.step), blocks.reason if isinstance(blocks, Refused) else ""
        if accepted and not complete:
            blocks = self._blocks(trial, derivatives=True)
            accepted = not isinstance(blocks, Refused)
        if accepted and not isinstance(blocks, Refused):
            self._move(trial, cost, blocks)
        self._report(largest, accepted=accepted, reason=reason)
        if accepted:
            self._relax(gain)
            if largest > _CUT_OFF * self.reach and gain > _AS_EXPECTED:
                self.reach = min(_LONGER * self.reach, _LONGEST * self.options.largest_step)
            return 0.25 < gain <= _STRETCHED, None
        self.turned_down = True
        self.reach = self.options.largest_step
        if 0.0 <= expected <= 1e-6 * self.cost and self.damping < 1.0:
            return False, (Outcome.COST, "The cost falls no further than the model is exact")
        self._shorten(largest)
        if self.damping > _MOST_DAMPING:
            return False, (Outcome.STALLED, "No step lowers the cost")
        return False, None

    def _shorten(self, largest: float) -> None:
        """Increase the damping (Nielsen's rule) until the next step is shorter than the rejected one.

        A small increase does not change a step that is limited by bounds or by the box.
        """
        while True:
            self.damping, self.growth = self.damping * self.growth, self.growth * 2.0
            if (
                self.damping > _MOST_DAMPING
                or self._largest(self._step(self.damping).step) <= _SHORTER * largest
            ):
                return

    def _move(self, point: Vector, cost: float, blocks: Sequence[Block]) -> None:
        self.point, self.cost, self.turned_down = point, float(cost), False
        self._linearise(blocks)

    def _relax(self, gain: float) -> None:
        """Reduce the damping after a step as predicted by the linear model (Nielsen's rule)."""
        if gain <= _STRETCHED:
            factor = max(1 / 3, 1.0 - (2.0 * gain - 1.0) ** 3)
            self.damping = max(_LEAST_DAMPING, self.damping * factor)
        self.growth = 2.0

    def _ahead(self, step: Vector, factor: float) -> Vector:
        flat = self.point.flat() + factor * step.flat()
        return self.point.like(np.clip(flat, self.lower, self.upper))

    def _stretch(
        self, step: Vector, trial: Vector, cost: float, complete: bool
    ) -> tuple[Vector, float, bool]:
        """Continue in the same direction while the cost falls further.

        If the cost falls faster than predicted by the linear model, as when two steep edges approach each
        other in time, the Gauss-Newton step is far too short. Returns (point, cost, whether the derivatives
        there are known).
        """
        for factor in (2.0, 4.0, 8.0):
            further = self._ahead(step, factor)
            blocks = self._blocks(further, derivatives=False)
            if isinstance(blocks, Refused):
                break
            next_cost = self._cost(blocks, further)
            if not next_cost < cost:
                break
            trial, cost, complete = further, next_cost, False
        return trial, cost, complete

    def _report(self, largest: float, *, accepted: bool, reason: str = "") -> None:
        if self.progress is not None:
            self.progress(Iteration(self.iterations, float(self.cost), largest, accepted, reason))

    def _largest(self, step: Vector) -> float:
        """The largest change of a parameter, in units of its size."""
        moved = np.abs(step.flat()) / np.maximum(self.size, np.abs(self.point.flat()))
        return float(moved[self.nonlinear].max(initial=0.0))
