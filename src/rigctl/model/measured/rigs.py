"""The bench from which the data of a model come."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from rigctl.dataset.run import Run
from rigctl.errors import RigctlError
from rigctl.model.model import Model
from rigctl.rig.load import parse_rig
from rigctl.rig.rig import Rig


def rig_of(model: Model, runs: Sequence[Run]) -> Rig | None:
    """The bench at the time of the first run, with the channels of every run.

    Raises
    ------
    RigctlError
        a run was recorded on another bench than the model's: one of another family or of other dimensions.
    """
    if model.rig is None:
        return None
    result: Rig | None = None
    for run in runs:
        rig = _recorded(run)
        if rig is None:
            continue
        if rig.name != model.rig.name and not _same_bench(rig, model.rig):
            raise RigctlError(
                f"run {run.id} was recorded on '{rig.name}', and the model '{model.name}' is of "
                f"'{model.rig.name}'",
                hint="Take a model of that rig, or 'rigctl import' the data with the model's",
            )
        # the first run's bench, or a later one to which sensors were added: a record without them has no
        # values there
        more = result is None or len(rig.channels) > len(result.channels)
        result = rig if more else result
    return result or model.rig


def recorded_rigs(model: Model, runs: Sequence[Run]) -> dict[str, Rig]:
    """The bench of each run, by its id, as it was then; the model's where a run does not say.

    Without an entry where neither has one: a table measured on no bench.
    """
    benches = {run.id: _recorded(run) or model.rig for run in runs}
    return {name: rig for name, rig in benches.items() if rig is not None}


def _recorded(run: Run) -> Rig | None:
    return _read(run.header.rig.text)


@lru_cache(maxsize=8)
def _read(text: str) -> Rig | None:
    """The bench of a rig file's text, which runs of one bench have in common."""
    try:
        return parse_rig(text) if text else None
    except RigctlError:  # a rig file of another version: its names are still in the data
        return None


def _same_bench(one: Rig, other: Rig) -> bool:
    return one.model == other.model and dict(one.geometry) == dict(other.geometry)
