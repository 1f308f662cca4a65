"""Change a model file, with the error before and after on what was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rich.markup import escape

from rigctl.analysis.fitting import fit_again, fit_to_data, read_runs, require_free_parameters
from rigctl.cli.compare import open_runs
from rigctl.cli.compare_views import show_departures
from rigctl.cli.echo import echo
from rigctl.cli.model_views import show_errors, value_texts
from rigctl.cli.next_command import DataOptions, analysis, show_next
from rigctl.cli.plans import find_file
from rigctl.cli.tables import console, print_json, table
from rigctl.cli.telling import telling
from rigctl.effects import Effect
from rigctl.effects.option import read_effect_option
from rigctl.effects.user import is_effect_file
from rigctl.errors import RigctlError
from rigctl.model import Change, Model, Version, load_model, save_version, stated_values
from rigctl.model.fit.model_error import model_error
from rigctl.model.validity import Departure, departures


@dataclass(frozen=True)
class Wanted:
    """A change that a command was asked for.

    Attributes
    ----------
    kind: what is done; `effect` is its name.
    changed: makes the new model out of the old one.
    runs, only, hold_out: the records to fit to, which of them, and those to keep for the proof.
    fit: whether free parameters are fitted, those of the model before too, so that only the effect differs.
    effect_files: of the user's own effects.
    """

    kind: Literal["fit", "add", "remove"]
    changed: Callable[[Model], Model]
    runs: Sequence[str]
    hold_out: str | None
    only: str | None
    fit: bool
    assume: Sequence[str] = ()
    effect: str = ""
    effect_files: tuple[Path, ...] = ()


def carry_out(path: Path, wanted: Wanted, *, as_json: bool) -> None:
    """Change the model file `path`, and tell what that did to the error.

    Raises
    ------
    RigctlError
        the records or the model are not fit for it.
    """
    model = load_model(path)
    if wanted.kind == "fit":
        require_free_parameters(model)
    made, done, outside = _measured(model, wanted) if wanted.runs else _unmeasured(model, wanted)
    version = save_version(made, path, done, effect_files=wanted.effect_files)
    if as_json:
        print_json(_document(version) | {"outside_validity": [one.document() for one in outside]})
    else:
        _show(made, version, outside)


def _unmeasured(model: Model, wanted: Wanted) -> tuple[Model, Change, tuple[Departure, ...]]:
    """A change that no record is asked about."""
    for option, value in (("--hold-out", wanted.hold_out), ("--only", wanted.only)):
        if value:
            raise RigctlError(f"{option} chooses among the records of runs, and none was named")
    return wanted.changed(model), Change(wanted.kind, effect=wanted.effect), ()


def _measured(model: Model, wanted: Wanted) -> tuple[Model, Change, tuple[Departure, ...]]:
    wanted.changed(model)  # refused before any work
    runs = open_runs(wanted.runs, model, wanted.assume)
    with telling("nothing was saved") as on_progress:
        refit = wanted.fit and wanted.kind != "fit"
        data = read_runs(model, runs, hold_out=wanted.hold_out, only=wanted.only, on_progress=on_progress)
        before = fit_to_data(model, data, refit=refit, on_progress=on_progress)
        made = wanted.changed(before.model)
        on_progress(f"{'Fitting' if wanted.fit else 'Simulating'} the new {model.name}")
        after = fit_again(before, made, refit=wanted.fit, on_progress=on_progress)
    done = Change(
        wanted.kind,
        effect=wanted.effect,
        runs=tuple(run.id for run in runs),
        hold_out=wanted.hold_out or "",
        only=wanted.only or "",
        assume=tuple(wanted.assume),
        before=model_error(before),
        after=model_error(after),
    )
    return after.model, done, departures(after)


def read_effect(model: Model, written: str) -> tuple[Effect, dict[str, float], tuple[Path, ...]]:
    """The effect of ``EFFECT[:param=value,...]``, its parameters in SI, and the files it comes from."""
    if ":" not in written and not is_effect_file(written):
        effect = model.effect(written)
        return effect, {} if effect.base else effect.start, ()
    parameters = {name: value for name, value in model.values.items() if "." not in name}
    effect, values = read_effect_option(written, model.family, parameters)
    own = is_effect_file(written.partition(":")[0])
    return effect, values, (find_file(Path(written.partition(":")[0])),) if own else ()


def _document(version: Version) -> dict[str, Any]:
    done = version.done
    return {
        "model": str(version.head),
        "version": version.number,
        "parent": version.parent,
        "effect": done.effect or None,
        "runs": list(done.runs),
        "hold_out": done.hold_out or None,
        "only": done.only or None,
        "assume": list(done.assume),
        "before": done.before.document() if done.before else None,
        "after": done.after.document() if done.after else None,
    }


def _show(made: Model, version: Version, outside: Sequence[Departure]) -> None:
    """What became of the file, the fall of the error, and the values found."""
    done, head = version.done, version.head
    old, new = {
        "fit": ("as it was", "fitted"),
        "add": (f"without {done.effect}", f"with {done.effect}"),
        "remove": (f"with {done.effect}", f"without {done.effect}"),
    }[done.kind]
    echo(f"{head} is now version {version.number}, {new}.")
    if done.before is not None and done.after is not None:
        show_errors([(old, done.before), (new, done.after)])
        echo(f"  reduced χ²: {done.before.chi2_reduced:.4g} {old}, {done.after.chi2_reduced:.4g} {new}")
        _show_values(made)
    show_departures(outside)
    echo(f"Version {version.parent} is kept: rigctl model diff {head}@{version.parent} {head}")
    if done.runs:
        choice = DataOptions(done.only, done.hold_out, done.assume)
        command = analysis("compare", done.runs, str(head), choice)
        show_next(f"{command} --no-fit", "says whether it agrees with them now")


def _show_values(made: Model) -> None:
    """The parameters that were fitted."""
    shown = table("fitted parameter", "value", "", "unit")
    for stated in stated_values(made):
        if stated.fit:
            value, spread = value_texts(stated)
            shown.add_row(stated.name, value, escape(spread), escape(stated.unit))
    console().print(shown)
