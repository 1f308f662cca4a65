"""What an analysis shows on the page: comparison, diagnosis, designed experiment, schedule, learning."""

from rigctl.report.analysis.comparison import comparison_sections
from rigctl.report.analysis.compensation import compensation_sections
from rigctl.report.analysis.design import design_sections
from rigctl.report.analysis.diagnosis import diagnosis_sections
from rigctl.report.analysis.discovery import discovery_sections
from rigctl.report.analysis.frequency_response import frequency_sections
from rigctl.report.analysis.history import history_sections
from rigctl.report.analysis.improvement import improvement_sections
from rigctl.report.analysis.learning import hidden_section, learning_sections
from rigctl.report.analysis.question import question_section

__all__ = [
    "comparison_sections",
    "compensation_sections",
    "design_sections",
    "diagnosis_sections",
    "discovery_sections",
    "frequency_sections",
    "hidden_section",
    "history_sections",
    "improvement_sections",
    "learning_sections",
    "question_section",
]
