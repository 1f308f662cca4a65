"""When a fit ends: before a step that would be an evaluation wasted, or after several of little use."""

from __future__ import annotations

import numpy as np

from rigctl.engine.least_squares.arrow import Vector
from rigctl.engine.least_squares.result import Outcome
from rigctl.engine.least_squares.state import Iterate, State

_NEARER = 0.01  # share of the difference to the rival's cost that a step must be expected to gain
_PATIENCE = 4  # number of steps that together must lower the cost by the tolerance


def at_end(state: State, step: Vector) -> tuple[Outcome, str] | None:
    """The end if the next step would be `step`, and is not worth an evaluation."""
    at, options, damping = state.at, state.at.task.options, state.trust.damping
    # an unknown at a bound may have a gradient that points outwards: it is no reason to go on
    flat, gradient = at.flat, at.gradient
    blocked = ((flat <= at.task.lower) & (gradient > 0.0)) | ((flat >= at.task.upper) & (gradient < 0.0))
    length = np.sqrt(2.0 * at.cost) or 1.0
    cosine = np.abs(gradient[~blocked] / (at.scale[~blocked] * length)).max(initial=0.0)
    if cosine <= options.gradient:
        return Outcome.GRADIENT, "The residuals cannot be made smaller"
    if at.change(step).max(initial=0.0) <= options.step:
        if damping > 1.0:
            return Outcome.STALLED, "No step lowers the cost"
        return Outcome.STEP, "No parameter moves any more"
    # with strong damping a small decrease says something of the damping, and nothing of the minimum
    if damping < 1.0 and 0.0 <= at.expected(step) <= _enough(at):
        return Outcome.COST, "The cost does not fall any more"
    return None


def out_of_patience(state: State) -> tuple[Outcome, str] | None:
    """The end if the last steps lowered the cost by less than expected: the model's values are not accurate
    enough for more.

    This does not apply if all of them were rejected: then the damping is still too small.
    """
    last = sum(state.falls[-_PATIENCE:])
    if len(state.falls) >= _PATIENCE and 0.0 < last <= _enough(state.at):
        return Outcome.COST, "The cost does not fall any more"
    return None


def _enough(at: Iterate) -> float:
    """The decrease of the cost below which the fit ends."""
    options = at.task.options
    return max(options.cost * at.cost, _NEARER * (at.cost - options.rival))
