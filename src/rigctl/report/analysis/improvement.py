"""The page's part on a model that was improved: before and after, the fall of the error, what was found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rigctl.compare.result import Comparison
from rigctl.diagnose.loop import Improvement
from rigctl.report.analysis.comparison import comparison_sections
from rigctl.report.analysis.diagnosis import diagnosis_sections
from rigctl.report.analysis.history import history_sections
from rigctl.report.section import Section


def improvement_sections(compared: Comparison, improved: Improvement, path: Path) -> list[Section]:
    """The comparison of the first and the last model, the versions in `path`, and the first diagnosis."""
    last = improved.steps[-1].comparison if improved.steps else None
    named = [] if last is None else [replace(last, name=f"{last.name}, improved")]
    shown = replace(compared, models=(*compared.models, *named))
    return [
        *comparison_sections(shown),
        *history_sections(path),
        *diagnosis_sections(improved.first, last),
    ]
