"""`rigctl schema`: JSON Schema of the files a user writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import typer

from rigctl.cli.echo import echo
from rigctl.errors import unknown_name

#: kind of file: where its pydantic model is, and what editors call it
_FILES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "procedure": ("rigctl.procedure:ProcedureFile", "rigctl procedure"),
        "rig": ("rigctl.rig:Rig", "rigctl rig"),
        "model": ("rigctl.model.schema:ModelFile", "rigctl model"),
        "effect": ("rigctl.effects.user.schema:EffectFile", "rigctl effect"),
        "family": ("rigctl.physics.user.schema:FamilyFile", "rigctl family"),
    }
)


def schema(
    kind: Annotated[
        str, typer.Argument(help="Kind of file: procedure, rig, model, effect or family.", show_default=False)
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write instead of stdout.")
    ] = None,
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is not a schema.")] = False,
) -> None:
    """Print the JSON Schema of a kind of file, which an editor uses to complete and check it.

    Example: rigctl schema procedure -o procedure.schema.json

    In a file, '# yaml-language-server: $schema=procedure.schema.json' as the first line attaches it.
    """
    from rigctl.dataset.outputs import is_schema, require_output
    from rigctl.files.schema import json_schema
    from rigctl.files.write import write_text

    if kind not in _FILES:
        raise unknown_name("kind of file", kind, _FILES)
    target, title = _FILES[kind]
    module, name = target.split(":")
    text = json.dumps(json_schema(getattr(import_module(module), name), title=title), indent=1)
    if output is None:
        echo(text)
    else:
        require_output(output, replaces=is_schema, force=force)
        write_text(output, text + "\n")
