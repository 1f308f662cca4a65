"""Where a fitted model's error lies, with which variables it grows, which equation may lack a term, and
the sentence that says so.

These are only displayed, and take as long as the tests: each is computed when it is first used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from rigctl.analysis.agreement.adequacy import Adequacy, chance_text
from rigctl.analysis.agreement.localisation import CellMap, Place, cell_map, localise, worst_stretches
from rigctl.analysis.agreement.record_level import RecordQuantity, record_level
from rigctl.analysis.agreement.slot_evidence import SlotEvidence, slot_evidence
from rigctl.analysis.agreement.trends import Trend, sentence, trends
from rigctl.analysis.agreement.undecided import undecided_text, unusable_text
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.score_test import Screening
from rigctl.analysis.single_values.rows import TableRow, table_rows
from rigctl.analysis.single_values.statements import table_findings, table_statement
from rigctl.engine.one_thread import one_thread
from rigctl.model.curve_bands import CurveBand, curve_bands
from rigctl.model.fit.fit import FitResult

#: least share of an error that is stated: one per cent, rounded
_SAID = 0.005


@dataclass(frozen=True)
class LocatedError:
    """The error of a fitted model, located.

    Attributes
    ----------
    name: of the model, as its statement gives it.
    fit, projected, screening, adequacy: the fit, its linearisation and its tests.
    """

    name: str
    fit: FitResult = field(repr=False)
    projected: Projected = field(repr=False)
    screening: Screening = field(repr=False)
    adequacy: Adequacy

    @cached_property
    @one_thread()
    def cells(self) -> CellMap:
        """The systematic error by condition, phase and channel."""
        return cell_map(self.projected)

    @cached_property
    @one_thread()
    def places(self) -> tuple[Place, ...]:
        """Locations of the error, the worst of each kind first."""
        return (*localise(self.projected.linearisation, self.cells), *worst_stretches(self.fit))

    @cached_property
    @one_thread()
    def trends(self) -> tuple[Trend, ...]:
        """Trends of the error over the operating variables, the strongest first."""
        return trends(self.fit)

    @cached_property
    @one_thread()
    def slots(self) -> tuple[SlotEvidence, ...]:
        """The equations that may lack a term, by decreasing evidence."""
        return slot_evidence(self.fit)

    @cached_property
    def rows(self) -> tuple[TableRow, ...]:
        """For a table, every value beside the model's."""
        return table_rows(self.fit)

    @cached_property
    @one_thread()
    def findings(self) -> tuple[str, ...]:
        """What the rows of a table show, a sentence each."""
        if not self.rows:
            return ()
        return table_findings(self.projected.linearisation, self.adequacy, self.screening, self.rows)

    @cached_property
    @one_thread()
    def record_level(self) -> tuple[RecordQuantity, ...]:
        """The record-level quantities; those that are evidence of something first. None for a table."""
        return () if self.rows else record_level(self.fit)

    @cached_property
    @one_thread()
    def curve_bands(self) -> tuple[CurveBand, ...]:
        """Changes of the model's readings within the uncertainty bands of its measured curves."""
        return curve_bands(self.fit)

    @cached_property
    def statement(self) -> str:
        """The result in one plain sentence."""
        name, chance = self.name, chance_text(self.adequacy.p_value)
        if self.rows:
            return table_statement(name, self.adequacy, self.rows, sentence(self.trends))
        if self.adequacy.below_noise:
            return (
                f"{name} deviates from the measurements by less than their noise: a test detects a pattern "
                f"in the residuals ({chance}), but the noise of these readings differs from its estimate, so "
                "that they cannot decide"
            )
        if self.adequacy.unusable:
            return unusable_text(self.fit, name)
        if self.adequacy.undecided:
            return undecided_text(self.fit, name, self.adequacy.unproven)
        if self.adequacy.adequate:
            return self._agreement
        text = f"{name} does not agree with the measurements ({chance})"
        worst = next((place for place in self.places if place.by == "cell"), None)
        if worst is not None and worst.share_of_error >= _SAID:
            text += f": {100 * worst.share_of_error:.0f} % of the systematic error is in {worst.label}"
        direction = sentence(self.trends)
        return f"{text}. {direction}" if direction else text

    @property
    def _agreement(self) -> str:
        text = (
            f"{self.name} agrees with the measurements within their noise (p = {self.adequacy.p_value:.2g})"
        )
        if self.adequacy.stated:
            channels = ", ".join(self.adequacy.stated)
            text = (
                f"{self.name} agrees with the measurements within the noise of {channels} that the rig file "
                "states"
            )
        if self.suspicious is not None:
            return f"{text}, but {self.suspicious.statement}"
        return f"{text}: these data show nothing that it lacks"

    @property
    def suspicious(self) -> RecordQuantity | None:
        """The record-level quantity that most clearly may compensate for something that the model lacks."""
        return next((one for one in self.record_level if one.statement), None)
