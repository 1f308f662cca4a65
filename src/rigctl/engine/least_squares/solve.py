"""Levenberg-Marquardt for many records, with bounds and priors.

In: `Evaluate`, which gives whitened residuals and their derivatives of every record, and the unknowns, some
of all records and some of one. Out: a `LeastSquaresResult` with the values, their covariance and why it
ended.

One iteration goes from one immutable `State` (`state`) to the next: a damped step within bounds and box; late
in a fit, one with less damping if damping alone keeps it short (`acceptance.bolder`, `dared`); the tests of
the end (`stopping`), before an evaluation that would be wasted; then the evaluation, after which the step is
taken, lengthened or shortened (`acceptance.tried`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import count, islice

from rigctl.engine.least_squares.acceptance import Attempt, bolder, dared, tried
from rigctl.engine.least_squares.block import Block, Evaluate, Floats, Refused
from rigctl.engine.least_squares.identifiability import null_columns
from rigctl.engine.least_squares.result import Iteration, LeastSquaresResult, Outcome
from rigctl.engine.least_squares.state import Iterate, Options, State, Task, Trust
from rigctl.engine.least_squares.stopping import at_end, out_of_patience
from rigctl.engine.least_squares.uncertainty import conclude
from rigctl.engine.least_squares.unknown import Unknown
from rigctl.errors import ExitCode, RigctlError


class NoValueAtStart(RigctlError):
    """A model that cannot be evaluated with the starting values of a fit."""


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
    options, evaluations = options or Options(), count()

    def counted(shared: Floats, own: Sequence[Floats], derivatives: bool) -> Sequence[Block] | Refused:
        next(evaluations)
        return evaluate(shared, own, derivatives)

    start, number = _at_start(Task.of(counted, unknowns, local, options)), 0
    attempt = Attempt(start, accepted=False)
    for number, attempt in enumerate(islice(attempts(start), options.iterations), start=1):
        if progress is not None and attempt.largest is not None:
            cost = attempt.state.at.cost
            progress(Iteration(number, cost, attempt.largest, attempt.accepted, attempt.reason))
    outcome, message = attempt.ended or (Outcome.ITERATIONS, "The allowed iterations were used up")
    return conclude(attempt.state.at, outcome, message, iterations=number, evaluations=next(evaluations))


def attempts(state: State) -> Iterator[Attempt]:
    """The iterations of a search from a state on; the last one has `ended`.

    They depend on nothing but that state: a search continued from any of its states goes the same way.
    """
    ended = None
    while ended is None:
        attempt = _attempt(state)
        state, ended = attempt.state, attempt.ended
        yield attempt


def _attempt(state: State) -> Attempt:
    """One iteration: the step, what came of it, and whether the fit ends."""
    before, step = state.at.cost, state.step()
    # first a step with less damping, where damping alone keeps the step short
    bold = bolder(state, step)
    attempt = Attempt(state, accepted=False) if bold is None else dared(state, *bold)
    if not attempt.accepted:
        # the tests of the end, before an evaluation that would be wasted
        ended = at_end(attempt.state, step)
        if ended is not None:
            return replace(attempt, ended=ended)
        attempt = tried(attempt.state, step)
    state = replace(attempt.state, falls=(*attempt.state.falls, before - attempt.state.at.cost))
    return replace(attempt, state=state, ended=attempt.ended or out_of_patience(state))


def _at_start(task: Task) -> State:
    blocks = task.blocks(task.start, derivatives=True)
    if isinstance(blocks, Refused):
        raise NoValueAtStart(
            f"the model has no value at the start of the fit: {blocks.reason}", exit_code=ExitCode.FAILED
        )
    start = task.linearised(task.start, task.cost(blocks, task.start), blocks)
    _refuse_null_columns(start, blocks)
    return State(start, Trust(task.options.largest_step))


def _refuse_null_columns(start: Iterate, blocks: Sequence[Block]) -> None:
    task = start.task
    without_prior = {unknown.name for unknown in task.unknowns if unknown.prior is None}
    null = [
        name
        for name in null_columns(blocks, [unknown.name for unknown in task.unknowns])
        if name in without_prior
    ]
    for record_local, lengths in zip(task.local, start.arrow.norms().local, strict=True):
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
