"""The changes requested from `rigctl model set`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.analysis.search.model_change import Wanted
from rigctl.cli.commands.model.changes import read_effect
from rigctl.cli.plans import read_assignments
from rigctl.effects import Effect
from rigctl.errors import RigctlError
from rigctl.model import Model
from rigctl.model.setting import read_settings, set_by_hand, words_of


@dataclass(frozen=True)
class _Settings:
    """Changes in order: effects removed, effects added, values set."""

    values: dict[str, str]
    add: tuple[tuple[Effect, dict[str, float]], ...]
    remove: tuple[str, ...]
    standings: Mapping[str, str]

    def __call__(self, model: Model) -> Model:
        for name in self.remove:
            model = model.without_effect(name)
        for effect, values in self.add:
            model = model.with_effect(effect, values)
        model = set_by_hand(model, read_settings(model, self.values))
        for name, standing in self.standings.items():
            model = model.with_standing(name, standing)
        return model


def settings_wanted(
    model: Model,
    values: Sequence[str],
    add: Sequence[str],
    remove: Sequence[str],
    choice: tuple[str | None, str | None, Sequence[str]],
    standings: Sequence[str] = (),
) -> Wanted:
    """The change of a model that sets these values, and adds and removes these effects.

    `choice` are the conditions for records held out and used, and the assumed inputs.

    Raises
    ------
    RigctlError
        nothing is set, or a value or an effect is wrong.
    """
    if not values and not add and not remove and not standings:
        raise RigctlError(
            "there is nothing to set", expected="NAME=VALUE, --add EFFECT, --remove EFFECT or --standing"
        )
    given = read_assignments(values, "NAME=VALUE")
    read = [read_effect(model, text) for text in add]
    files: tuple[Path, ...] = tuple(file for _, _, paths in read for file in paths)
    known = read_assignments(standings, "NAME=STANDING")
    settings = _Settings(
        given, tuple((effect, effect_values) for effect, effect_values, _ in read), tuple(remove), known
    )
    result = settings(model)
    note = words_of(result, read_settings(result, given), (effect.name for effect, _, _ in read), remove)
    note = ", ".join([*([note] if note else []), *(f"{name} {standing}" for name, standing in known.items())])
    hold_out, only, assume = choice
    return Wanted("set", settings, False, hold_out, only, assume, effect_files=files, note=note)
