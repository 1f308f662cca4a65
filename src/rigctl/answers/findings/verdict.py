"""The verdict of a diagnosis in sentences.

In: a `Diagnosis` and its `Conclusion`, which has one class for each kind of result. Out: a `Statement`: the
opening names the effects and what is uncertain, the text adds what they are and what they leave. There is
one branch for each class, and no threshold is applied here except for wording: a sentence that is too
certain would be a fault of the conclusion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rigctl.analysis.comparison_result import offset_of_clock
from rigctl.analysis.conclusion import (
    AsCompared,
    Conclusion,
    Doubt,
    Doubtful,
    Member,
    Missing,
    MostlyWithinTolerance,
    Nearest,
    NothingNamed,
    NotProven,
    OneOfSeveral,
    OneOfTable,
    WithinTolerance,
)
from rigctl.analysis.decision_levels import SHAPE_TOLERANCE
from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter, Ranked, Verdict
from rigctl.analysis.search.reasons import OnlyEdgesSearched, Reason
from rigctl.analysis.search.rivals import Rival
from rigctl.answers.findings import agreement
from rigctl.answers.findings.reasons import (
    edges_text,
    inside_text,
    not_predicted_text,
    reason_text,
    reasons_text,
    remainder_text,
)
from rigctl.effects.declaration import Effect
from rigctl.model.fit.fit import FitResult
from rigctl.model.reading_errors import CLOCK
from rigctl.noise import ChannelNoise
from rigctl.units import show
from rigctl.wording import chance_text, share_text, strength

_CANNOT_TELL = "Something is missing, and these data cannot tell which effect it is"


#: p-value below which what effects at the edges of a program leave is said in any case
_CERTAINLY_LEFT = 1e-6


@dataclass(frozen=True)
class Statement:
    """A verdict in words.

    Attributes
    ----------
    opening: what is missing, by name, and what is uncertain about it.
    text: the same with a description of the effects, and what they leave.
    """

    opening: str
    text: str


def statement(diagnosis: Diagnosis) -> str:
    """The verdict in words."""
    return _of(diagnosis).text


def opening(diagnosis: Diagnosis) -> str:
    """The first clause or two of it, with the effects by name."""
    return _of(diagnosis).opening


def doubt_text(diagnosis: Diagnosis) -> str:
    """Why these data cannot tell whether anything is missing at all; "" if they can."""
    return _doubt(diagnosis.doubt, diagnosis.model)


def _of(diagnosis: Diagnosis) -> Statement:
    """The statement, with what was not searched where nothing is named for it."""
    # Where the model is an FMU, only its edges are searched. What is named there may stand for something
    # inside, so the answer says so: always where nothing in the library explains it, and for named effects
    # only where what is left is beyond doubt no noise.
    said = _concluded(diagnosis)
    program = diagnosis.before.fit.problem.model.family.program
    if program is None:
        return said
    p_value = diagnosis.p_value_after
    if diagnosis.effects and diagnosis.remainder is None and p_value < _CERTAINLY_LEFT:
        text = f"{said.text}. That is not all: what is left is not noise ({chance_text(p_value)})"
        return Statement(said.opening, text)
    if diagnosis.verdict is not Verdict.OUTSIDE_LIBRARY:
        return said
    edges = OnlyEdgesSearched.of(program)
    unsearched = f"{_capitalised(edges_text(edges))}, and {inside_text(edges)}"
    return Statement(f"{said.opening}. {unsearched}", f"{said.text}. {unsearched}")


def _concluded(diagnosis: Diagnosis) -> Statement:
    found, before = diagnosis.conclusion, diagnosis.before
    match found:
        case AsCompared():
            text = _as_compared(diagnosis)
        case WithinTolerance(laws, p_value):
            text = (
                "Nothing more is missing that these data show: the model does not agree with the "
                f"measurements ({chance_text(p_value)}), but what is left is within "
                f"{share_text(SHAPE_TOLERANCE)} of the law of {' and '.join(laws)}, by which a bench may "
                "deviate from it"
            )
        case MostlyWithinTolerance(laws, nearest, beyond):
            text = (
                "Something is missing, but these data do not show what. Most of it is within "
                f"{share_text(SHAPE_TOLERANCE)} of the law of {' and '.join(laws)}, by which a bench may "
                f"deviate from it; not all of it is. The nearest in the library is {' and '.join(nearest)}, "
                f"but such deviations explain all but {share_text(beyond)} of what it explains"
            )
        case NotProven():
            best = diagnosis.best
            text = _unproven_text(before.fit, best.fit if best.candidates else None, best.effects)
        case _:
            return worded(found, _doubt(diagnosis.doubt, diagnosis.model))
    return Statement(text, text)


def _as_compared(diagnosis: Diagnosis) -> str:
    """The statement of the comparison, or why slow noise cannot be told from an effect."""
    before, doubt = diagnosis.before, diagnosis.doubt
    if doubt is not None and doubt.reason == "beyond_bounds":
        return _doubt(doubt, diagnosis.model)
    open_question = diagnosis.verdict is Verdict.UNDECIDED and not before.adequacy.below_noise
    if open_question and not before.adequacy.unusable:
        return agreement.undecided_text(before.fit, before.name, before.adequacy.unproven)
    return agreement.statement(before)


def worded(found: Conclusion, doubt: str = "") -> Statement:
    """The statement of a conclusion about effects; `doubt` says why nothing at all may be missing."""
    # Each branch gives the first clause, which names effects, and the text, which describes them. What is
    # left over is added below, to those that name effects and leave something.
    match found:
        case NothingNamed(visible):
            text = _unnamed_text(visible, doubt)
            return Statement(text, text)
        case OneOfTable():
            return Statement(_CANNOT_TELL, _of_table(found))
        case Nearest(members):
            several, names = len(members) > 1, _names(members)
            first, referring = (
                _outside_text(nearest, found, doubt)
                for nearest in (names, "these" if several and found.left is not None else "this")
            )
            return Statement(first, f"{referring}: {_described(members)}")
        case Missing(members, alike, left):
            first, text = f"{_names(members)} is missing", _described(members)
            if alike is not None:
                text += f". {_capitalised(rival_sentence(alike))}"
        case OneOfSeveral(members, rivals, against, left):
            first = _CANNOT_TELL
            said = (*map(rival_sentence, rivals), *reasons_text(against))
            text = ". ".join([f"{first}. Most probable: {_described(members)}", *map(_capitalised, said)])
        case Doubtful(members, against, left):
            first = _doubtful_text(_names(members), against)
            text = f"{_doubtful_text('this', against)}: {_described(members)}"
        case _:
            raise AssertionError(found)  # those of the model as compared, which need the diagnosis
    if left is not None:
        text += f". That is not all: {remainder_text(left)}"
    return Statement(first, text)


def _names(members: Sequence[Member]) -> str:
    return " and ".join(effect.name for effect, _ in members)


def _described(members: Sequence[Member]) -> str:
    return ". ".join(effect_text(effect, parameters) for effect, parameters in members)


def parameters_text(parameters: Mapping[str, FoundParameter]) -> str:
    """``conductance 4e-15 ± 1e-16 m^3``."""
    return ", ".join(f"{name} {one}" for name, one in parameters.items())


def effect_text(effect: Effect, parameters: Mapping[str, FoundParameter]) -> str:
    """The symptom, the effect, and its parameters, as one clause."""
    symptom, summary = effect.looks_like.rstrip("."), effect.summary.rstrip(".")
    text = f"{symptom}: {_lower_case_start(summary)}" if symptom else summary
    return f"{text} ({effect.name}, {parameters_text(parameters)})"


def _of_table(found: OneOfTable) -> str:
    """All effects that explain a table."""
    explanations = "; ".join(
        f"{effect.summary.rstrip('.')} ({effect.name}"
        + (")" if parameters is None else f", {parameters_text(parameters)})")
        for effect, parameters in found.effects
    )
    return (
        f"Something is missing, and these {found.values} values cannot tell which of {len(found.effects)} "
        f"effects it is: {explanations}"
    )


def _doubt(doubt: Doubt | None, model: str) -> str:
    if doubt is None:
        return ""
    if doubt.reason == "guessed_noise":
        return f"these data do not determine the noise of {', '.join(doubt.channels)}"
    if doubt.reason == "below_noise":
        return "the error of every channel is below its noise, so the noise must be smaller than assumed"
    if doubt.reason == "within_noise":
        return "the error of every channel is within its noise"
    values = " and ".join(f"{name} at {show(value, unit)}" for name, value, unit in doubt.values)
    return (
        f"with {values}, beyond its bound, {model} agrees with the measurements: nothing else need be missing"
    )


def _opening_text(doubt: str) -> str:
    """Whether something is missing."""
    if not doubt:
        return "Something is missing"
    return f"A test rejects the model, but {doubt}: these data cannot tell whether something is missing"


def _unnamed_text(visible: Ranked | None, doubt: str) -> str:
    """Something is missing, and no set improves mBIC."""
    first = _opening_text(doubt)
    if visible is not None:
        return (
            f"{first}, but the data show too little of it to identify it: "
            f"{visible.effect} explains more of it than any other effect, but {strength(visible.size)} is "
            "not enough to name it"
        )
    if doubt:
        return f"{first}, and no effect of the library explains it"
    return "Something is missing that no effect of the library explains"


def _outside_text(nearest: str, found: Nearest, doubt: str) -> str:
    """The nearest set, and why it is not named: for what it leaves, or else for what it does not predict."""
    first = _opening_text(doubt)
    if found.left is None:
        return (
            (f"{first}. It would be" if doubt else "What is missing is")
            + " more than two effects of the library, or one that is not in it. The nearest "
            f"is {nearest}, but {not_predicted_text(found.failed)}"
        )
    share = share_text(found.left.share)
    if len(found.members) > 1:
        return (
            f"{first}. The nearest in the library are {nearest}, but they leave {share} of the misfit: "
            "their laws may have different shapes, something else may be missing as well, or they only "
            "resemble what is missing"
        )
    return (
        f"{first}. The nearest in the library is {nearest}, but it leaves {share} of the misfit: its law "
        "may have a different shape, something else may be missing as well, or it only resembles what is "
        "missing"
    )


def _doubtful_text(nearest: str, against: Sequence[Reason]) -> str:
    """The most probable set, and why it is uncertain although no other explains as much."""
    return (
        f"Something is missing. No other effect of the library explains it as well as {nearest}, but "
        f"{', and '.join(map(reason_text, against))}"
    )


def _unproven_text(fit: FitResult, nearest: FitResult | None, effects: Sequence[str]) -> str:
    """Something is missing, whatever the noise is, and no effect proves itself; the nearest one, if any."""
    first = (
        "Something is missing, whatever the noise is: a test that needs no noise level rejects the model. No "
        "effect of the library removes so much of the error, or predicts so well what it was not fitted to, "
        "that it could be named"
    )
    if nearest is None:
        return first
    falls = [_fall(fit, nearest, channel) for channel in fit.problem.noise.channels if channel.own_scale]
    return f"{first}. The nearest is {' and '.join(effects)}: with it {'; '.join(falls)}"


def _fall(fit: FitResult, nearest: FitResult, channel: ChannelNoise) -> str:
    unit = fit.problem.measurements.unit_of(channel.name)
    before, after = (
        show(one.errors[channel.name].rmse, unit, difference=True, digits=2) for one in (fit, nearest)
    )
    falls = nearest.errors[channel.name].rmse <= fit.errors[channel.name].rmse
    return f"the error of {channel.name} {'falls' if falls else 'rises'} from {before} to {after}"


def rival_sentence(rival: Rival) -> str:
    """What else it could be and where the two differ most; `findings.evidence` has all of it."""
    other = f"{rival.name} and {rival.beside} together" if rival.beside else rival.name
    text = f"{other} would look like {rival.member}"
    if rival.unusual:
        text += f" with its {rival.unusual}"
    text += largest_difference(rival)
    return f"{text}, and these data {'' if rival.separable else 'do not '}tell them apart"


def largest_difference(rival: Rival) -> str:
    """The clause on where the two differ most; "" if they predict the same."""
    where = rival.differs
    if where is None:
        return ""
    most = f" at {where.condition}" if where.condition else ""
    return (
        f"; the two differ most in {where.channel}{' in ' if where.phase else ''}{where.phase}, by up to "
        f"{abs(where.largest):.2g} {where.unit}{most}"
    )


def _lower_case_start(text: str) -> str:
    """With a lower-case first letter, for use within a sentence."""
    return text[:1].lower() + text[1:] if text[1:2].islower() or text[:2] == "A " else text


def _capitalised(text: str) -> str:
    """With an upper-case first letter, unless the text begins with a name."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]


def title(diagnosis: Diagnosis) -> str:
    """The verdict as a short title."""
    # The order matters: several named effects are a verdict of their own; any doubt then takes precedence
    # over every other title, and an error of a sensor over "adequate".
    if diagnosis.verdict is Verdict.MISSING_EFFECT and len(diagnosis.effects) > 1:
        return f"{len(diagnosis.effects)} effects are missing"
    if diagnosis.contradicted or diagnosis.doubt or diagnosis.verdict is Verdict.UNDECIDED:
        return "Not decided"
    if diagnosis.before.adequacy.only_misread and not diagnosis.effects:
        exact = diagnosis.with_exact_sensors
        what = "A clock is off" if diagnosis.before.explained_by == CLOCK else "A sensor reads wrongly"
        return what + (", or an effect is missing" if exact and exact.effects else "")
    if diagnosis.before.explained_by and diagnosis.verdict is Verdict.ADEQUATE:
        return f"Adequate within the stated {offset_of_clock(diagnosis.before.explained_by)}"
    return {
        Verdict.ADEQUATE: "Adequate",
        Verdict.MISSING_EFFECT: "An effect is missing",
        Verdict.AMBIGUOUS: "Ambiguous",
        Verdict.OUTSIDE_LIBRARY: "Outside the library",
    }[diagnosis.verdict]
