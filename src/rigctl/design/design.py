"""Design the next experiment for a model on its runs."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.analysis.search import OnProgress
from rigctl.dataset.run import Run
from rigctl.design.result import DesignResult
from rigctl.errors import RigctlError
from rigctl.model.model import Model

#: records in a set when nobody says how many
MOST_RECORDS = 4


def design_experiment(
    runs: Sequence[Run],
    model: Model,
    *,
    budget: float | None = None,
    records: int | None = None,
    separate: tuple[str, str] | None = None,
    sensors: bool = False,
    seed: int = 0,
    hold_out: str | None = None,
    only: str | None = None,
    excluded: Collection[str] = (),
    diagnosis: Diagnosis | None = None,
    on_progress: OnProgress | None = None,
) -> DesignResult:
    """What to measure next so that the explanations which a diagnosis leaves are told apart.

    Parameters
    ----------
    budget: of the rig's time, s; without one only `records` counts.
    records: at most so many; `MOST_RECORDS` when left out.
    separate: the names of the two to be told apart, instead of all that the diagnosis leaves.
    sensors: look at the channels that the bench could have, too.
    seed: of candidates and draws: the same seed gives the same design.
    hold_out, only, excluded: as of `rigctl.analysis.diagnosis.diagnose`.
    diagnosis: of the same model on the same runs, where it has been made already.

    Raises
    ------
    RigctlError
        nothing is left to tell apart, or no such name; the budget is too small for any record; the bench's
        conditions cannot be set.
    """
    found = diagnosis or diagnose(
        runs, model, hold_out=hold_out, only=only, excluded=excluded, on_progress=on_progress
    )
    raise RigctlError(f"no record is proposed yet for {found.model}")
