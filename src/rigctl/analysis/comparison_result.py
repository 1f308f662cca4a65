"""What a comparison returns, for people and for programs.

`ModelComparison` holds the fit of one model, its linearisation and its tests, and computes on request where
the error lies; a diagnosis takes it as its input. `Comparison` holds those of all models with the records
that were held out. The words are made in `rigctl.answers`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rigctl.analysis.agreement.achievable_error import AchievableError, achievable_errors
from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.agreement.localisation import CellMap, Place
from rigctl.analysis.agreement.located_error import LocatedError
from rigctl.analysis.agreement.record_level import RecordQuantity
from rigctl.analysis.agreement.sensors import SensorBudget
from rigctl.analysis.agreement.slot_evidence import SlotEvidence
from rigctl.analysis.agreement.trends import Trend
from rigctl.analysis.agreement.undecided import Decision, what_decides
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.score_test import Screening
from rigctl.analysis.linear.slopes import KnownSlopes
from rigctl.analysis.single_values.findings import Finding
from rigctl.analysis.single_values.rows import TableRow
from rigctl.json_values import finite_or_none
from rigctl.model.curve_bands import CurveBand
from rigctl.model.fit.errors import ChannelError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.reached_bounds import ReachedBound, reached_bounds
from rigctl.model.fit.undetermined import Undetermined, first_statements, undetermined
from rigctl.model.measured.noise import DataNoise
from rigctl.model.measured.note import Note
from rigctl.model.measured.record import Measurements
from rigctl.model.reading_errors import CLOCK
from rigctl.model.validity import Departure, departures
from rigctl.noise import ChannelNoise
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.units import parse_unit
from rigctl.wording import chance_text

if TYPE_CHECKING:
    import pandas as pd


def in_unit(error: ChannelError, unit_name: str) -> dict[str, Any]:
    """`rmse`, `bias`, `max` and `noise` of model less measurement in `unit_name`, in K for a temperature."""
    unit = parse_unit(unit_name)
    return {
        "rmse": error.rmse / unit.factor,
        "unit": "K" if unit.offset else unit_name,
        "bias": error.bias / unit.factor,
        "max": error.maximum / unit.factor,
        "noise": error.noise / unit.factor,
    }


def offset_of_clock(explained_by: str) -> str:
    """What is stated, in words: that of a clock is its offset."""
    return explained_by.replace(CLOCK, "clock offset")


@dataclass(frozen=True)
class ModelComparison:
    """One model on the data.

    Attributes
    ----------
    name: of the model, with its version if it has one.
    fit: its free parameters fitted, or unchanged.
    adequacy: the tests.
    whole: the same data with the equations of the whole library, every effect at its null.
    located: where its error lies; each part is computed when it is first used.
    excluded: effects that were not considered.
    exact: if the model agrees only because sensors may be wrong as stated, the comparison with exact ones.
    with_sensor_errors: where only an uncertainty of sensors is stated, and the model with exact ones does not
        agree, the comparison with their errors; it is answered only where with exact ones no effect explains
        what is left.
    rejected_if_exact: of a comparison that is open with errors of sensors, the p-value with which a test
        rejects the model with exact ones.
    slopes: for a model with effects, the derivatives at its fit, until a diagnosis linearises it with the
        discrepancies of their laws.
    """

    name: str
    fit: FitResult
    adequacy: Adequacy
    linearisation: Linearisation = field(repr=False)
    projected: Projected = field(repr=False)
    screening: Screening = field(repr=False)
    whole: Problem = field(repr=False)
    located: LocatedError = field(repr=False)
    excluded: frozenset[str] = frozenset()
    exact: ModelComparison | None = field(default=None, repr=False)
    with_sensor_errors: ModelComparison | None = field(default=None, repr=False)
    slopes: KnownSlopes | None = field(default=None, repr=False)
    rejected_if_exact: float | None = None

    @property
    def cells(self) -> CellMap:
        """The systematic error by condition, phase and channel."""
        return self.located.cells

    @property
    def where(self) -> tuple[Place, ...]:
        """Locations of the error, the worst of each kind first."""
        return self.located.places

    @property
    def trends(self) -> tuple[Trend, ...]:
        """Trends of the error over the operating variables, the strongest first."""
        return self.located.trends

    @property
    def slots(self) -> tuple[SlotEvidence, ...]:
        """The equations that may lack a term, by decreasing evidence."""
        return self.located.slots

    @property
    def rows(self) -> tuple[TableRow, ...]:
        """For a table, every value beside the model's."""
        return self.located.rows

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the rows of a table show."""
        return self.located.findings

    @property
    def record_level(self) -> tuple[RecordQuantity, ...]:
        """The record-level quantities; those that are evidence of something first. None for a table."""
        return self.located.record_level

    @property
    def suspicious(self) -> RecordQuantity | None:
        """The record-level quantity that the statement names, if the model agrees but for it."""
        if self.rows or self.explained_by or self.adequacy.verdict is not True:
            return None
        return self.located.suspicious

    @cached_property
    def outside(self) -> tuple[Departure, ...]:
        """Where the model leaves the ranges over which laws of its effects were learned."""
        return departures(self.fit)

    @cached_property
    def bounds(self) -> tuple[ReachedBound, ...]:
        """Its parameters that the fit drove to a bound, or beyond one that was widened."""
        return reached_bounds(self.fit)

    @property
    def bounded(self) -> bool:
        """Whether a bound that a user wrote holds the fit."""
        return any(one.decisive for one in self.bounds)

    @property
    def first(self) -> tuple[str, ...]:
        """What has to be known before anything else about it: parameters that ended at a bound, and those
        that these data do not determine."""
        return first_statements(self.bounds, self.undetermined)

    @cached_property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """Its parameters of which the data determine only combinations."""
        return undetermined(self.fit)

    @cached_property
    def achievable(self) -> tuple[AchievableError, ...]:
        """The error of each channel beside that which a free correction reaches; none for a table."""
        return achievable_errors(self.fit)

    @property
    def beaten(self) -> tuple[AchievableError, ...]:
        """The channels in which a free correction predicts more than chance does."""
        return tuple(one for one in self.achievable if one.beats)

    @property
    def contradicted(self) -> bool:
        """Whether a free correction beats a model that passes every test."""
        return self.adequacy.verdict is True and bool(self.beaten)

    @property
    def curve_bands(self) -> tuple[CurveBand, ...]:
        """Changes of its readings within the uncertainty bands of its measured curves."""
        return self.located.curve_bands

    @property
    def statement(self) -> str:
        """The result in one plain sentence."""
        return worded(self, "findings.agreement.statement")

    @property
    def sensors(self) -> SensorBudget | None:
        """The errors of calibrations and clocks; None if no uncertainty is stated."""
        return self.adequacy.sensors

    @property
    def explained_by(self) -> str | None:
        """ "calibration", "clock" or both, if their errors explain what the model leaves; else None."""
        if self.sensors is None or not (self.exact is not None or self.adequacy.only_misread):
            return None
        beyond = self.adequacy.only_misread
        return self.sensors.kinds(self.sensors.beyond if beyond else self.sensors.explaining)

    def __repr__(self) -> str:
        """The verdict on one line."""
        return one_line(self, f"{self.name}: {self.statement}")

    @property
    def adequate(self) -> bool:
        """True if the data show nothing that the model lacks."""
        return self.adequacy.adequate

    @cached_property
    def decided_by(self) -> tuple[Decision, ...]:
        """What would tell slow noise from a missing effect; empty if that is decided."""
        if self.exact is not None and self.sensors is not None:
            return self.sensors.recalibration
        if not self.adequacy.undecided or self.adequacy.unusable:
            return ()
        of_sensors = (
            () if self.rejected_if_exact is None or self.sensors is None else self.sensors.recalibration
        )
        return (*what_decides(self.fit, self.adequacy.unproven), *of_sensors)

    def channels(self) -> dict[str, dict[str, Any]]:
        """The errors by channel, in the channels' units."""
        measurements = self.fit.problem.measurements
        shown = dict(zip(measurements.outputs, measurements.units, strict=True))
        noise = {channel.name: channel for channel in self.fit.problem.noise.channels}
        return {
            name: _channel(error, shown[name], noise[name], self.fit.heldout_errors.get(name))
            for name, error in self.fit.errors.items()
        }

    def document(self) -> dict[str, Any]:
        """Its part of the machine-readable answer."""
        return documented(self, "comparison_document")


@dataclass(frozen=True)
class Choice:
    """Which records were used, and which were left out.

    Attributes
    ----------
    hold_out, only: the conditions by which records were held out, and selected; "" for none.
    assume: ``name=value`` of inputs that the runs themselves do not contain.
    rest: the records that were not selected, with the noise of all; None if all were.
    """

    hold_out: str = ""
    only: str = ""
    assume: tuple[str, ...] = ()
    rest: tuple[Measurements, DataNoise] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Comparison:
    """Models on the same data.

    Attributes
    ----------
    runs: their ids.
    held_out: labels of the records that no fit saw.
    models: in the order in which they were given.
    notes: on the data and their noise.
    choice: of the records.
    """

    runs: tuple[str, ...]
    held_out: tuple[str, ...]
    models: tuple[ModelComparison, ...]
    notes: tuple[Note, ...]
    choice: Choice = Choice()

    def document(self) -> dict[str, Any]:
        """The machine-readable answer; for a single model its fields are also at the top level."""
        models = [model.document() for model in self.models]
        top: Mapping[str, Any] = models[0] if len(models) == 1 else {}
        return {
            "runs": list(self.runs),
            "held_out": list(self.held_out),
            "notes": list(map(str, self.notes)),
            "models": models,
            **top,
        }

    def summary(self) -> str:
        """A line for each model."""
        lines = []
        for model in self.models:
            errors = ", ".join(
                f"{name} {one['rmse']:.3g} {one['unit']}" for name, one in model.channels().items()
            )
            verdict = {True: "adequate", False: "not adequate", None: "not decided"}[model.adequacy.verdict]
            lines.append(f"{model.name}: {verdict} ({chance_text(model.adequacy.p_value)}); error {errors}")
            lines += [f"  {text}" for text in (*model.first, model.statement)]
        return "\n".join(lines)

    def frame(self) -> pd.DataFrame:
        """One row for each model and channel; units in their own column."""
        import pandas as pd

        rows = [
            {"model": model.name, "adequate": model.adequacy.verdict, "channel": name, **values}
            for model in self.models
            for name, values in model.channels().items()
        ]
        return pd.DataFrame(rows)

    def __repr__(self) -> str:
        """The verdicts on one line."""
        words = {True: "adequate", False: "not adequate", None: "not decided"}
        verdicts = ", ".join(f"{m.name} {words[m.adequacy.verdict]}" for m in self.models)
        return one_line(self, f"of {len(self.runs)} run{'' if len(self.runs) == 1 else 's'}: {verdicts}")

    def _repr_html_(self) -> str:
        """The summary and the table, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def _channel(
    error: ChannelError, unit: str, noise: ChannelNoise, held_out: ChannelError | None
) -> dict[str, Any]:
    return {
        **in_unit(error, unit),
        "noise_share": noise.share or None,
        "noise_source": noise.source,
        "noise_standing": noise.standing,
        "noise_stated": noise.allowed / parse_unit(unit).factor or None,
        "noise_over": noise.over or None,
        "noise_floor": noise.floor / parse_unit(unit).factor or None,
        "noise_plateau": noise.plateau,
        "step": noise.step / parse_unit(unit).factor or None,
        "noise_guessed": noise.guessed,
        "noise_growth": _growth(noise, unit),
        "masked": noise.masked,
        "masked_share": noise.masked / max(1, noise.masked + noise.edges + error.count),
        "on_edges": noise.edges,
        "nrmse": error.nrmse,
        "chi2_reduced": error.chi2_reduced,
        "r2": finite_or_none(error.r2),
        "heldout_rmse": None if held_out is None else in_unit(held_out, unit)["rmse"],
    }


def _growth(noise: ChannelNoise, unit: str) -> dict[str, Any] | None:
    """How the noise increases with level and rate, in the channel's unit; None if it does not."""
    law = noise.law
    if law is None:
        return None
    shown = parse_unit(unit)
    return {
        "at_rest": law.floor / shown.factor,
        "per_level": law.level,
        "variance_per_level": law.shot / shown.factor,
        "per_rate_s": law.rate,
        "from_level": (law.origin - shown.offset) / shown.factor,
    }
