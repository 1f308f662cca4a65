"""The kept quantity as predicted by a model at operating points that have not been measured.

In: a fit, the measure, and an operating point with a set-point. Out: the quantity with its two standard
deviations: that of the fitted parameters, which all records share and a schedule can do nothing about, and
that from record to record. A record of the runs is the template: commands and times stay as they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.search.refit import plain
from rigctl.compensation.levers import Lever
from rigctl.compensation.measured import TakenMeasure
from rigctl.design.recipe import Recipe, Stage
from rigctl.design.rivals import Rival
from rigctl.design.virtual_records import Outlines, Predicted
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord
from rigctl.units import show

Floats = NDArray[np.float64]

#: step of the unknowns for numerical derivatives, in standard deviations
_STEP = 0.1


@dataclass(frozen=True)
class Point:
    """The quantity at one operating point, SI.

    Attributes
    ----------
    common: its standard deviation due to the fitted parameters, shared by all records.
    scatter: that due to record-level variation of settings and zeros.
    """

    value: float
    common: float
    scatter: float


@dataclass(frozen=True)
class Predictor:
    """Predicts one measure of one kind of record.

    Attributes
    ----------
    template: the record whose commands and times are kept.
    vary, over: what is set.
    """

    fit: FitResult = field(repr=False)
    stage: Stage = field(repr=False)
    measure: TakenMeasure
    template: MeasuredRecord = field(repr=False)
    vary: Lever
    over: Lever

    def values(self, points: Sequence[tuple[float, float]]) -> Floats:
        """(points) the quantity at (over, vary), SI.

        Raises
        ------
        RigctlError
            the model cannot be simulated at one of them.
        """
        outlines = self._outlines(points)
        courses = outlines.simulate()
        self._require(courses.failures, points)
        return np.array(
            [
                self._of(record, outlines.measured(one))
                for record, one in zip(outlines.records, courses.outputs, strict=True)
            ]
        )

    def with_spread(self, points: Sequence[tuple[float, float]]) -> list[Point]:
        """Predict at each point, with the uncertainty of the prediction.

        Raises
        ------
        RigctlError
            the model cannot be simulated at one of them.
        """
        outlines = self._outlines(points)
        predicted = outlines.predicted()
        self._require([None if one is not None else "" for one in predicted], points)
        covariance = self._covariance(outlines.rival)
        return [
            self._point(record, one, covariance)
            for record, one in zip(outlines.records, predicted, strict=True)
            if one is not None
        ]

    def _point(self, record: MeasuredRecord, one: Predicted, covariance: Floats) -> Point:
        # σ² = gᵀΣg with g the derivatives of the measure, not of the outputs: a maximum or a time is no
        # linear function of the samples, so that these are moved and the measure is computed again.
        slopes = self._slopes(record, one.outputs, one.slopes, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
        scattering = self._slopes(
            record, one.outputs, one.own[:, :, : one.scattering], np.ones(one.scattering)
        )
        common = float(slopes @ covariance @ slopes)
        return Point(
            self._of(record, one.outputs), float(np.sqrt(max(common, 0.0))), float(np.linalg.norm(scattering))
        )

    def _slopes(self, record: MeasuredRecord, outputs: Floats, slopes: Floats, widths: Floats) -> Floats:
        """(columns) derivatives of the quantity; for statistics that select a sample, through the samples."""
        derivatives = np.zeros(slopes.shape[2])
        for k, width in enumerate(widths.tolist()):
            step = _STEP * width
            if step > 0.0:
                up, down = (self._of(record, outputs + side * step * slopes[:, :, k]) for side in (1.0, -1.0))
                derivatives[k] = (up - down) / (2.0 * step)
        return derivatives

    def _covariance(self, rival: Rival) -> Floats:
        """(p, p) of the common unknowns, each in its typical size; larger if the model leaves a misfit."""
        solution, sizes = self.fit.solution, rival.sizes
        if solution is None or not sizes.size:
            return np.zeros((sizes.size, sizes.size))
        scaled = solution.covariance * rival.overdispersion / np.outer(sizes, sizes)
        return np.where(np.isfinite(scaled), scaled, 0.0)

    def _outlines(self, points: Sequence[tuple[float, float]]) -> Outlines:
        trial = plain(self.fit)
        return Outlines(Rival("model", trial, 0.0, 1.0), [self.record(*point) for point in points])

    def record(self, over: float, vary: float) -> MeasuredRecord:
        """A record at an operating point, of whose readings only the first are known."""
        template, outputs = self.template, self.fit.problem.measurements.outputs
        inputs = template.inputs.copy()
        recipe = Recipe((), 1.0)
        for one, value in ((self.over, over), (self.vary, vary)):
            one.set(inputs, value)
            recipe = one.recipe(recipe, value)
        readings = self.stage.first(recipe)
        values = np.full_like(template.values, np.nan)
        for k, name in enumerate(outputs):
            values[0, k] = readings.get(name, np.nan)
        return replace(
            template,
            label=self._named(over, vary),
            inputs=inputs,
            values=values,
            condition={},
            switch_half=np.zeros(template.switch_times.size),
            phase=np.zeros(template.times.size, dtype=np.intp),
            phases=("all",),
        )

    def _named(self, over: float, vary: float) -> str:
        """``oil_temperature 40 degC, supply_pressure 30 bar``."""
        parts = ((self.over, over), (self.vary, vary))
        return ", ".join(f"{one.name} {show(value, one.unit)}" for one, value in parts)

    def _of(self, record: MeasuredRecord, outputs: Floats) -> float:
        names = self.fit.problem.measurements.outputs
        by_channel = {name: outputs[:, names.index(name)] for name in self.measure.channels}
        return self.measure.of(record.times, by_channel, record.switch_times)

    def _require(self, failures: Sequence[object], points: Sequence[tuple[float, float]]) -> None:
        for failure, (over, vary) in zip(failures, points, strict=True):
            if failure is not None:
                raise RigctlError(
                    f"the model has no value at {self._named(over, vary)}",
                    value=str(failure) or "none",
                )
