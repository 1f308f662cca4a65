"""The runs and models that an analysis is given by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigctl.dataset import Run
    from rigctl.model import Model


def open_runs(
    written: Sequence[str], model: Model | None = None, assume: Sequence[str] | None = None
) -> list[Run]:
    """The runs, each once, with the assumed values of the model's inputs."""
    from rigctl.dataset import open_run

    runs = list({run.id: run for run in map(open_run, written)}.values())
    if model is None or not assume:
        return runs
    from rigctl.model.measured.assumed import assuming

    return [assuming(run, model, assume) for run in runs]


def open_models(written: Sequence[Path]) -> list[Model]:
    """The named models, from the current folder, the project or the shipped ones."""
    from rigctl.model import load_model
    from rigctl.project import find_file

    return [load_model(find_file(path)) for path in written]
