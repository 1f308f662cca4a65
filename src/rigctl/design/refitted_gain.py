"""The expected gain of records with the rival actually refitted, however far its parameters have to move.

A rival linearised at its fit is as stiff as it is there. A rival that becomes the other law at some value of
its parameters (a static friction that falls to the Coulomb one) may absorb everything by moving there, and
the gain predicted by the linear problem is then not real. So the rival is fitted to the data so far and to
the new records as the right one predicts them, without noise: the increase of its χ² is D.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.search.refit import plain
from rigctl.design.rivals import Rival
from rigctl.design.virtual_records import Outlines, Scene
from rigctl.engine.least_squares import started
from rigctl.engine.one_thread import one_thread
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import fit, without_derived
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord
from rigctl.tasks import Workers, map_tasks

Floats = NDArray[np.float64]

#: if a smaller share of a linear distance remains after the refit, a search for it was in vain
TAKEN_UP = 0.5
#: the fit ends when the next step would lower its cost by less than this share
_COST = 1e-4
#: a parameter may double in one step
_STEP = 1.0


def refitted_gain(rival: Rival, truth: int, scenes: Sequence[Scene]) -> float:
    """D in the rival's own noise: the increase of its χ²; infinite if the model cannot be simulated on the
    way.

    Parameters
    ----------
    truth: the index of the right one among the scenes' predictions.
    """
    # "Measured" without noise: the expected increase of the rival's χ² is then the increase itself.
    new = [replace(scene.record, values=scene.predicted[truth].outputs) for scene in scenes]
    problem, local = _with_records(rival, new, scenes)
    try:
        refit = fit(problem, local=local, cost=_COST, largest_step=_STEP)
    except RigctlError:
        return float("inf")
    return max(plain(refit).chi2 - rival.trial.chi2, 0.0)


def refitted_gains(
    rivals: Sequence[Rival],
    pairs: Sequence[tuple[int, int]],
    scenes: Sequence[Scene],
    workers: Workers | None = None,
) -> list[float]:
    """D of each pair of indices (right one, rival), see `refitted_gain`; in this process if `workers` is
    None."""
    work = partial(_gain_of, tuple(map(sent, rivals)), tuple(scenes))
    gains = dict(map_tasks(work, list(pairs), workers or Workers(1)))
    return [gains[k] for k in range(len(pairs))]


def sent(rival: Rival) -> Rival:
    """A rival in the form in which it is sent to other processes: without results derived from its fit."""
    return replace(rival, trial=replace(rival.trial, fit=without_derived(rival.trial.fit)))


@one_thread()
def _gain_of(rivals: Sequence[Rival], scenes: Sequence[Scene], pair: tuple[int, int]) -> float:
    truth, rival = pair
    return refitted_gain(rivals[rival], truth, scenes)


def _with_records(
    rival: Rival, new: Sequence[MeasuredRecord], scenes: Sequence[Scene]
) -> tuple[Problem, list[Floats]]:
    """The data so far and new records as one problem starting at the rival's fit; and the local unknowns'
    starts."""
    # Every array of a problem that has an entry for each record is extended by those of the new ones, whose
    # noise is as predicted.
    fitted = rival.fit
    so_far, added = fitted.problem.only(fitted.fitted), Outlines(rival, new).problem
    count, outputs = len(new), len(so_far.measurements.outputs)
    sigma = [scene.sigma for scene in scenes]
    problem = replace(
        so_far,
        measurements=replace(so_far.measurements, records=(*so_far.records, *new)),
        ok=(*so_far.ok, *added.ok),
        local=(*so_far.local, *added.local),
        starts=(*so_far.starts, *added.starts),
        whiteners=(*so_far.whiteners, *(scene.whitener for scene in scenes)),
        signal=None if so_far.signal is None else (*so_far.signal, *(one.values for one in new)),
        scatter=None
        if so_far.scatter is None
        else (*so_far.scatter, *(np.empty((*one.values.shape, 0)) for one in new)),
        extra=None if so_far.extra is None else (*so_far.extra, *[np.zeros(outputs)] * count),
        grown=None if so_far.grown is None else (*so_far.grown, *sigma),
    )
    problem = problem.with_shared(started(problem.shared, fitted.values))
    starts = [np.array([one.unknown.start for one in unknowns]) for unknowns in added.local]
    return problem, [*(fitted.local[k] for k in fitted.fitted), *starts]
