"""The equivalent command of a click on the workbench."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rigctl.command_line import DataOptions, command
from rigctl.effects.declaration import qualified
from rigctl.model.model import Model
from rigctl.model.setting import setting_text
from rigctl.workbench.state import State


@dataclass(frozen=True)
class Changes:
    """The difference between a state and the model in the file.

    Attributes
    ----------
    values: names of the model's own values that differ.
    added, removed: effects.
    """

    values: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.values or self.added or self.removed)


@dataclass(frozen=True)
class Subject:
    """The subject of the workbench, as typed on the command line.

    Attributes
    ----------
    runs: ids.
    model: the file's path as typed, with its version unless it is the head.
    choice: of the records.
    """

    runs: tuple[str, ...]
    model: str
    choice: DataOptions = field(default_factory=DataOptions)

    @property
    def head(self) -> str:
        """The file, without the version."""
        folder, name = Path(self.model).parent, Path(self.model).name.partition("@")[0]
        return (folder / name).as_posix()

    def analysis(self, verb: str, *more: str) -> str:
        """``rigctl compare RUN --model M``."""
        return command([verb, *self.runs, "--model", self.model, *more], self.choice)

    def change(self, verb: str, *words: str) -> str:
        """``rigctl model add M EFFECT --fit RUN``."""
        runs = ["--fit", *self.runs] if verb in ("add", "remove") else list(self.runs)
        return command(["model", verb, self.model, *words, *runs], self.choice)

    def history(self) -> str:
        """``rigctl model history M``."""
        return command(["model", "history", self.head])


def set_command(subject: Subject, model: Model, state: State, changes: Changes) -> str:
    """The command that makes a state the model's next version; "" if it equals the model."""
    if not changes:
        return ""
    words = ["model", "set", subject.model]
    words += [f"{name}={setting_text(model, name, state.values[name])}" for name in changes.values]
    for effect in changes.added:
        words += ["--add", _effect_words(model, state, effect)]
    for effect in changes.removed:
        words += ["--remove", effect]
    for run in subject.runs:
        words += ["--run", run]
    return command(words, subject.choice)


def _effect_words(model: Model, state: State, effect: str) -> str:
    """``valve_leakage:conductance=7e-15 m^3``."""
    names = {one.name: qualified(effect, one.name) for one in model.effect(effect).parameters}
    settings = [f"{short}={setting_text(model, name, state.values[name])}" for short, name in names.items()]
    return f"{effect}:{','.join(settings)}" if settings else effect
