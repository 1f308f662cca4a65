"""Completion of values in the shell: runs, files of the project, and the names that these contain.

Offered are names of the model or rig that the line already names, else of all of the project.
What cannot be read is not offered: a shell that completes a line has no place for a message.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, MutableMapping
from pathlib import Path
from typing import Any

#: names of a source of values, from what the line has so far
_Source = Callable[[dict[str, Any]], Iterable[str]]

#: most runs that are offered: the newest
_MOST_RUNS = 50


def complete_values(command: Any) -> None:
    """Make the shell complete the values of a command's arguments and options."""
    for param in command.params:
        source = _SOURCES.get(param.name)
        if source is not None and not getattr(param, "is_flag", False):
            param._custom_shell_complete = _completing(source)  # noqa: SLF001 - the library sets it by a class only


def join_words(environment: MutableMapping[str, str]) -> None:
    """Join what bash has split before it asks: ``piston_leakage:cond`` are three words to it.

    Only the last of them is then replaced by what is offered, see `_kept_by_shell`.
    """
    written = environment["COMP_WORDS"]
    words = written.split("\n" if "\n" in written else " ")
    at = int(environment["COMP_CWORD"])
    joined: list[str] = []
    place = at
    glued = False
    for k, word in enumerate(words):
        broken = re.fullmatch("[:=]+", word) is not None
        if joined and (broken or glued):
            joined[-1] += word
        else:
            joined.append(word)
        glued = broken
        if k == at:
            place = len(joined) - 1
    environment.update(COMP_WORDS="\n".join(joined), COMP_CWORD=str(place))


def _kept_by_shell(begun: str) -> int:
    """How many characters of a word bash keeps: up to its last ``:`` or ``=``; other shells keep none."""
    asking = os.environ.get("_RIGCTL_COMPLETE", "")
    return max(begun.rfind(":"), begun.rfind("=")) + 1 if asking == "complete_bash" else 0


def _completing(source: _Source) -> Callable[[Any, Any, str], list[str]]:
    def complete(context: Any, _: Any, begun: str) -> list[str]:
        try:
            found = sorted({name for name in source(context.params) if name.startswith(begun)})
            return [name[_kept_by_shell(begun) :] for name in found]
        except Exception:  # noqa: BLE001 - whatever is wrong with a file, a shell has no place to say it
            return []

    return complete


def _runs(_: dict[str, Any]) -> Iterable[str]:
    from rigctl.dataset import list_runs

    return ["latest", *(one.id for one in list_runs(last=_MOST_RUNS))]


def _files(folder: str) -> _Source:
    def found(_: dict[str, Any]) -> Iterable[str]:
        from rigctl.project import find_project

        here, root = Path.cwd(), find_project().root
        files = [*(root / folder).glob("*.yaml"), *here.glob("*.yaml")]
        return [(one.relative_to(here) if one.is_relative_to(here) else one).as_posix() for one in files]

    return found


def _rigs(given: dict[str, Any]) -> list[Any]:
    from rigctl.project import find_file, find_project
    from rigctl.rig import load_rig

    named = given.get("rig")
    files = [find_file(Path(named))] if named else (find_project().root / "rigs").glob("*.yaml")
    return [load_rig(one) for one in files]


def _models(given: dict[str, Any]) -> list[Any]:
    from rigctl.model import load_model
    from rigctl.project import find_file, find_project

    named = given.get("model")
    files = [named] if named and not isinstance(named, list | tuple) else [*(named or ())]
    paths = [find_file(Path(one)) for one in files] or (find_project().root / "models").glob("*.yaml")
    return [load_model(one) for one in paths]


def _channels(given: dict[str, Any]) -> Iterable[str]:
    return [name for rig in _rigs(given) for name in rig.channels]


def _actuators(given: dict[str, Any]) -> Iterable[str]:
    return [name for rig in _rigs(given) for name in rig.actuators]


def _names(given: dict[str, Any]) -> Iterable[str]:
    return [*_channels(given), *_actuators(given)]


def _families(_: dict[str, Any]) -> Iterable[str]:
    from rigctl.physics.families import family_names

    return family_names()


def _effects(given: dict[str, Any]) -> Iterable[str]:
    """Effects, and with their parameters: ``piston_leakage:clearance=``."""
    from rigctl.effects import library

    families = [one.family for one in _models(given)] if given.get("model") else _families(given)
    for family in families:
        for effect in library(family).values():
            yield effect.name
            yield from (f"{effect.name}:{parameter.name}=" for parameter in effect.parameters)


def _effects_of_model(given: dict[str, Any]) -> Iterable[str]:
    return [name for one in _models(given) for name in one.effects]


def _parameters(given: dict[str, Any]) -> Iterable[str]:
    return [f"{one.name}=" for model in _models(given) for one in model.family.parameters if not one.fixed]


_SOURCES: dict[str, _Source] = {
    **dict.fromkeys(("run", "runs", "recording"), _runs),
    "rig": _files("rigs"),
    "model": _files("models"),
    "plant": _files("models"),
    "procedure": _files("procedures"),
    "channel": _channels,
    "actuator": _actuators,
    "over": _names,
    "vary": _names,
    "family": _families,
    **dict.fromkeys(("effect", "add_effect", "alongside"), _effects),
    "remove_effect": _effects_of_model,
    "values": _parameters,
    "share": _parameters,
}
