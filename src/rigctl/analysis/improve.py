"""Diagnose, add what is missing, and diagnose again, until the model is adequate or nothing helps.

In: a comparison and the file of its model. Out: an `Improvement`: a `Step` for each addition, which is saved
as a version of the file as soon as it is made, so that an interrupted loop leaves a model that can be used;
the last diagnosis; and why it ended. Between diagnosis and addition stands `refusal`: what lowers mBIC but
not the error on data outside the fit is not added.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import Choice, Comparison, ModelComparison
from rigctl.analysis.conclusion import Member
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.fitting import OnProgress, fit_again, no_progress
from rigctl.analysis.held_out import unseen
from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.analysis.linear.block_validation import leave_blocks_out
from rigctl.analysis.linear.candidates import Candidate, require_known
from rigctl.analysis.search.own_scale import TooLargeForSensor, not_a_sensor
from rigctl.analysis.search.ranking import found_parameters
from rigctl.analysis.search.refit import RefittedSet, refit
from rigctl.analysis.search.refitted_sets import RefittedSets
from rigctl.analysis.search.search import require_number_of_effects
from rigctl.argument_types import checks_argument_types
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.model_error import model_error
from rigctl.model.history.change import Change, ModelError
from rigctl.model.history.save import save_version
from rigctl.model.history.version import Version
from rigctl.model.load import load_model
from rigctl.notebook import as_html, documented, one_line, worded

if TYPE_CHECKING:
    import pandas as pd


class ImprovementEnd(StrEnum):
    """Why no further effect was added."""

    ADEQUATE = "adequate"  #: the data show nothing more that the model lacks
    NOTHING_HELPS = "nothing_helps"  #: no further effect lowers mBIC
    NOT_DECIDED = "not_decided"  #: these data cannot tell whether anything is missing: `Diagnosis.doubt`
    MAX_EFFECTS = "max_effects"  #: the requested number has been added
    NOT_SURE = "not_sure"  #: only certain effects were to be added, and none is
    NOT_PREDICTED = "not_predicted"  #: the next effect does not improve data that it was not fitted to
    IMPLAUSIBLE = "implausible"  #: the next effect would have a size that nothing of its kind has


@dataclass(frozen=True)
class Addition:
    """What is added, and what is uncertain about it.

    Attributes
    ----------
    members: the effects added; more than one if they improve mBIC only together.
    following: the effects of the best set that are added after it.
    unusual: their parameters outside their usual range, as `RefittedSet.unusual` names them.
    alike: effects that these data do not distinguish from one of them.
    nearest: they are only the nearest of the library.
    """

    members: tuple[Member, ...]
    following: tuple[str, ...]
    unusual: tuple[str, ...]
    alike: tuple[str, ...]
    nearest: bool

    @property
    def reason(self) -> str:
        """Why these effects, in words."""
        return worded(self, "improvement.reason_text")


@dataclass(frozen=True)
class NotImproved:
    """Effects with which the error does not fall on data outside the fit.

    These are the `records` held out, the conditions left out in turn, or blocks of time.
    """

    effects: tuple[str, ...]
    where: Literal["held_out", "conditions", "blocks"]
    records: int = 0


#: why an effect that lowers mBIC is not added
Refusal: TypeAlias = TooLargeForSensor | NotImproved


@dataclass(frozen=True)
class Step:
    """One addition.

    Attributes
    ----------
    effects: the effects added, of `addition`.
    diagnosis: of the model before it; later ones lack the laws of the effects that the model has.
    delta_bic: mBIC with them less mBIC without.
    before, after: the error.
    version: the version of the model that was saved with them.
    comparison: of the model with them.
    """

    effects: tuple[str, ...]
    diagnosis: Diagnosis = field(repr=False)
    addition: Addition = field(repr=False)
    delta_bic: float
    before: ModelError
    after: ModelError
    version: Version
    comparison: ModelComparison = field(repr=False)

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "effects": list(self.effects),
            "verdict": self.diagnosis.verdict.value,
            "reason": self.addition.reason,
            "delta_bic": self.delta_bic,
            "version": self.version.number,
            "before": self.before.document(),
            "after": self.after.document(),
            "p_value": self.comparison.adequacy.p_value,
        }


@dataclass(frozen=True)
class Improvement:
    """The result of `improve`.

    Attributes
    ----------
    model: the file whose new versions were saved.
    steps: the additions, in order.
    last: the diagnosis of the final model.
    ended: why nothing more was added.
    unseen: the final model on the records that were held out, and on those that were not selected.
    refused: why the next effect was not added, if that is why the loop ended.
    """

    model: Path
    steps: tuple[Step, ...]
    last: Diagnosis
    ended: ImprovementEnd
    unseen: tuple[HeldOutGroup, ...] = ()
    refused: Refusal | None = None

    @property
    def first(self) -> Diagnosis:
        """The diagnosis of the original model."""
        return self.steps[0].diagnosis if self.steps else self.last

    @property
    def statement(self) -> str:
        """One sentence: the effects added, and why the loop ended."""
        return worded(self, "improvement.statement")

    def document(self) -> dict[str, Any]:
        """The answer of the first diagnosis, with the additions and the diagnosis of the result."""
        return documented(self, "improvement_document")

    def __repr__(self) -> str:
        """The additions, on one line."""
        return one_line(self, f"of {self.model.name}: {self.statement}")

    def frame(self) -> pd.DataFrame:
        """The additions, one row for each: the version, its effects, and the error before and after."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "version": step.version.number,
                    "effects": ", ".join(step.effects),
                    "delta_bic": step.delta_bic,
                    "chi2_reduced_before": step.before.chi2_reduced,
                    "chi2_reduced_after": step.after.chi2_reduced,
                }
                for step in self.steps
            ],
            columns=["version", "effects", "delta_bic", "chi2_reduced_before", "chi2_reduced_after"],
        )

    def _repr_html_(self) -> str:
        """The summary and the additions, as a notebook shows them."""
        return as_html(self.summary(), self.frame())

    def summary(self) -> str:
        """One line for each step, and how it ended."""
        lines = [f"version {step.version.number}: {step.addition.reason}" for step in self.steps]
        return "\n".join([*lines, self.statement, *(one.statement for one in self.unseen)])


@checks_argument_types
def improve(
    compared: Comparison,
    path: str | Path,
    *,
    most: int = 4,
    sure: bool = False,
    excluded: Collection[str] = (),
    unless: Callable[[Diagnosis], bool] = lambda _: False,
    on_progress: OnProgress | None = None,
) -> Improvement:
    """Add to a model what it lacks, one step after the other, each saved as the next version of the file.

    Added is the best set of the diagnosis: first the member that gains most by itself, or the whole set at
    once if its members lower mBIC only together. Nothing is added if the data cannot tell whether anything is
    missing. Then the model is diagnosed again.

    Parameters
    ----------
    compared: the model with the data; its first model is improved.
    path: its file, or ``m.yaml@3`` for its version 3.
    most: largest number of effects to add altogether.
    sure: add only what a verdict of ``missing_effect`` names, not the most probable of several.
    unless: called with the first diagnosis; if it returns True nothing is added, whatever the verdict.

    Raises
    ------
    RigctlError
        a version cannot be saved, `most` is less than one, or as `rigctl.analysis.comparison.judge`.
    """
    require_number_of_effects(most)
    require_known(excluded, [compared.models[0].fit.model])
    report = on_progress or no_progress
    current, steps, source = compared.models[0], list[Step](), Path(path)
    while True:
        # One turn: diagnose, plan, add. The plan is made inside the diagnosis (`shown`), because it decides
        # whether the laws of the effects that the model already has are worth estimating: only in the first
        # and the last diagnosis.
        room = most - sum(len(step.effects) for step in steps)
        this = _Round(not steps, room, sure, unless)
        diagnosis = diagnose_comparison(
            current,
            compared.runs,
            compared.held_out,
            compared.notes,
            most=max(room, 1),
            further_laws=this.shown,
            on_progress=on_progress,
        )
        # The diagnosis may have changed the comparison: the noise was refuted, or a deeper minimum was found.
        current = diagnosis.before
        if not this.plan:
            elsewhere = unseen(compared, current, on_progress=on_progress)
            ended = ImprovementEnd.NOT_SURE if this.unsure and not diagnosis.doubt else _why(diagnosis, room)
            refused = this.refused
            ended = ended if refused is None else _ENDS[type(refused)]
            return Improvement(Path(path), tuple(steps), diagnosis, ended, elsewhere, refused)
        # Each member is a version of its own, fitted with everything before it, so that the history shows
        # what each one brings. Every addition is on disk before the next one starts.
        for chosen in this.plan:
            report(f"Adding {' and '.join(chosen.effects)}")
            after = _compared(current, chosen.trial, excluded, report)
            step = _saved(diagnosis, chosen, current, after, source, compared.choice)
            steps.append(step)
            current, source = after, step.version.head


@dataclass(frozen=True)
class _Choice:
    """An addition: `effects` are those that are new in `trial`."""

    trial: RefittedSet
    effects: tuple[str, ...]
    delta_bic: float
    addition: Addition


@dataclass
class _Round:
    """The consequences of one diagnosis: `plan` lists the additions, and is empty if there are none."""

    first: bool
    room: int
    sure: bool
    unless: Callable[[Diagnosis], bool]
    unsure: bool = False
    plan: list[_Choice] = field(default_factory=list)
    refused: Refusal | None = None

    def shown(self, diagnosis: Diagnosis) -> bool:
        """Plan the additions; whether this is the first or the last diagnosis, whose laws are shown."""
        unsure = self.sure and diagnosis.verdict in (Verdict.AMBIGUOUS, Verdict.OUTSIDE_LIBRARY)
        stopped = self.first and diagnosis.verdict is not Verdict.ADEQUATE and self.unless(diagnosis)
        self.unsure = unsure or stopped
        self.plan = [] if self.unsure else _plan(diagnosis, self.room)
        for number, choice in enumerate(self.plan):
            refused = refusal(diagnosis, choice.trial, choice.effects)
            if refused is not None:
                self.plan = self.plan[:number]
                self.refused = refused if not number else None
                break
        return self.first or not self.plan


_ENDS: Mapping[type[Refusal], ImprovementEnd] = {
    TooLargeForSensor: ImprovementEnd.IMPLAUSIBLE,
    NotImproved: ImprovementEnd.NOT_PREDICTED,
}


def refusal(diagnosis: Diagnosis, trial: RefittedSet, effects: Sequence[str]) -> Refusal | None:
    """Why effects are not added although they lower mBIC; None if they may be.

    A size that nothing of their kind has; or an error that does not fall on data outside the fit: on the
    records that were held out, else on the conditions left out in turn, or on blocks of time and the second
    half of every record where only the floor of the noise is known or no condition can be left out.
    """
    absurd = not_a_sensor(trial)
    if absurd:
        return absurd[0]
    # Best of all, records that no fit has seen; else conditions left out in turn, if the noise is known; else
    # blocks of time and the second half. See decision 149.
    before = diagnosis.before.fit
    if before.held_out:
        worse = _held_out_squares(trial.fit) >= _held_out_squares(before)
        outside = NotImproved(tuple(effects), "held_out", len(before.held_out))
    else:
        own = bool(before.problem.noise.own_scale)
        shown = [one for one in diagnosis.ranking if one.effect in effects]
        conditions = [one for one in shown if math.isfinite(one.heldout_before)]
        if conditions and not own:
            worse = any(one.heldout_after > one.heldout_before for one in conditions)
            outside = NotImproved(tuple(effects), "conditions")
        else:
            blocks = leave_blocks_out(before, trial.fit, ahead=True)
            worse = blocks is not None and not (blocks.falls and (blocks.passed or not own))
            outside = NotImproved(tuple(effects), "blocks")
    return outside if worse else None


def _held_out_squares(fitted: FitResult) -> float:
    """Sum over the channels: mean squared error on the held-out records, in units of the noise."""
    return sum(error.nrmse**2 for error in fitted.heldout_errors.values())


def _plan(diagnosis: Diagnosis, room: int) -> list[_Choice]:
    """The effects of the best set in the order in which they are added.

    Empty if nothing is missing, or that is not decided; also if the set does not lower mBIC, or exceeds
    `room`.

    First the one that gains most by itself, then the set; all at once if its members improve only together.
    """
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED) or diagnosis.doubt:
        return []
    sets = RefittedSets(diagnosis.before, diagnosis.before.whole)
    best, nothing = diagnosis.best, sets.mbic(sets.null)
    if not best.candidates or len(best.candidates) > room or sets.mbic(best) >= nothing:
        return []
    singles = [_single(diagnosis, member) for member in best.candidates] if len(best.candidates) > 1 else []
    first = min((one for one in singles if one is not None), key=sets.mbic, default=None)
    if first is None or sets.mbic(first) >= nothing:
        difference = sets.mbic(best) - nothing
        return [_Choice(best, best.effects, difference, _addition(diagnosis, best, best.effects))]
    gained = sets.mbic(first) - nothing
    rest = tuple(name for name in best.effects if name not in first.effects)
    more = sets.mbic(best) - sets.mbic(first)
    return [
        _Choice(first, first.effects, gained, _addition(diagnosis, first, first.effects)),
        _Choice(best, rest, more, _addition(diagnosis, best, rest)),
    ]


def _single(diagnosis: Diagnosis, member: Candidate) -> RefittedSet | None:
    """One member of the best set by itself, refitted unless that was done already."""
    known = [trial for trial in diagnosis.trials if trial.candidates == (member,)]
    return known[0] if known else refit(diagnosis.before.fit, (member,))


def _addition(diagnosis: Diagnosis, trial: RefittedSet, effects: tuple[str, ...]) -> Addition:
    """What there is to say of `effects`, the new ones in `trial`."""
    alike = [names for names in diagnosis.classes if len(names) > 1 and set(names) & set(effects)]
    later = len(diagnosis.best.effects) > len(trial.effects)
    return Addition(
        members=tuple(
            (candidate.effect, found_parameters(trial, candidate))
            for candidate in trial.candidates
            if candidate.name in effects
        ),
        following=tuple(name for name in diagnosis.best.effects if later and name not in trial.effects),
        unusual=tuple(text for name, text in trial.unusual.items() if name in effects),
        alike=alike[0][1:] if alike else (),
        nearest=diagnosis.verdict is Verdict.OUTSIDE_LIBRARY,
    )


def _why(diagnosis: Diagnosis, room: int) -> ImprovementEnd:
    if diagnosis.doubt or diagnosis.verdict is Verdict.UNDECIDED:
        return ImprovementEnd.NOT_DECIDED
    if diagnosis.verdict is Verdict.ADEQUATE:
        return ImprovementEnd.ADEQUATE
    return (
        ImprovementEnd.MAX_EFFECTS if len(diagnosis.best.candidates) > room else ImprovementEnd.NOTHING_HELPS
    )


def _compared(
    current: ModelComparison, trial: RefittedSet, excluded: Collection[str], on_progress: OnProgress
) -> ModelComparison:
    """The model with a trial's effects on the same data."""
    fitted = fit_again(current.fit, trial.fit.model, on_progress=on_progress)
    return judge(fitted, current.name, excluded=excluded, on_progress=on_progress)


def _saved(
    diagnosis: Diagnosis,
    chosen: _Choice,
    before: ModelComparison,
    after: ModelComparison,
    source: Path,
    choice: Choice,
) -> Step:
    """Save the model with the effects as the next version, and report the change of the error."""
    before_error, after_error = model_error(before.fit), model_error(after.fit)
    change = Change(
        "add",
        effect=", ".join(chosen.effects),
        runs=tuple(diagnosis.runs),
        hold_out=choice.hold_out,
        only=choice.only,
        assume=choice.assume,
        before=before_error,
        after=after_error,
        note=chosen.addition.reason,
    )
    model = replace(after.fit.model, text=load_model(source).text)
    version = save_version(model, source, change)
    return Step(
        chosen.effects,
        diagnosis,
        chosen.addition,
        chosen.delta_bic,
        before_error,
        after_error,
        version,
        after,
    )
