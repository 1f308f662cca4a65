"""Whether designed rounds keep a bench within its limits: records that a search may propose, carried out.

No question is designed for: the records are random among all that the search would accept. The bench follows
one of the explanations, with parameters within their uncertainty and noisy sensors, and the runner's own
interlocks check every reading. They share no code with what keeps proposals clear of the limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.search.refit import plain
from rigctl.design.assurance import DRAWS, Draws, drawn
from rigctl.design.information_so_far import known_so_far
from rigctl.design.recipe import Recipe, Stage, lines_of
from rigctl.design.result import NONE
from rigctl.design.rivals import Rival, at_usual_size
from rigctl.design.scheme import Scheme, schemes_of, stage_of
from rigctl.design.search import Proposal, Workshop
from rigctl.design.virtual_records import Outlines, known_to, scatters
from rigctl.errors import RigctlError
from rigctl.model.measured.record import MeasuredRecord
from rigctl.rig import Rig
from rigctl.runner.interlocks import Alarm, Interlocks

Floats = NDArray[np.float64]

#: number of candidates evaluated together
_AT_ONCE = 64


@dataclass(frozen=True)
class Tripped:
    """A round in which an interlock tripped: the alarm, and the settings and steps of the record."""

    alarm: Alarm
    settings: str
    steps: tuple[str, ...]


@dataclass(frozen=True)
class Tally:
    """The results of many rounds.

    Attributes
    ----------
    carried_out: number of rounds.
    refused: number of candidates that were not accepted.
    held_back: rounds in which an interlock tripped and that a design would not have proposed, because it
        finally simulates each of its records with draws of every explanation. This is tested only for these,
        as it takes about a hundred times as long as the round.
    failed: rounds in which the bench's equations had no solution.
    tripped: rounds that a design would have proposed, and in which an interlock tripped.
    """

    carried_out: int
    refused: int
    held_back: int
    failed: int
    tripped: tuple[Tripped, ...]


@dataclass(frozen=True)
class Proposer:
    """All that may be proposed on a bench after some data."""

    rig: Rig
    stage: Stage
    schemes: tuple[Scheme, ...]
    workshop: Workshop

    @classmethod
    def after(cls, compared: ModelComparison, rig: Rig, effects: Sequence[str]) -> Proposer:
        """The proposer with the fitted model, and each of these effects at its usual size, as explanations.

        Effects that cannot be simulated here are left out.
        """
        fitted = compared.fit
        candidates = [(NONE, plain(fitted)), *((name, at_usual_size(compared, name)) for name in effects)]
        trials = [(name, trial) for name, trial in candidates if trial is not None]
        noise = max(1.0, fitted.chi2_reduced)
        rivals = tuple(Rival(name, trial, 0.0, 1.0 / len(trials), noise) for name, trial in trials)
        stage = stage_of(fitted, rig)
        schemes = schemes_of(stage, fitted.problem.records)
        return cls(rig, stage, schemes, Workshop(rivals, known_so_far(rivals), stage))

    def carry_out(self, rounds: int, seed: int) -> Tally:
        """Carry out this many records, once each, at random points of all schemes."""
        rng = np.random.default_rng(seed)
        carried_out, refused, held_back, failed, tripped = 0, 0, 0, 0, list[Tripped]()
        for proposal in self._proposals(rng):
            if carried_out == rounds:
                break
            if proposal is None:
                refused += 1
                continue
            carried_out += 1
            try:
                alarms = self._alarms(proposal.recipe, rng)
            except RigctlError:
                failed += 1
                continue
            if alarms and not self._draws(seed).keeps_clear(self.rig, proposal):
                carried_out, held_back = carried_out - 1, held_back + 1
                continue
            steps = lines_of(proposal.recipe, self.rig)
            tripped += [Tripped(one, str(proposal.recipe.settings(self.rig)), steps) for one in alarms]
        return Tally(carried_out, refused, held_back, failed, tuple(tripped))

    def _draws(self, seed: int) -> Draws:
        """The draws that a design uses for its chosen records."""
        return Draws(self.workshop.known, self.workshop, seed, DRAWS)

    def _proposals(self, rng: np.random.Generator) -> Iterator[Proposal | None]:
        while True:
            schemes = [self.schemes[int(k)] for k in rng.integers(len(self.schemes), size=_AT_ONCE)]
            points = [(one, rng.uniform(size=len(one.free)).tolist()) for one in schemes]
            yield from self.workshop.propose(points)
            self.workshop.forget()

    def _alarms(self, recipe: Recipe, rng: np.random.Generator) -> list[Alarm]:
        """The interlocks' alarms while the levels hold before the record, and in it."""
        index = int(rng.integers(len(self.workshop.rivals)))
        rival = self.workshop.rivals[index]
        values = drawn(rival, self.workshop.known.covariances[index], int(rng.integers(2**31)), 1)[0]
        watches, clock, alarms = Interlocks(self.rig), 0.0, list[Alarm]()
        for times, readings in self._courses(rival, values, recipe, rng):
            for time, row in zip(times, self._rows(times + clock, readings), strict=True):
                alarms += [one for one in watches.check((time + clock, -1.0, *row)) if one.active]
            clock += float(times[-1]) + 1.0 / recipe.rate
        return [one for one in alarms if not one.name.endswith(" noise")]

    def _courses(
        self, rival: Rival, values: Floats, recipe: Recipe, rng: np.random.Generator
    ) -> Iterator[tuple[Floats, Floats]]:
        """(times, readings) of the period before the record, if there is one, and of the record."""
        measurements = rival.fit.problem.measurements
        course = self.stage.course(recipe)
        if recipe.rest > 0.0:
            before = self.stage.standing_course(recipe).record(measurements)
            outputs = self._answered(rival, values, before, rng)
            yield before.times, outputs
            course = replace(
                course, readings=dict(zip(measurements.outputs, outputs[-1].tolist(), strict=True))
            )
        record = course.record(measurements)
        yield record.times, self._answered(rival, values, record, rng)

    def _answered(
        self, rival: Rival, values: Floats, record: MeasuredRecord, rng: np.random.Generator
    ) -> Floats:
        """(n, outputs) readings with their noise; record-level settings and zeros are drawn from their
        priors, and the record starts in the state to which the bench was brought."""
        outlines = Outlines(rival, [record])
        problem = outlines.problem
        unknowns = np.array(
            [
                one.unknown.start + (known_to(one) * rng.standard_normal() if scatters(one) else 0.0)
                for one in problem.local[0]
            ]
        )
        courses = problem.simulate(values, [unknowns])
        if not courses.ok:
            raise RigctlError(f"the bench cannot be simulated: {courses.summary()}")
        outputs = outlines.measured(courses.outputs[0])
        sigma = problem.noise.sigma_at(outputs, record.times)
        return np.asarray(outputs + sigma * rng.standard_normal(outputs.shape))

    def _rows(self, times: Floats, readings: Floats) -> Floats:
        """(n, columns) as recorded; channels that the model does not predict have their readings from the
        data so far, or the middle of their range."""
        outputs = self.workshop.rivals[0].fit.problem.measurements.outputs
        layout = self.rig.layout
        rows = np.zeros((times.size, len(layout.columns) - 2))
        for k, name in enumerate(layout.channels):
            if name in outputs:
                rows[:, k] = readings[:, outputs.index(name)]
            else:
                ends = self.rig.channels[name].range or (0.0, 0.0)
                rows[:, k] = 0.5 * (float(ends[0]) + float(ends[1]))
        return rows
