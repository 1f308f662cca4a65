"""`rigctl model`: show a model and its history, and change it.

In: a model file, or `M@3` for a version of it. Out: what it says, or its next version. Commands that
change describe the change as a `Wanted` and hand it to `changes.carry_out`, which fits, compares and
writes for all of them by `rigctl.analysis.search.model_change`; the workbench calls the same, so that
page and command write the same bytes.

Nothing is changed in place: each version is kept in `.history` with what was done and the error before
and after, so that any answer can be traced to the model that gave it. The error before an addition is
that of the model without the effect, fitted to the same records: the whole decrease is then due to the
effect, and not to the fit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.analysis import Assume, HoldOut, Only, Runs
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence, NoCache
from rigctl.cli.options.family import FamilyOption
from rigctl.errors import RigctlError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Show a model, its history, and change it.\n\nM is a model file, and M@3 its "
    "version 3. Every change made here becomes the next version; earlier ones are kept "
    "in '.history' beside the file and never change.",
)

ModelFile = Annotated[
    Path, typer.Argument(metavar="M", help="Model file; M@3 is its version 3.", show_default=False)
]

SomeRuns = Annotated[
    list[str] | None,
    typer.Argument(metavar="[RUN]...", help="Ids, starts of ids, paths, or 'latest'.", show_default=False),
]


@app.command()
def show(model: ModelFile, *, family: FamilyOption = None, as_json: Json = False) -> None:
    """Show a model: a summary of its equations, its effects, and every parameter.

    Each parameter is listed with its value and unit, its standard deviation if it was fitted, whether a fit
    may change it, and its source.

    Example: rigctl model show models/hl32-textbook.yaml
    """
    from rigctl.answers.model.declared import model_blocks
    from rigctl.cli.blocks import show as show_blocks
    from rigctl.files.version_suffix import split_version
    from rigctl.model import current_version, find_version, load_model
    from rigctl.model.document import model_document
    from rigctl.project import find_file

    path = find_file(model)
    definition = load_model(path)
    head, number = split_version(path)
    version = current_version(head) if number is None else find_version(head, number)
    if as_json:
        print_json(model_document(definition, version))
    else:
        show_blocks(model_blocks(definition, version))


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="Model file, or M@3.", show_default=False)],
    second: Annotated[
        Path, typer.Argument(metavar="B", help="Model file to compare with it.", show_default=False)
    ],
    *,
    family: FamilyOption = None,
    as_json: Json = False,
) -> None:
    """Show the differences between models A and B: effects and parameters.

    Example: rigctl model diff models/hl32-textbook.yaml@1 models/hl32-textbook.yaml
    """
    from rigctl.answers.model.declared import difference_blocks
    from rigctl.cli.blocks import show as show_blocks
    from rigctl.model import difference, load_model
    from rigctl.model.document import difference_document
    from rigctl.project import find_file

    changes = difference(load_model(find_file(first)), load_model(find_file(second)))
    print_json(difference_document(changes)) if as_json else show_blocks(difference_blocks(changes))


@app.command()
def history(
    model: ModelFile,
    *,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show a table of the versions, and the errors as bars.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show the versions of a model: what was done, and how the error fell.

    Examples:

      rigctl model history models/hl32-textbook.yaml

      rigctl model history models/hl32-textbook.yaml -v
    """
    from rigctl.answers.model.history import history_answer, history_evidence
    from rigctl.cli.blocks import show_answer
    from rigctl.model import current_version, versions
    from rigctl.model.history.document import history_document
    from rigctl.project import find_file

    path = find_file(model)
    listing, current = versions(path), current_version(path)
    if as_json:
        print_json(history_document(listing, current))
    else:
        evidence = history_evidence(listing, current) if verbose else ()
        show_answer(history_answer(listing, current), evidence)


@app.command()
def fit(
    model: ModelFile,
    runs: Runs,
    hold_out: HoldOut = None,
    only: Only = None,
    *,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Fit a model's free parameters to runs; the result is its next version.

    The error before is that of the values in the file.

    Example: rigctl model fit models/hl32-textbook.yaml latest --hold-out "oil == 60 degC"
    """
    from rigctl.analysis.search.model_change import Wanted
    from rigctl.cli.commands.model.changes import carry_out
    from rigctl.project import own_model

    wanted = Wanted("fit", lambda model: model, True, hold_out, only, assume or ())
    carry_out(own_model(model), wanted, runs, family=family, as_json=as_json, verbose=verbose)


@app.command()
def add(
    model: ModelFile,
    effect: Annotated[
        str,
        typer.Argument(
            metavar="EFFECT[:P=V,...]",
            help="Effect of the library, or your own effect file. The values given are the starting "
            "values of its fit.",
            show_default=False,
        ),
    ],
    runs: SomeRuns = None,
    *,
    fitting: Annotated[
        bool, typer.Option("--fit/--no-fit", help="Fit the free parameters to the given runs.")
    ] = True,
    fit_shapes: Annotated[
        bool,
        typer.Option("--fit-shapes", help="Also fit the effect's shape parameters: a width, a threshold."),
    ] = False,
    hold_out: HoldOut = None,
    only: Only = None,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Add an effect to a model; the result is its next version, with the error before and after.

    With --fit the error before is that of the model without the effect, fitted to the same records, so that
    the whole decrease is due to the effect.

    Examples:

      rigctl model add models/hl32-textbook.yaml valve_leakage --fit latest --hold-out "oil == 60 degC"

      rigctl model add models/hl32-textbook.yaml "piston_leakage:clearance=30 um" --no-fit
    """
    from rigctl.analysis.search.model_change import Wanted
    from rigctl.cli.commands.model.changes import carry_out, read_effect
    from rigctl.model import load_model
    from rigctl.project import own_model

    if fitting and not runs:
        raise RigctlError("there is nothing to fit the effect to", hint="Name a RUN, or use --no-fit")
    path = own_model(model)
    addition, values, files = read_effect(load_model(path), effect)
    wanted = Wanted(
        "add",
        lambda one: one.with_effect(addition, values, shapes=fit_shapes),
        fitting,
        hold_out,
        only,
        assume or (),
        effect=addition.name,
        effect_files=files,
    )
    carry_out(path, wanted, runs or (), family=family, as_json=as_json, verbose=verbose)


@app.command()
def remove(
    model: ModelFile,
    effect: Annotated[
        str, typer.Argument(metavar="EFFECT", help="Effect of the model or of its base physics.")
    ],
    runs: SomeRuns = None,
    *,
    fitting: Annotated[
        bool, typer.Option("--fit/--no-fit", help="Fit the remaining free parameters to the given runs.")
    ] = True,
    hold_out: HoldOut = None,
    only: Only = None,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Remove an effect from a model; the result is its next version.

    An effect of the base physics is removed by setting it to its null value. The other parameters keep their
    values unless runs are given to fit them to; the error before and after is then reported.

    Example: rigctl model remove models/hl32-textbook.yaml piston_leakage --fit latest
    """
    from rigctl.analysis.search.model_change import Wanted
    from rigctl.cli.commands.model.changes import carry_out
    from rigctl.project import own_model

    wanted = Wanted(
        "remove", lambda one: one.without_effect(effect), fitting, hold_out, only, assume or (), effect=effect
    )
    carry_out(own_model(model), wanted, runs or (), family=family, as_json=as_json, verbose=verbose)


@app.command(name="set")
def set_values(
    model: ModelFile,
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME=VALUE]...",
            help="Parameter and its value with unit; for an effect, effect.parameter=value.",
            show_default=False,
        ),
    ] = None,
    *,
    add_effect: Annotated[
        list[str] | None,
        typer.Option(
            "--add",
            metavar="EFFECT[:P=V,...]",
            help="Also add this effect, with the given values.",
            show_default=False,
        ),
    ] = None,
    remove_effect: Annotated[
        list[str] | None,
        typer.Option("--remove", metavar="EFFECT", help="Also remove this effect.", show_default=False),
    ] = None,
    standing: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=STANDING",
            help="How well a parameter that no fit changes is known: measured, assumed or exact; repeatable.",
            show_default=False,
        ),
    ] = None,
    runs: Annotated[
        list[str] | None,
        typer.Option(
            "--run",
            metavar="RUN",
            help="Run for which the error before and after is reported; repeatable.",
            show_default=False,
        ),
    ] = None,
    hold_out: HoldOut = None,
    only: Only = None,
    assume: Assume = None,
    family: FamilyOption = None,
    no_cache: NoCache = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Set parameter values by hand, and add or remove effects; the result is the model's next version.

    Nothing is fitted. With --run the error before and after is reported.

    Examples:

      rigctl model set models/hl32-textbook.yaml "flow_area=3.9 mm^2" --run latest

      rigctl model set models/hl32-textbook.yaml --add "valve_leakage:conductance=7e-15 m^3" --run latest

      rigctl model set models/motor.yaml "resistance=1.7 ohm" --standing resistance=measured
    """
    from rigctl.cli.commands.model.changes import carry_out
    from rigctl.cli.commands.model.settings import settings_wanted
    from rigctl.model import load_model
    from rigctl.project import own_model

    path = own_model(model)
    wanted = settings_wanted(
        load_model(path),
        values or (),
        add_effect or (),
        remove_effect or (),
        (hold_out, only, assume or ()),
        standing or (),
    )
    carry_out(path, wanted, runs or (), family=family, as_json=as_json, verbose=verbose)


@app.command()
def export(
    model: ModelFile,
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write, ending in .fmu; by default named after the model.",
        ),
    ] = None,
    to: Annotated[str, typer.Option(metavar="FORM", help="fmu: FMI 2.0, co-simulation.")] = "fmu",
    sources_only: Annotated[
        bool, typer.Option("--sources-only", help="Write only C sources, for a simulator that compiles them.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", "--force", help="Replace a file.")] = False,
    family: FamilyOption = None,
    as_json: Json = False,
) -> None:
    """Write a model as a Functional Mock-up Unit, which other simulators run beside their own models.

    Its inputs are those of the family, its parameters those that a fit can change, and its outputs the
    channels of the rig, all in SI. It is compiled with this computer's C compiler for computers of the same
    kind; its sources are included.

    Example: rigctl model export models/hl32-textbook.yaml -o cylinder.fmu
    """
    from dataclasses import asdict

    from rigctl.cli.echo import echo
    from rigctl.dataset.outputs import require_output
    from rigctl.errors import unknown_name
    from rigctl.files.version_suffix import split_version
    from rigctl.model import load_model
    from rigctl.model.fmu import export_fmu
    from rigctl.project import find_file

    if to != "fmu":
        raise unknown_name("form", to, ("fmu",))
    path = find_file(model)
    target = output or Path(f"{split_version(path)[0].stem}.fmu")
    require_output(target, force=overwrite, option="--overwrite")
    fmu = export_fmu(load_model(path), target, sources_only=sources_only)
    if as_json:
        print_json({**asdict(fmu), "path": fmu.path.as_posix(), "model": path.as_posix()})
        return
    compiled = f"compiled for {fmu.platform}" if fmu.platform else "not compiled"
    echo(
        f"{fmu.path.as_posix()}: {fmu.states} states, {fmu.inputs} inputs, {fmu.parameters} parameters, "
        f"{fmu.outputs} outputs, {compiled}"
    )
