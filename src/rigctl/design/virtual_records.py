"""Records not yet taken, as every rival predicts them.

In: rivals and planned records. Out: a `Scene` for each record: every rival's outputs and derivatives, and
the noise that the readings would have. Everything that a design computes (distances, limits, draws) is
computed from these, so that a record is simulated once with each rival.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.design.information import Response
from rigctl.design.rivals import Rival
from rigctl.engine.trajectories import Trajectories
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.unknowns import LocalUnknown, local_unknowns, start_values
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.plant import initial_state
from rigctl.noise.whitening import Whitener, whiten

Floats = NDArray[np.float64]

#: standard deviation of a record-level unknown without a prior, as a multiple of its typical size
_VAGUE = 100.0


@dataclass(frozen=True)
class PlannedRecord:
    """The commands of a record, and the bench's state at its start; all SI.

    Attributes
    ----------
    switch_times: (k) s from its first sample; the first is not after it.
    inputs: (k, inputs) from each of these times on.
    length: s.
    rate: Hz.
    readings: first readings of those channels for which they are known.
    label: its name in messages.
    """

    switch_times: Floats
    inputs: Floats
    length: float
    rate: float
    readings: Mapping[str, float]
    label: str = "designed"

    @property
    def times(self) -> Floats:
        """(n) times of its samples, s."""
        return np.arange(round(self.length * self.rate) + 1) / self.rate

    def record(self, measurements: Measurements, group: int = 0) -> MeasuredRecord:
        """As a record for the analysis, of whose readings only the first are known."""
        times = self.times
        values = np.full((times.size, len(measurements.outputs)), np.nan)
        for k, name in enumerate(measurements.outputs):
            values[0, k] = self.readings.get(name, np.nan)
        jitter = measurements.jitter_of(self.inputs)
        return MeasuredRecord(
            run="",
            index=0,
            label=self.label,
            times=times,
            switch_times=self.switch_times,
            switch_half=np.zeros(self.switch_times.size),
            switch_jitter=jitter,
            separate_switches=bool(jitter.any()),  # without readings, there is no noise to hold their scatter
            inputs=self.inputs,
            values=values,
            condition={},
            group=group,
            phase=np.minimum(np.arange(times.size), 1),
            phases=("begin", "record"),
        )


@dataclass(frozen=True)
class Predicted:
    """One record, as one rival predicts it.

    Attributes
    ----------
    outputs: (n, outputs) SI.
    slopes: (n, outputs, p) by the common unknowns, each times its typical size.
    own: (n, outputs, l) by the record-level unknowns, each times the standard deviation of its prior.
    scattering: the first this many of these vary from record to record: settings and zeros. The others, its
        initial states, are set by the bench.
    """

    outputs: Floats
    slopes: Floats = field(repr=False)
    own: Floats = field(repr=False)
    scattering: int

    def response(self, whitener: Whitener) -> Response:
        """The whitened prediction."""
        return Response(whitener(self.outputs), whitener(self.slopes), whitener(self.own))

    def of_channels(self, indices: Sequence[int]) -> Predicted:
        """The prediction of some of its channels."""
        chosen = list(indices)
        return replace(
            self, outputs=self.outputs[:, chosen], slopes=self.slopes[:, chosen], own=self.own[:, chosen]
        )

    def spread(self, covariance: Floats) -> Floats:
        """(n, outputs) standard deviation of the prediction, SI; `covariance` (p, p) of the scaled common
        unknowns."""
        common = np.einsum("nop,pq,noq->no", self.slopes, covariance, self.slopes)
        scattered = self.own[:, :, : self.scattering]
        return np.asarray(np.sqrt(np.maximum(common, 0.0) + np.square(scattered).sum(axis=2)))


@dataclass(frozen=True)
class Scene:
    """One record with every rival's prediction, and the noise that its readings would have.

    Attributes
    ----------
    record: its values are the predictions of the most probable rival.
    sigma: (n, outputs) SI.
    """

    record: MeasuredRecord = field(repr=False)
    predicted: tuple[Predicted, ...]
    whitener: Whitener = field(repr=False)
    sigma: Floats = field(repr=False)

    @property
    def responses(self) -> list[Response]:
        """The responses of every rival, whitened."""
        return [one.response(self.whitener) for one in self.predicted]


def predict(rivals: Sequence[Rival], records: Sequence[MeasuredRecord]) -> list[Scene | None]:
    """Every record with every rival; None if it cannot be simulated with one of them."""
    first = Outlines(rivals[0], records)
    # 1. The most probable rival without derivatives: its prediction stands for the readings, on whose level
    #    the noise depends. Records that it cannot simulate are dropped here.
    courses = first.simulate()
    good = [k for k, failure in enumerate(courses.failures) if failure is None]
    expected = [replace(records[k], values=first.measured(courses.outputs[k])) for k in good]
    if not expected:
        return [None] * len(records)
    noise = rivals[0].fit.problem.noise
    masks = [np.ones(one.values.shape, dtype=bool) for one in expected]
    sigma = [noise.sigma_at(one.values, one.times) for one in expected]
    whiteners = [
        whiten(noise, one.times, ok, one.values, sigma=sigmas)
        for one, ok, sigmas in zip(expected, masks, sigma, strict=True)
    ]
    # 2. Every rival with derivatives, on the same records in the same noise, so that differences of
    #    predictions are comparable in whitened rows.
    by_rival = [Outlines(rival, expected).predicted() for rival in rivals]
    scenes: list[Scene | None] = [None] * len(records)
    for index, k in enumerate(good):
        every = [one[index] for one in by_rival]
        if all(one is not None for one in every):
            predicted = tuple(one for one in every if one is not None)
            scenes[k] = Scene(expected[index], predicted, whiteners[index], sigma[index])
    return scenes


@dataclass(frozen=True)
class Outlines:
    """One rival's equations on records not yet taken.

    Record-level unknowns have their expected values: zeros, settings and initial states.
    """

    rival: Rival
    records: Sequence[MeasuredRecord]

    @property
    def problem(self) -> Problem:
        """The rival's model on these records, with its common unknowns as determined by the data so far."""
        # The rival's equations and fitted parameters; record-level unknowns and initial states are those of
        # the new records, at their expected values.
        known = self.rival.fit.problem
        model = known.model
        measurements = replace(known.measurements, records=tuple(self.records))
        alone = [replace(measurements, records=(one,)) for one in self.records]
        used = [effect for effect in map(model.effect, model.effects) if effect.terms]
        usual = initial_state(model.family, used)
        starts = [
            start_values(known.level, one, single, usual, model.values)
            for one, single in zip(self.records, alone, strict=True)
        ]
        local = [
            local_unknowns(known.level, one, single, state)
            for one, single, state in zip(self.records, alone, starts, strict=True)
        ]
        names = known.compiled.system.state_names
        return replace(
            known,
            measurements=measurements,
            ok=tuple(np.ones(one.values.shape, dtype=bool) for one in self.records),
            local=tuple(local),
            starts=tuple(np.array([state[name] for name in names]) for state in starts),
            whiteners=(),
            signal=None,
            scatter=None,
            extra=None,
            grown=None,
        )

    def measured(self, outputs: Floats) -> Floats:
        """(n, channels) of (n, outputs): those that are measured."""
        return np.take(outputs, self.rival.fit.problem.channels, axis=1)

    def simulate(self) -> Trajectories:
        """Outputs of every record at the fit, without derivatives."""
        problem = self.problem
        return problem.simulate(self.rival.fit.values, [_expected(unknowns) for unknowns in problem.local])

    def at_draws(self, values: Floats) -> Trajectories:
        """Outputs of the first record at each draw of the common unknowns (draws, p), all at once."""
        problem = self.problem
        return problem.at_draws(0, values, _expected(problem.local[0]))

    def predicted(self) -> list[Predicted | None]:
        """The predictions with derivatives, in parts that fit into memory."""
        problem = self.problem
        columns = tuple(dict.fromkeys([*(u.name for u in problem.shared), *problem.local_names]))
        predictions: list[Predicted | None] = []
        for part in problem.parts(len(columns) + len(problem.initial_names)):
            predictions += Outlines(self.rival, [self.records[k] for k in part]).with_derivatives(columns)
        return predictions

    def with_derivatives(self, columns: tuple[str, ...]) -> list[Predicted | None]:
        """Outputs, and derivatives by the unknowns `columns` and the initial states, all at once."""
        problem = self.problem
        expected = [_expected(unknowns) for unknowns in problem.local]
        courses = problem.simulate(self.rival.fit.values, expected, columns, initial=True)
        return [
            None
            if courses.failures[index] is not None
            else predicted_of(self.rival, courses, index, unknowns)
            for index, unknowns in enumerate(problem.local)
        ]


def predicted_of(
    rival: Rival, courses: Trajectories, index: int, unknowns: Sequence[LocalUnknown]
) -> Predicted:
    """One of the records that were simulated with derivatives; `unknowns` are its record-level ones."""
    at = {name: k for k, name in enumerate(courses.columns)}
    problem = rival.fit.problem
    slopes = np.take(courses.sensitivities[index], problem.channels, axis=1)
    ordered = sorted(unknowns, key=lambda one: not scatters(one))
    return Predicted(
        np.take(courses.outputs[index], problem.channels, axis=1),
        slopes[:, :, [at[unknown.name] for unknown in problem.shared]] * rival.sizes,
        slopes[:, :, [at[one.name] for one in ordered]] * np.array([known_to(one) for one in ordered]),
        sum(map(scatters, unknowns)),
    )


def scatters(one: LocalUnknown) -> bool:
    """Whether an unknown differs from record to record by chance, as a setting or a switch time does."""
    return one.kind != "start" and one.unknown.prior is not None


def _expected(unknowns: Sequence[LocalUnknown]) -> Floats:
    return np.array([one.unknown.start for one in unknowns])


def known_to(one: LocalUnknown) -> float:
    """Its prior standard deviation, SI."""
    unknown = one.unknown
    return _VAGUE * unknown.size if unknown.prior is None else unknown.prior.std
