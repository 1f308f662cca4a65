"""Diagnoses that several modules judge."""

from __future__ import annotations

import pytest

from rigctl.analysis.diagnosis_result import Diagnosis
from swing import diagnosed, project, white


@pytest.fixture(scope="session")
def cubic_swing(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """The diagnosis of one record, with white noise, of a swing with a cubic spring that its model lacks."""
    folder = tmp_path_factory.mktemp("cubic-swing")
    project(folder, white, cubic=0.6)
    return diagnosed(folder)
