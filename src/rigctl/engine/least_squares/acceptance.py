"""Which step is taken: evaluate the cost at its end, and go there, further, or nowhere.

Each function gets a `State` and returns an `Attempt` with the next one; a step that is not taken leaves the
state as it was, with what was learnt from it. An evaluation integrates every record, so everything else may
be as thorough as it likes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from rigctl.engine.least_squares.arrow import Vector
from rigctl.engine.least_squares.block import Refused
from rigctl.engine.least_squares.result import Outcome
from rigctl.engine.least_squares.state import LEAST_DAMPING, MOST_DAMPING, STRETCHED, Iterate, State

_LESS = 1e-2  # factor on the damping while damping alone limits the step's expected decrease
# a step is late if its expected decrease is below this multiple of the tolerance; less damping is tried if it
# could increase the decrease by this factor
_LITTLE = 10.0
_LATE = 1e-3  # share of the cost: a step with a larger expected decrease is not one of the last
_BOLD = 2  # number of failed steps with little damping after which no more are tried
_ASIDE = 3  # further steps tried from where such a step has raised the cost
_LEAST_GAIN = 1e-4  # least ratio of the actual to the expected decrease of an accepted step
_EXACT = (
    1e-6  # share of the cost: a rejected step with a smaller expected decrease was below the model's accuracy
)


@dataclass(frozen=True)
class Attempt:
    """What came of a step.

    Attributes
    ----------
    largest: the largest change of an unknown that it asked for, in units of its size; None if the fit ended
        before it.
    reason: why the model refused it, "" if it did not.
    ended: the outcome and its message, if the fit ends with this step.
    """

    state: State
    accepted: bool
    largest: float | None = None
    reason: str = ""
    ended: tuple[Outcome, str] | None = None


def bolder(state: State, step: Vector) -> tuple[float, Vector] | None:
    """(damping, step) with less damping, if only the damping limits the expected decrease; else None.

    Damping restricts a step most in the directions that the data determine least: along a valley in which two
    parameters have nearly the same effect.
    """
    # cheap tests first: only late in a fit is there anything to gain, and from a point where a step was just
    # rejected the linear model is not to be trusted further
    at, cost = state.at, state.at.task.options.cost
    expected = at.expected(step)
    late = expected <= min(_LITTLE * cost, _LATE) * at.cost
    if not late or state.rejected or state.timid >= _BOLD:
        return None
    # what a step without damping would gain: at least ten times as much, or damping is not what limits it
    free = at.expected(at.step(LEAST_DAMPING, state.trust.reach))
    if free <= max(_LITTLE * expected, cost * at.cost):
        return None
    damping = state.trust.damping
    while at.expected(step) < 0.5 * free and damping > LEAST_DAMPING:
        damping = max(LEAST_DAMPING, damping * _LESS)
        step = at.step(damping, state.trust.reach)
    return damping, step


def dared(state: State, damping: float, step: Vector) -> Attempt:
    """Take a step with less damping if the cost then falls, immediately or after a few further steps.

    Along a curved valley every step of useful length ends on its side, and damping would shorten it to almost
    nothing; from there the next steps lead back to the valley's floor.
    """
    # the watchdog: a step that raises the cost is taken for the time being, and judged by where the next ones
    # lead
    before, at = state.at, state.at
    largest = before.largest(step)
    enough = before.cost - _LEAST_GAIN * before.expected(step)
    for remaining in range(_ASIDE, -1, -1):
        # a step aside may raise the cost; the last one has to lead below it
        reached = _reached(at, step, below=math.inf if remaining else enough)
        if reached is None:
            break
        at = reached
        if at.cost < enough:
            little = before.cost - at.cost <= at.task.options.cost * before.cost
            trust = replace(state.trust, damping=damping)
            return Attempt(
                replace(state, at=at, trust=trust, rejected=False, timid=state.timid + little), True, largest
            )
        step = at.step(damping, state.trust.reach)
    return Attempt(replace(state, timid=state.timid + 1), False)


def _reached(at: Iterate, step: Vector, *, below: float) -> Iterate | None:
    """The iterate at the end of a step if the cost there is less than `below`; None if it is not, or if the
    model cannot be evaluated.

    With a limit most steps end here: derivatives, the larger part of the work, are computed only below it.
    """
    task, trial, limited = at.task, at.ahead(step), below < math.inf
    blocks = task.blocks(trial, derivatives=not limited)
    if limited and not isinstance(blocks, Refused):
        if not task.cost(blocks, trial) < below:
            return None
        blocks = task.blocks(trial, derivatives=True)
    return None if isinstance(blocks, Refused) else at.moved(trial, task.cost(blocks, trial), blocks)


def tried(state: State, step: Vector) -> Attempt:
    """Evaluate the cost at the end of the step, and move there, or further, if it is lower.

    If the state is eager, derivatives are computed in the first evaluation: most steps are accepted, and then
    one call does the work of two.
    """
    at, task = state.at, state.at.task
    trial, expected = at.ahead(step), at.expected(step)
    # first the cost at the end of the step
    blocks = task.blocks(trial, derivatives=state.eager)
    cost = math.inf if isinstance(blocks, Refused) else task.cost(blocks, trial)
    gain = (at.cost - cost) / expected if expected > 0.0 else -1.0
    reason = blocks.reason if isinstance(blocks, Refused) else ""
    largest, accepted, complete = at.largest(step), gain > _LEAST_GAIN, state.eager
    # then further ahead, if it fell more than a linear model can explain
    if gain > STRETCHED:
        further = _further(at, step, cost)
        if further is not None:
            trial, cost = further
            complete = False
    # then the derivatives, where the step ends
    if accepted and not complete:
        blocks = task.blocks(trial, derivatives=True)
    if accepted and not isinstance(blocks, Refused):
        trust = state.trust.after_success(gain, largest, task.options.largest_step)
        eager = 0.25 < gain <= STRETCHED
        moved = replace(state, at=at.moved(trial, cost, blocks), trust=trust, rejected=False, eager=eager)
        return Attempt(moved, True, largest, reason)
    return _rejected(state, largest, reason, expected)


def _rejected(state: State, largest: float, reason: str, expected: float) -> Attempt:
    """Stay, with a shorter next step; the end if the step was too small for the model's accuracy, or if none
    lowers the cost."""
    at = state.at
    trust = replace(state.trust, reach=at.task.options.largest_step)
    ended = None
    if 0.0 <= expected <= _EXACT * at.cost and trust.damping < 1.0:
        ended = Outcome.COST, "The cost falls no further than the model is exact"
    else:
        trust = trust.for_shorter(at, largest)
        if trust.damping > MOST_DAMPING:
            ended = Outcome.STALLED, "No step lowers the cost"
    return Attempt(replace(state, trust=trust, rejected=True, eager=False), False, largest, reason, ended)


def _further(at: Iterate, step: Vector, cost: float) -> tuple[Vector, float] | None:
    """(point, cost) as far in the same direction as the cost falls further; None if it does not.

    If the cost falls faster than predicted by the linear model, as when two steep edges approach each other
    in time, the Gauss-Newton step is far too short.
    """
    found = None
    for factor in (2.0, 4.0, 8.0):
        point = at.ahead(step, factor)
        blocks = at.task.blocks(point, derivatives=False)
        next_cost = math.inf if isinstance(blocks, Refused) else at.task.cost(blocks, point)
        if not next_cost < cost:
            break
        found, cost = (point, next_cost), next_cost
    return found
