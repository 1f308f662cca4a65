"""The information in the data so far: the distances of the rivals in them, and how well each is
determined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.design.information import Evidence, Response
from rigctl.design.rivals import Rival
from rigctl.design.virtual_records import predict, predicted_of
from rigctl.errors import RigctlError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Known:
    """What is known before any new record.

    Attributes
    ----------
    information: for each rival, (p, p), with priors, about its common unknowns scaled by their typical sizes.
    prior: this information without any data.
    repeats: for each fitted record, the evidence of a repeat of it; None if a rival cannot be simulated.
    """

    information: tuple[Floats, ...]
    prior: tuple[Floats, ...]
    repeats: tuple[Evidence | None, ...]

    @cached_property
    def covariances(self) -> tuple[Floats, ...]:
        """Covariance of each rival's common unknowns, scaled."""
        return tuple(np.asarray(np.linalg.inv(one), dtype=float) for one in self.information)

    @cached_property
    def evidence(self) -> Evidence:
        """Expected evidence of the data so far, over all repeats."""
        return Evidence.total(one for one in self.repeats if one is not None)

    @cached_property
    def distances(self) -> Floats:
        """(k, k) D₀ of the first rival from the second, in the data so far."""
        return self.evidence.distances(self.prior)


def known_so_far(rivals: Sequence[Rival]) -> Known:
    """Linearise every rival at its fit to the data so far, with its record-level unknowns free."""
    information = []
    for rival in rivals:
        # Information of the real records, at each rival's own fit and in the noise of the most probable one:
        # JᵀPJ.
        data = [one.shared.T @ one.left(one.shared) for one in _responses(rival, rivals[0])]
        information.append(rival.prior_information() + np.asarray(np.sum(data, axis=0), dtype=float))
    # Beside it, what a repeat of each record would be expected to show: the same quantities as for a new
    # record, with which a proposed one is compared.
    fit = rivals[0].fit
    scenes = predict(rivals, [fit.problem.records[k] for k in fit.fitted])
    return Known(
        tuple(information),
        tuple(rival.prior_information() for rival in rivals),
        tuple(None if scene is None else Evidence.of(scene.responses) for scene in scenes),
    )


def _responses(rival: Rival, first: Rival) -> list[Response]:
    """The response to every fitted record, in the noise of `first`."""
    fit = rival.fit
    problem = fit.problem.only(fit.fitted)
    columns = tuple(dict.fromkeys([*(u.name for u in problem.shared), *problem.local_names]))
    responses = []
    for part in problem.parts(len(columns) + len(problem.initial_names)):
        local = [fit.local[fit.fitted[k]] for k in part]
        courses = problem.only(part).simulate(fit.values, local, columns, initial=True)
        if not courses.ok:
            raise RigctlError(f"{rival.name} cannot be linearised: {courses.summary()}")
        for index, k in enumerate(part):
            whitener = first.fit.problem.whiteners[fit.fitted[k]]
            responses.append(predicted_of(rival, courses, index, problem.local[k]).response(whitener))
    return responses
