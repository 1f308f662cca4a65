"""Change a model file: fit it, add or remove an effect, or set values, with the error before and after.

In: a file, what is `Wanted`, and runs, or none. Out: `Changed`, with the version that was saved. The error
before is that of the old model under the same conditions (fitted too if the new one is), because only then is
the difference due to the change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rigctl.analysis.fitting import (
    OnProgress,
    fit_again,
    fit_to_data,
    no_progress,
    read_runs,
    require_free_parameters,
)
from rigctl.dataset.run import Run
from rigctl.engine.least_squares import NoValueAtStart
from rigctl.errors import RigctlError
from rigctl.model.fit.assumptions import Conditional, conditional_numbers
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.model_error import model_error
from rigctl.model.fit.reached_bounds import ReachedBound, reached_bounds
from rigctl.model.fit.undetermined import Undetermined, first_statements, undetermined
from rigctl.model.history.change import Change
from rigctl.model.history.save import save_version
from rigctl.model.history.version import Version
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.model.validity import Departure, departures
from rigctl.model.value_table import stated_values

#: smaller sizes at which an added effect starts, as shares of its typical one, until the model has a value
_SHARES = (0.1, 0.01, 0.001)


@dataclass(frozen=True)
class Wanted:
    """A requested change.

    Attributes
    ----------
    kind: the change; `effect` is the name of its effect.
    changed: returns the new model for the old one.
    fit: whether free parameters are fitted, also those of the old model, so that only the effect differs.
    hold_out, only: conditions for the records held out as proof, and for those used.
    assume: ``name=value`` of inputs that the runs themselves do not contain.
    effect_files: of the user's own effects.
    note: the change, in words.
    """

    kind: Literal["fit", "add", "remove", "set"]
    changed: Callable[[Model], Model]
    fit: bool
    hold_out: str | None = None
    only: str | None = None
    assume: Sequence[str] = ()
    effect: str = ""
    effect_files: tuple[Path, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Changed:
    """The changed file.

    Attributes
    ----------
    model: the new model.
    version: the version that was saved.
    outside: where it leaves the ranges over which laws of its effects were learned.
    bounds: its parameters that the fit drove to a bound, or beyond one that was widened.
    undetermined: its parameters of which the data determine only combinations.
    conditional: by name, its fitted numbers that hold only for assumed ones.
    """

    model: Model
    version: Version
    outside: tuple[Departure, ...] = ()
    bounds: tuple[ReachedBound, ...] = ()
    undetermined: tuple[Undetermined, ...] = ()
    conditional: Mapping[str, Conditional] = field(default_factory=dict)

    @property
    def first(self) -> tuple[str, ...]:
        """What has to be known before its values: parameters that ended at a bound, or are undetermined."""
        return first_statements(self.bounds, self.undetermined)

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        version, done = self.version, self.version.done
        return {
            "model": version.head.as_posix(),
            "version": version.number,
            "parent": version.parent,
            "effect": done.effect or None,
            "runs": list(done.runs),
            "hold_out": done.hold_out or None,
            "only": done.only or None,
            "assume": list(done.assume),
            "before": done.before.document() if done.before else None,
            "after": done.after.document() if done.after else None,
            "bounds": [one.document() for one in self.bounds],
            "undetermined": [one.document() for one in self.undetermined],
            "parameters": self._conditional_document(),
            "outside_validity": [one.document() for one in self.outside],
        }

    def _conditional_document(self) -> dict[str, Any]:
        """The fitted numbers that hold only for assumed ones, in the units of the model file."""
        units = {one.name: one.unit for one in stated_values(self.model)}
        return {name: one.document(units[name]) for name, one in self.conditional.items()}


def change_model(
    path: Path, wanted: Wanted, runs: Sequence[Run], *, on_progress: OnProgress = no_progress
) -> Changed:
    """Make a change to the model file at `path`, saved as its next version.

    For a fit, the error before is that of the values in the file; for an effect, that of the model without
    it, fitted to the same records if `wanted.fit`. Without runs nothing is fitted, and the error is unknown.

    Raises
    ------
    RigctlError
        the records or the model are not suitable, or the version cannot be saved.
    """
    model = load_model(path)
    if wanted.kind == "fit":
        require_free_parameters(model)
    fitted = None
    if runs:
        fitted, change = _measured(model, wanted, runs, on_progress)
        changed = fitted.model
    else:
        changed, change = _unmeasured(model, wanted)
    version = save_version(changed, path, change, effect_files=wanted.effect_files)
    if fitted is None:
        return Changed(changed, version)
    return Changed(
        changed,
        version,
        departures(fitted),
        reached_bounds(fitted),
        undetermined(fitted),
        conditional_numbers(fitted),
    )


def _unmeasured(model: Model, wanted: Wanted) -> tuple[Model, Change]:
    """A change that needs no records."""
    selects = "selects among the records of runs"
    named = "Name one with '--run'" if wanted.kind == "set" else "Name a RUN"
    for option, value, does in (
        ("--hold-out", wanted.hold_out, selects),
        ("--only", wanted.only, selects),
        ("--assume", wanted.assume, "gives what runs did not record"),
    ):
        if value:
            raise RigctlError(f"{option} {does}, and no run was named", hint=named)
    return wanted.changed(model), Change(wanted.kind, effect=wanted.effect, note=wanted.note)


def _measured(
    model: Model, wanted: Wanted, runs: Sequence[Run], on_progress: OnProgress
) -> tuple[FitResult, Change]:
    """The changed model on its records, and the change of the error."""
    wanted.changed(model)  # an invalid change is refused before any work is done
    data = read_runs(model, runs, hold_out=wanted.hold_out, only=wanted.only, on_progress=on_progress)
    refit = wanted.fit and wanted.kind != "fit"
    before = fit_to_data(model, data, refit=refit, on_progress=on_progress)
    changed = wanted.changed(before.model)
    on_progress(f"{'Fitting' if wanted.fit else 'Simulating'} the new {model.name}")
    after = _fit_changed(before, changed, wanted, on_progress)
    change = Change(
        wanted.kind,
        effect=wanted.effect,
        runs=tuple(run.id for run in runs),
        hold_out=wanted.hold_out or "",
        only=wanted.only or "",
        assume=tuple(wanted.assume),
        before=model_error(before),
        after=model_error(after),
        note=wanted.note,
    )
    return after, change


def _fit_changed(before: FitResult, changed: Model, wanted: Wanted, on_progress: OnProgress) -> FitResult:
    """The fit of the changed model; an added effect starts smaller if the model has no value at its start.

    A diagnosis starts an effect at the size that the residuals suggest. A typical size of the family may be
    far beyond what this bench can have: a damping that stops it, a spring that throws it out of its range.
    """
    try:
        return fit_again(before, changed, refit=wanted.fit, on_progress=on_progress)
    except NoValueAtStart:
        if wanted.kind != "add" or not wanted.fit:
            raise
    *smaller, smallest = (_weakened(changed, wanted.effect, share) for share in _SHARES)
    for start in smaller:
        with suppress(NoValueAtStart):
            return fit_again(before, start, on_progress=on_progress)
    return fit_again(before, smallest, on_progress=on_progress)


def _weakened(model: Model, name: str, share: float) -> Model:
    """The model with an effect of this share of its size: its parameters nearer to their null values."""
    settings = model.effects.get(name, {})
    values = {
        f"{name}.{one.name}": one.null + share * (settings[one.name].si - one.null)
        for one in model.effect(name).parameters
        if one.null is not None and one.name in settings
    }
    return model.with_values(values)
