"""How often, and after how many experiments, rigctl finds the right one of several rival models.

The loop that a user would go through with `rigctl import` and `rigctl design --model A --model B …`: the
table so far is imported, the models are compared, the next row is designed, the process is measured there,
and so on until nothing is left to distinguish. Beside it the same with rows at random.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from benchmarks.scoreboard.rival_cases import Case, Floats, table
from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file
from rigctl.design.design import design_experiment
from rigctl.design.refusals import NothingLeft
from rigctl.model import Model, load_model
from rigctl.units import read_si

#: the right model alone, or with those that contain it; another one; the budget was used up
Ending = Literal["right", "wrong", "undecided"]


@dataclass(frozen=True)
class Discriminated:
    """One search for the right model.

    Attributes
    ----------
    added: experiments after the first ones.
    named: the model that was found; "" if the budget was used up.
    """

    case: str
    seed: int
    designed: bool
    ending: Ending
    named: str
    added: int
    seconds: float


def discriminate(case: Case, seed: int, *, designed: bool = True) -> Discriminated:
    """Add experiments until one model is left, or as many as the case allows."""
    began = time.process_time()
    rng = np.random.default_rng(seed)
    settings = case.settings_at_random(case.first, rng)
    readings = case.measure(settings, rng)
    with TemporaryDirectory() as name:
        folder = Path(name)
        models = [load_model(path) for path in case.write(folder)]
        named = ""
        while True:
            try:
                point = _next(case, folder, models, settings, readings)
            except NothingLeft as nothing:
                named = str(nothing.value)
                break
            if len(settings) - case.first == case.more:
                break
            row = point if designed else case.settings_at_random(2, rng)[:1]
            settings = np.vstack([settings, row])
            readings = np.vstack([readings, case.measure(row, rng)])
    ending: Ending = "undecided" if not named else "right" if named == case.right else "wrong"
    seconds = time.process_time() - began
    return Discriminated(case.name, seed, designed, ending, named, len(settings) - case.first, seconds)


def _next(case: Case, folder: Path, models: Sequence[Model], settings: Floats, readings: Floats) -> Floats:
    """(1, settings) the next experiment after those so far."""
    path = folder / f"after-{len(settings)}.csv"
    path.write_text(table([*case.ranges, *case.noise], np.hstack([settings, readings])), encoding="utf-8")
    imported = import_file(path, models[0].rig, folder / "runs")
    design = design_experiment([open_run(imported.path)], models[0], others=models[1:], records=1)
    if not design.records:
        raise SystemExit(f"{case.name}: no row is worth measuring after {len(settings)}")
    shown = design.records[0].settings
    return np.array([[_number(shown[name]) for name in case.ranges]])


def _number(shown: str) -> float:
    return {"on": 1.0, "off": 0.0}.get(shown) if shown in ("on", "off") else read_si(shown, "1")


def searched(case: Case, seeds: Iterable[int], *, designed: bool) -> dict[str, Any]:
    """The searches of a case with several seeds, as they are stored."""
    searches = [discriminate(case, seed, designed=designed) for seed in seeds]
    return {
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "rivals": len(case.rivals),
        "first": case.first,
        "most": case.more,
        "designed": designed,
        "named": [one.named for one in searches],
        "right": case.right,
        "added": [one.added for one in searches],
        "seconds": round(sum(one.seconds for one in searches) / len(searches), 1),
    }


def same_searches(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether both are of one case, with rows chosen in one way."""
    return all(one[key] == other[key] for key in ("case", "designed"))
