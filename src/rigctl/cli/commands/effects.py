"""`rigctl effects`: the library of effects, and a user's own.

In: a family, or the name or file of an effect; with a rig, its channels, dimensions and noise. Out: the
library, the slots of a family, one effect with its signature, or the verdict on a user's file. Effects of
the library and those in files are read into the same `Effect`, so that `show` and `check` take either.

`check` does more than read the file. Its terms are evaluated where the standard record of the family
passes, and the record is simulated with and without them (`rigctl.model.effect_preview`): whether any
channel of the rig would see the effect, and whether another one looks the same, no check of a text can
tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.family import use_family
from rigctl.errors import Location, RigctlError, SeveralErrors

if TYPE_CHECKING:
    from rigctl.effects import Effect
    from rigctl.physics.family import ModelFamily
    from rigctl.rig import Rig

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="List, show and check effects of the library, and your own.\n\n"
    "An effect is one piece of physics that a model may lack: a term at one location in its equations, with "
    "parameters whose null values switch it off exactly.",
)

Family = Annotated[
    str | None,
    typer.Option(
        "--family",
        "-f",
        callback=use_family,
        help="Family of models: a name or your own file; by default all families.",
    ),
]
Which = Annotated[
    str,
    typer.Argument(
        metavar="EFFECT", help="Name of an effect in the library, or an effect file.", show_default=False
    ),
]
RigFile = Annotated[
    Path | None, typer.Option("--rig", help="Rig file whose channels, dimensions and noise are used.")
]
Alongside = Annotated[
    list[str] | None,
    typer.Option(
        "--with", metavar="EFFECT[:param=value]", help="Effect that is present in both cases; repeatable."
    ),
]


@app.command("list")
def list_(
    family: Family = None,
    *,
    slots: Annotated[
        bool,
        typer.Option(
            "--slots", help="List the slots where effects can act, and the names that their terms may use."
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """List the effects of the library, or with --slots the slots where an effect can act.

    A family of your own gets generic effects wherever they fit; the list shows which act where, and why
    others do not.

    Example: rigctl effects list --family hydraulic_cylinder --slots

    Example: rigctl effects list --family mine.yaml
    """
    from rigctl.answers.effects import library_tables, offer_tables, slot_tables
    from rigctl.cli.blocks import show as show_blocks
    from rigctl.effects import library
    from rigctl.effects.document import effect_document, family_document, offer_documents
    from rigctl.physics.families import FAMILIES, find_family

    families = [find_family(family)] if family is not None else list(FAMILIES.values())
    if slots:
        documents = [family_document(each) for each in families]
        print_json({"families": documents}) if as_json else show_blocks(slot_tables(documents))
        return
    effects = [effect for each in families for effect in library(each).values()]
    offered = [document for each in families for document in offer_documents(each)]
    if as_json:
        print_json({"effects": [effect_document(effect) for effect in effects], "generic": offered})
    else:
        show_blocks([*library_tables(effects), *offer_tables(offered)])


@app.command()
def show(
    effect: Which,
    *,
    family: Family = None,
    rig: RigFile = None,
    alongside: Alongside = None,
    figure: Annotated[
        Path | None, typer.Option(help="File for the figure, .png or .svg.", show_default=False)
    ] = None,
    picture: Annotated[
        bool, typer.Option("--picture/--no-picture", help="Simulate and plot its signature.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Show an effect: equation, slots, parameters, source, and its signature in the readings.

    The standard record of its family is simulated with the effect at its typical size and without it; the
    figure shows the difference.

    Example: rigctl effects show piston_leakage --figure leakage.svg

    Example: rigctl effects show barus --with piston_leakage
    """
    from rigctl.answers.effects import effect_blocks, signature_blocks
    from rigctl.cli.blocks import show as show_blocks
    from rigctl.effects.document import effect_document
    from rigctl.model.signature import signature
    from rigctl.model.signature_document import signature_document

    definition, bench, others = _open(effect, family, rig, alongside)
    record = definition.model_family.standard_record is not None
    drawn = figure is not None or (picture and record)
    effect_signature = (
        signature(definition, bench, alongside=others, progress=_print_progress) if drawn else None
    )
    if figure is not None and effect_signature is not None:
        from rigctl.report.effect_figure import write_effect_figure

        write_effect_figure(effect_signature, definition, figure, bench)
    if as_json:
        document = effect_document(definition)
        print_json(
            document
            | (
                {"signature": signature_document(effect_signature, bench)}
                if effect_signature is not None
                else {}
            )
        )
        return
    show_blocks(effect_blocks(definition))
    if effect_signature is not None:
        show_blocks(signature_blocks(effect_signature, bench))
    elif picture:
        echo("\nThe family has no 'standard_record' on which to draw what it changes.")
    if figure is not None:
        echo(f"Wrote {figure.as_posix()}")


@app.command()
def check(
    effect: Which,
    *,
    family: Family = None,
    rig: RigFile = None,
    alongside: Alongside = None,
    as_json: Json = False,
) -> None:
    """Check your own effect: grammar, dimensions, exact null, smoothness, influence, and similar effects.

    Errors are reported with their position in the file, and the exit code is 2. Warnings, e.g. that no
    channel of the rig responds to the effect, leave the exit code at 0.

    Example: rigctl effects check my-effect.yaml --rig rigs/hl32-bench.yaml
    """
    from rigctl.answers.effects import trial_blocks
    from rigctl.cli.blocks import show as show_blocks
    from rigctl.effects.user import is_effect_file
    from rigctl.effects.user.load import place_of
    from rigctl.model.effect_preview import faults_on_record, try_effect
    from rigctl.model.signature_document import trial_document

    definition, bench, others = _open(effect, family, rig, alongside)
    faults = faults_on_record(definition, bench, alongside=others, progress=_print_progress)
    if faults:
        where = _file(effect) if is_effect_file(effect) else None
        errors = [error.at(place_of(where, part) if where else Location()) for part, error in faults]
        raise errors[0] if len(errors) == 1 else SeveralErrors(errors)
    trial = try_effect(definition, bench, alongside=others, progress=_print_progress)
    print_json(trial_document(trial, bench)) if as_json else show_blocks(trial_blocks(trial, bench))


def _open(
    written: str, family: str | None, rig_file: Path | None, alongside: Sequence[str] | None
) -> tuple[Effect, Rig | None, list[tuple[Effect, dict[str, float]]]]:
    """The effect, the rig and the other effects that a command names."""
    from rigctl.effects.option import read_effect_option
    from rigctl.model.rig_family import family_of
    from rigctl.physics.families import find_family

    rig = _rig(rig_file)
    effect = _find(written, find_family(family) if family else family_of(rig) if rig is not None else None)
    if rig is not None and family_of(rig).name != effect.family:
        raise RigctlError(
            f"the rig '{rig.name}' belongs to another family of models than {effect.name}",
            value=str(rig.model),
            expected=effect.family,
        )
    return effect, rig, [read_effect_option(text, effect.model_family) for text in alongside or ()]


def _find(written: str, family: ModelFamily | None) -> Effect:
    """The effect of a file, or of the first family that has one of this name."""
    from rigctl.effects import library
    from rigctl.effects.option import name_or_file
    from rigctl.effects.user import is_effect_file, load_effect
    from rigctl.errors import unknown_name
    from rigctl.physics.families import FAMILIES

    if family is not None:
        return name_or_file(written, family)
    if is_effect_file(written):
        return load_effect(_file(written))
    known = [library(name) for name in FAMILIES]
    for effects in known:
        if written in effects:
            return effects[written]
    raise unknown_name("effect", written, {name for effects in known for name in effects})


def _file(written: str) -> Path:
    from rigctl.project import find_file

    return find_file(Path(written))


def _rig(path: Path | None) -> Rig | None:
    if path is None:
        return None
    from rigctl.project import find_file
    from rigctl.rig import load_rig

    return load_rig(find_file(path))


def _print_progress(text: str) -> None:
    echo(text, err=True)
