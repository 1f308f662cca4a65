"""The accepted formulas as effect files, for `rigctl model add`, `compare` and later diagnoses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from datetime import date
from pathlib import Path

from rigctl.dataset.outputs import require_folder
from rigctl.discovery.effect_file import file_text
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.effects.registry import library
from rigctl.effects.user.names import name_in_file
from rigctl.effects.validity import Provenance
from rigctl.files.write import write_text
from rigctl.method_version import DISCOVERY_VERSION, METHOD_VERSION
from rigctl.model.model import Model
from rigctl.notebook import worded


def write_files(discovery: Discovery, folder: Path) -> Discovery:
    """Write each accepted formula as an effect file in `folder`; existing files are kept.

    Raises
    ------
    RigctlError
        as `require_folder`, or the folder cannot be written to.
    """
    require_folder(folder)
    model = discovery.diagnosis.before.fit.problem.model
    taken = {*library(model.family), *(effect.name for effect in model.own_effects)}
    if folder.is_dir():
        taken |= {name for path in folder.glob("*.y*ml") if (name := name_in_file(path)) is not None}
    written = []
    for one in discovery.formulas:
        if one.accepted:
            path = _write(one, discovery, model, folder, taken)
            written.append(replace(one, file=path))
        else:
            written.append(one)
    return replace(discovery, formulas=tuple(written))


def _write(
    one: FoundFormula, discovery: Discovery, model: Model, folder: Path, taken: Collection[str]
) -> Path:
    origin = Provenance(
        runs=tuple(discovery.runs),
        model=discovery.model,
        method=METHOD_VERSION,
        discovery=DISCOVERY_VERSION,
        date=date.today().isoformat(),  # noqa: DTZ011 - the day on the user's calendar
        tier=one.tier.letter,
        statement=worded(one.tier, "discovery.tier_statement"),
    )
    name, number = one.name, 2
    while name in taken or (folder / _file_name(name)).exists():
        name, number = f"{one.name}_{number}", number + 1
    path = folder / _file_name(name)
    write_text(path, file_text(one.fitted.formula, name, one.valid, model, folder, origin))
    return path


def _file_name(effect: str) -> str:
    return f"{effect.replace('_', '-')}.yaml"
