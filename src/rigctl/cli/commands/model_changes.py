"""Change a model file from a command, and report the change of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape

from rigctl.analysis.search.model_change import Changed, Wanted, change_model
from rigctl.answers.blocks import Answer, counted, nonempty
from rigctl.answers.comparison import departures
from rigctl.answers.history import error_change, held_out_change
from rigctl.answers.model_errors import error_bars
from rigctl.cli.blocks import show, show_answer
from rigctl.cli.echo import echo, print_json
from rigctl.cli.named_input import open_runs
from rigctl.cli.next_command import show_next
from rigctl.cli.progress import progress_display
from rigctl.cli.tables import console, table
from rigctl.cli.views.model import value_texts
from rigctl.command_line import DataOptions, analysis
from rigctl.effects import Effect
from rigctl.effects.option import read_effect_option
from rigctl.effects.user import is_effect_file
from rigctl.model import Model, StatedValue, load_model, stated_values
from rigctl.model.fit.assumptions import Conditional
from rigctl.project import find_file
from rigctl.units import significant

#: number of fitted parameters in the answer
_NAMED = 4


def carry_out(
    path: Path,
    wanted: Wanted,
    runs: Sequence[str],
    *,
    family: str | None,
    as_json: bool,
    verbose: bool = False,
) -> None:
    """Change the model file `path`, and show the change of the error.

    `family` is as given, for the next command.

    Raises
    ------
    RigctlError
        the records or the model are not suitable.
    """
    with progress_display("Reading the records", "nothing was saved") as on_progress:
        opened = open_runs(runs, load_model(path), wanted.assume) if runs else []
        changed = change_model(path, wanted, opened, on_progress=on_progress)
    print_json(changed.document()) if as_json else _show(changed, family, verbose=verbose)


def read_effect(model: Model, written: str) -> tuple[Effect, dict[str, float], tuple[Path, ...]]:
    """The effect of ``EFFECT[:param=value,...]``, its parameters in SI, and the files it comes from."""
    if ":" not in written and not is_effect_file(written):
        effect = model.effect(written)
        return effect, {} if effect.base else effect.start, ()
    parameters = {name: value for name, value in model.values.items() if "." not in name}
    effect, values = read_effect_option(written, model.family, parameters)
    from_file = is_effect_file(written.partition(":")[0])
    return effect, values, (find_file(Path(written.partition(":")[0])),) if from_file else ()


def _show(changed: Changed, family: str | None, *, verbose: bool) -> None:
    """Show the new version, the change of the error, and the values; with `verbose` bars and a table."""
    version = changed.version
    done, head = version.done, version.head
    old, new = {
        "fit": ("as it was", "fitted"),
        "add": (f"without {done.effect}", f"with {done.effect}"),
        "remove": (f"with {done.effect}", f"without {done.effect}"),
        "set": ("as it was", "set by hand"),
    }[done.kind]
    facts, more = [("note", done.note)], []
    if done.before is not None and done.after is not None:
        fitted = [stated for stated in stated_values(changed.model) if stated.fit]
        facts += [
            ("error", error_change(done.before, done.after)),
            ("held out", held_out_change(done.before, done.after)),
            ("fitted", _in_words(fitted, changed.conditional)),
        ]
        more = ["every channel's error as bars", *counted(len(fitted), "fitted parameter")]
    answer = Answer(
        "good",
        "",
        f"{head} is now version {version.number}, {new}",
        nonempty(facts),
        changed.first,
        more=() if verbose else tuple(more),
        headed=False,
    )
    show_answer(answer)
    if verbose and done.before is not None and done.after is not None:
        show(error_bars([(old, done.before), (new, done.after)]))
        if done.before.chi2_reduced is not None and done.after.chi2_reduced is not None:
            before, after = significant(done.before.chi2_reduced), significant(done.after.chi2_reduced)
            echo(f"  reduced χ²: {before} {old}, {after} {new}")
        _show_values(changed.model, changed.conditional)
    show(departures(changed.outside))
    echo(f"Version {version.parent} is kept: rigctl model diff {head}@{version.parent} {head}")
    if done.runs:
        choice = DataOptions(done.only, done.hold_out, done.assume, family)
        command = analysis("compare", done.runs, str(head), choice)
        show_next(f"{command} --no-fit", "shows whether it agrees with them now")


def _show_values(model: Model, conditional: Mapping[str, Conditional]) -> None:
    """The parameters that were fitted."""
    shown = table("fitted parameter", "value", "", "unit")
    for stated in stated_values(model):
        if stated.fit:
            value, spread = value_texts(stated)
            if stated.name in conditional:
                value, spread = significant(stated.value, 2), conditional[stated.name].clause(stated.unit)
            shown.add_row(stated.name, value, escape(spread), escape(stated.unit))
    console().print(shown)


def _texts(one: StatedValue, conditional: Conditional | None) -> tuple[str, ...]:
    """A value, its standard deviation and its unit; or what it is over the ranges of assumed numbers."""
    unit = "" if one.unit == "1" else one.unit
    if conditional is None:
        return (*value_texts(one), unit)
    return (significant(one.value, 2), unit, conditional.clause(one.unit))


def _in_words(fitted: Sequence[StatedValue], conditional: Mapping[str, Conditional]) -> str:
    """The first of the fitted parameters with their uncertainty; those of effects before the others."""
    first = sorted(fitted, key=lambda stated: "." not in stated.name)[:_NAMED]
    parts = [" ".join(filter(None, (one.name, *_texts(one, conditional.get(one.name))))) for one in first]
    remaining = len(fitted) - len(first)
    return ", ".join([*parts, *([f"and {remaining} more"] if remaining else [])])
