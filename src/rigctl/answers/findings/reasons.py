"""Why a set of effects may not be what is missing, in clauses.

In: `Reason`s, which the search gives where it does not name a set with certainty. Out: one clause each,
which fits into a sentence of a verdict, of an improvement that stopped, or of the evidence.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import assert_never

from rigctl.analysis.laws.answer import LawAnswer
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.own_scale import ErrorLeft, TooLargeForSensor
from rigctl.analysis.search.reasons import (
    MayImitate,
    MayResemble,
    NotPredicted,
    OnlyConstants,
    OnlyEdgesSearched,
    OtherNoise,
    Reason,
    TooMuchLeft,
    UndeterminedSize,
    UnusualSize,
    WantedElsewhere,
)
from rigctl.analysis.search.remainder import STATED, Remainder
from rigctl.answers.findings.laws import law_text
from rigctl.model.fit.reached_bounds import ReachedBound
from rigctl.wording import chance_text, share_text


def reasons_text(reasons: Iterable[Reason]) -> list[str]:
    """A clause for each."""
    return list(map(reason_text, reasons))


def reason_text(reason: Reason) -> str:
    """``viscous_friction does not predict data that it was not fitted to``."""
    # One branch for each class of reason; those that only several effects together can have are in
    # `_of_several`, which the type checker requires to be complete.
    match reason:
        case UnusualSize(effect, parameters):
            text = f"{effect} fits only with its {parameters}"
        case UndeterminedSize(effect):
            text = (
                f"these data do not determine the size of {effect}: its 95 % interval includes no effect at "
                "all"
            )
        case NotPredicted(effects):
            text = not_predicted_text(effects)
        case OtherNoise():
            text = (
                "with it the error is below the noise, yet a test rejects: the noise of these readings "
                "differs from the assumed one"
            )
        case TooMuchLeft(left):
            text = (
                f"what it leaves, {_amount(left)}, is more than a different shape of so small an effect "
                "accounts for"
            )
        case OnlyEdgesSearched():
            text = f"{edges_text(reason)}: one of them describes it, and {inside_text(reason)}"
        case ErrorLeft(share, times):
            text = (
                f"it leaves {100.0 * share:.0f} % of the error, {times:.2g} times the white "
                "noise: something else may be missing, or its law has another shape"
            )
        case TooLargeForSensor(effect, times):
            text = (
                f"{effect} would be {times:.0f} times the noise of a reading, as no sensor's "
                "error is: something with such a memory, or dependence on the reading, is missing elsewhere"
            )
        case ReachedBound():
            text = reason.statement
        case LawAnswer():
            text = law_text(reason)
        case SizeScatter():
            text = scatter_text(reason)
        case _:
            text = _of_several(reason)
    return text


def _of_several(reason: MayResemble | WantedElsewhere | OnlyConstants | MayImitate) -> str:
    """Why several effects that leave something may not be what is missing."""
    match reason:
        case MayResemble(doubtful, certain, left):
            text = (
                f"{' and '.join(doubtful)} may only resemble what is missing besides "
                f"{' and '.join(certain)}: together they leave {_amount(left)} that no other "
                "shape of their laws explains"
            )
        case WantedElsewhere(slot):
            text = f"what they leave points to a term at {slot}, where none of them acts"
        case OnlyConstants():
            text = (
                "none of them depends on a state or an input, yet a misfit is left: together they may "
                "imitate a term that varies"
            )
        case MayImitate(left):
            text = (
                f"together they leave {_amount(left)} that no other shape of their laws explains, and may "
                "imitate an effect that is not in the library"
            )
        case _:
            assert_never(reason)
    return text


def edges_text(searched: OnlyEdgesSearched) -> str:
    """Where effects on a model that a program computes were looked for, and why nowhere else."""
    because = f", because {searched.why}" if searched.why else ""
    return f"only effects at inputs, outputs and parameters of {searched.program} were searched{because}"


def inside_text(searched: OnlyEdgesSearched) -> str:
    """Where the cause may be all the same."""
    return f"the cause may be something else inside {searched.noun}"


def not_predicted_text(effects: Sequence[str]) -> str:
    """Which effects failed cross-validation; "" for none."""
    if not effects:
        return ""
    does = "does not predict data that it was" if len(effects) == 1 else "do not predict data that they were"
    return f"{' and '.join(effects)} {does} not fitted to"


def scatter_text(scatter: SizeScatter) -> str:
    """How the size of an effect varies between records; "" if that is not significant."""
    if scatter.follows:
        return f"the size of {scatter.effect} changes with the operating point, but its law does not"
    if not scatter.asked:
        return ""
    return (
        f"the size of {scatter.effect} scatters from record to record, by about {100.0 * scatter.width:.0f} %"
    )


def _amount(left: Remainder) -> str:
    """How much it is."""
    return f"{share_text(left.share)} of the misfit" if left.size**2 >= STATED else "a detectable pattern"


def remainder_text(left: Remainder) -> str:
    """How much is left, where, over what, and which effect would absorb most of it."""
    chance = chance_text(left.p_value)
    text = f"a test still detects something ({chance}), too weak for its size to be stated"
    if left.size**2 >= STATED:
        text = f"{share_text(left.share)} of the misfit is left ({chance})"
    if left.slot:
        text += f", most of it at {left.slot}"
    if left.over:
        text += f", and it changes over {left.over}"
    if left.effect:
        laws = "their laws" if len(left.beside) > 1 else "the first law"
        text += (
            f". Beside {' and '.join(left.beside)}, {left.effect} absorbs {share_text(left.absorbed)} of "
            f"that: it may be a second effect, or the shape of {laws}"
        )
    return text
