"""A user's folder, from its log to a diagnosis, by the steps that the how-to pages describe."""

from __future__ import annotations

from pathlib import Path

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig


def diagnose_log(log: Path) -> Diagnosis:
    """Import a log, and diagnose the model beside it: ``rig.yaml`` and ``model.yaml`` in the same folder.

    Raises
    ------
    RigctlError
        the tool cannot import or diagnose it.
    """
    folder = log.parent
    imported = import_file(log, load_rig(folder / "rig.yaml"), folder / "runs")
    return diagnose([open_run(imported.path)], load_model(folder / "model.yaml"))
