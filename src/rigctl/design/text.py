"""A designed experiment in words: what it distinguishes, how reliably, and why each record is taken."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.design.result import NONE, WITHOUT_EFFECT, DesignResult, PredictedPower, SensorSet
from rigctl.effects.declaration import Effect
from rigctl.effects.registry import library
from rigctl.notebook import worded
from rigctl.planning.outline import clock_time
from rigctl.units import significant
from rigctl.wording import listed

#: a set with a lower probability than this is no answer
HALF = 0.5
#: more explanations than these are counted, not named
_NAMED = 2


def share(probability: float) -> str:
    """A probability in per cent, rounded to whole numbers, but never to 0 or 100."""
    if probability > 0.99:
        return "over 99 %"
    return f"{100.0 * probability:.0f} %" if probability >= 0.01 else "under 1 %"


def title(design: DesignResult) -> str:
    """The answer as a short title."""
    if design.aim == "precision":
        return "To determine its size"
    return "Next" if design.separable else "Not distinguishable on this bench"


def statement(design: DesignResult) -> str:
    """The answer in a sentence or two."""
    if design.aim == "precision":
        return _precision(design)
    if design.aim == "detection":
        return _detection(design)
    called = design.explanations
    named = list(dict.fromkeys(called[name][0] for pair in design.separates for name in pair))
    names = listed(named) if len(named) <= _NAMED else f"these {len(named)} explanations"
    if not design.records:
        return (
            f"no record that this bench can make distinguishes {names}{_sensor(design)}{_calibration(design)}"
        )
    together = [pair for pair in design.separates if _least(design, pair) < HALF]
    chance = f"with a probability of {share(design.after)}, now {share(design.before)}"
    if design.separable:
        tells = "tells" if len(design.records) == 1 else "tell"
        return f"{_amount(design)} {tells} {names} apart {chance}"
    what = f"the right one of {names} would be identified {chance}, by {_amount(design)}"
    remainder = f"; {_not_distinguished(design, together)}" if together else ""
    return f"{what}{remainder}{_sensor(design)}{_calibration(design)}"


def explanations_in_words(design: DesignResult) -> list[str]:
    """Each explanation as a sentence with its name in brackets, and its probability so far."""
    known: dict[str, Effect] = {}
    if design.diagnosis is not None:
        model = design.diagnosis.before.fit.problem.model
        known = {**library(model.family), **{one.name: one for one in model.own_effects}}
    texts = []
    for together, weight in dict.fromkeys(design.explanations.values()):
        names = together.split(" with ")
        said = [known[name].described if name in known else name for name in names]
        said = [WITHOUT_EFFECT if name == NONE else name for name in said]
        texts.append(" with ".join(said) + (f", {share(weight)}" if weight else ""))
    return texts


def _sensor(design: DesignResult) -> str:
    """What a sensor would add, of those that the rig file names."""
    one = design.sensor
    if one is None:
        return ""
    tells = f"with {_named(one)}, the same records and a repeat of the earlier ones would identify it"
    if one.probability < HALF:
        tells = f"an additional sensor would not suffice either: {tells}"
    return f"; {tells} with a probability of {share(one.probability)}"


def _calibration(design: DesignResult) -> str:
    """What a better calibration would decide, where sensors may be wrong as stated."""
    diagnosis = design.diagnosis
    if diagnosis is None or not diagnosis.instead_of_sensors or not diagnosis.decided_by:
        return ""
    return "; " + worded(diagnosis.decided_by[0], "decided_by.decision")


def _least(design: DesignResult, pair: tuple[str, str]) -> float:
    """The smaller of the probabilities that the two are distinguished, whichever of them is right."""
    return min(one.after for one in design.outlooks if {one.truth, one.rival} == set(pair))


def _not_distinguished(design: DesignResult, together: Sequence[tuple[str, str]]) -> str:
    distinguished = len(design.separates) - len(together)
    if len(together) > 1 and not distinguished:
        return "not reliably distinguished: any two of them"
    without, _ = design.explanations.get(NONE, (NONE, 0.0))
    pairs = ", ".join(" and ".join(without if name == NONE else name for name in pair) for pair in together)
    others = f"; the other {distinguished} pairs would be distinguished" if distinguished > 1 else ""
    return f"not reliably distinguished: {pairs}{others}"


def _named(one: SensorSet) -> str:
    price = "" if one.price is None else f" (about {one.price:g} {one.currency})"
    return f"{' and '.join(one.channels)}{price}"


def repeats_with(one: SensorSet) -> str:
    """The power of the records so far, taken again with a sensor."""
    tells = f"with {_named(one)}, a repeat of the records so far would identify the right one "
    tells += "with a probability of "
    if one.probability < HALF:
        return f"An additional sensor would not suffice either: {tells}{share(one.probability)}"
    return f"{tells[0].upper()}{tells[1:]}{share(one.probability)}"


def _detection(design: DesignResult) -> str:
    names = " or ".join(one.truth for one in design.outlooks)
    if not design.records:
        return f"no record that this bench can make shows {names} at its usual size"
    shows = "shows" if len(design.records) == 1 else "show"
    return (
        f"{_amount(design)} {shows} {names}, at its usual size, with a probability of {share(design.after)}, "
        f"now {share(design.before)}"
    )


def _precision(design: DesignResult) -> str:
    names = design.rivals[0].effects
    name = " and ".join(names or design.rivals[0].name.split(" + "))
    missing = f"{name} {'is' if len(names) < 2 else 'are'} what is missing; " if names else ""
    if not design.records:
        return f"{missing}no record that this bench can make improves the estimate of the size of {name}"
    gains = ", ".join(
        f"{one.name.partition('.')[2]} ± {significant(one.before, 3)} {one.unit} becomes "
        f"± {significant(one.after, 3)} {one.unit}"
        for one in design.sharpened
    )
    improves = "improves" if len(design.records) == 1 else "improve"
    return f"{missing}{_amount(design)} {improves} the estimate of the size of {name}: {gains} (95 %)"


def _amount(design: DesignResult) -> str:
    count, rows = len(design.records), not design.duration
    what = f"{count} {'row' if rows else 'record'}{'' if count == 1 else 's'}"
    return what if rows else f"{what} of {clock_time(design.duration)} of bench time"


def header(design: DesignResult) -> list[str]:
    """The comment at the head of the procedure."""
    runs = ", ".join(design.runs)
    answer = f"{title(design)}: {design.statement}."
    lines = ["Written by 'rigctl design'.", answer, f"Designed for the model '{design.model}' on {runs}."]
    return lines + [outlook_text(one) for one in design.outlooks]


def outlook_text(one: PredictedPower) -> str:
    """The prediction for one pair."""
    rival = WITHOUT_EFFECT if one.rival == NONE else one.rival
    return (
        f"If {one.truth} is right, it is distinguished from {rival} with a probability of "
        f"{share(one.after)}: expected gain D = {significant(one.separation, 3)} "
        f"± {significant(one.spread, 2)}."
    )


def reason(design: DesignResult, number: int) -> list[str]:
    """The comment above a record of the procedure: what it adds, compared with a repeat."""
    one = design.records[number]
    first = f"Record {number + 1}: {one.why}."
    if design.aim == "precision":
        return [first]
    chance = f"The probability changes from {share(one.before)} to {share(one.after)}"
    return [first, f"{chance}; {clock_time(one.duration)} of bench time."]


def added(separation: float, of_repeat: float, *, precision: bool) -> str:
    """What a record adds, compared with a repeat of an earlier one."""
    what = "the logarithm of the precision of the size" if precision else "D"
    repeat = f"the best repeat of an earlier record would add {significant(of_repeat, 3)}"
    return f"{what} increases by {significant(separation, 3)}; {repeat}"
