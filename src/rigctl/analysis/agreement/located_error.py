"""Where a fitted model's error lies, with which variables it grows, and which equation may lack a term.

These are only displayed, and take as long as the tests: each is computed when it is first used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from rigctl.analysis.agreement.adequacy import Adequacy
from rigctl.analysis.agreement.localisation import CellMap, Place, cell_map, localise, worst_stretches
from rigctl.analysis.agreement.record_level import RecordQuantity, record_level
from rigctl.analysis.agreement.slot_evidence import SlotEvidence, slot_evidence
from rigctl.analysis.agreement.trends import Trend, trends
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.score_test import Screening
from rigctl.analysis.single_values.findings import Finding, table_findings
from rigctl.analysis.single_values.rows import TableRow, table_rows
from rigctl.engine.one_thread import one_thread
from rigctl.model.curve_bands import CurveBand, curve_bands
from rigctl.model.fit.fit import FitResult


@dataclass(frozen=True)
class LocatedError:
    """The error of a fitted model, located.

    Attributes
    ----------
    name: of the model as it was compared, where a page shows it by another.
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
    def findings(self) -> tuple[Finding, ...]:
        """What the rows of a table show."""
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

    @property
    def suspicious(self) -> RecordQuantity | None:
        """The record-level quantity that most clearly may compensate for something that the model lacks."""
        return next((one for one in self.record_level if one.evident), None)
