"""A designed experiment in words: what it distinguishes, how reliably, and why each record is taken.

In: a `DesignResult`. Out: sentences, for the answer and for the comments of the procedure file, so that
whoever runs it reads the same. The cases follow from the aim: to distinguish explanations, to detect one
effect at all, or to determine its size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.answers.findings.decided_by import decision
from rigctl.answers.numbers import probability
from rigctl.design.result import (
    HALF,
    NONE,
    DesignResult,
    Explanation,
    PredictedPower,
    ProposedRecord,
    SensorSet,
)
from rigctl.effects.declaration import Effect
from rigctl.effects.registry import library
from rigctl.planning.outline import clock_time
from rigctl.units import significant
from rigctl.wording import listed, noun, number_of

#: the model without any of the effects in question, in a sentence
WITHOUT_EFFECT = "the model without an effect"
#: the explanation without an effect where sensors may be wrong as stated
_SENSORS = "an error of the sensors"
#: more explanations than these are counted, not named
_NAMED = 2


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
    pairs = design.separates
    named = list(dict.fromkeys(_called(design, design.explanations[name]) for pair in pairs for name in pair))
    names = listed(named) if len(named) <= _NAMED else f"these {len(named)} explanations"
    if not design.records:
        return (
            f"no record that this bench can make distinguishes {names}{_sensor(design)}{_calibration(design)}"
        )
    # A pair is distinguished only if it is so whichever of the two is right: the power is not symmetric,
    # since each rival is refitted to the other's data.
    together = [pair for pair in pairs if _least(design, pair) < HALF]
    chance = f"with a probability of {probability(design.after)}, now {probability(design.before)}"
    if design.separable:
        return f"{_amount(design)} {noun(len(design.records), 'tells', 'tell')} {names} apart {chance}"
    what = f"the right one of {names} would be identified {chance}, by {_amount(design)}"
    remainder = f"; {_not_distinguished(design, together)}" if together else ""
    return f"{what}{remainder}{_sensor(design)}{_calibration(design)}"


def explanations_in_words(design: DesignResult) -> list[str]:
    """Each explanation as a sentence with its name in brackets, and its probability so far."""
    known: dict[str, Effect] = {}
    if design.diagnosis is not None:
        model = design.diagnosis.before.fit.problem.model
        known = {**library(model.family), **{one.name: one for one in model.own_effects}}
    names = {one.name: known[one.name].described for one in design.rivals if one.name in known}
    if not _sensors_instead(design):
        names[NONE] = WITHOUT_EFFECT
    return [
        _called(design, one, names) + (f", {probability(one.weight)}" if one.weight else "")
        for one in dict.fromkeys(design.explanations.values())
    ]


def _called(design: DesignResult, one: Explanation, names: Mapping[str, str] | None = None) -> str:
    """An explanation by its names: ``a with b``."""
    called = ({NONE: _SENSORS} if _sensors_instead(design) else {}) | dict(names or {})
    return " with ".join(called.get(name, name) for name in one.effects)


def _sensors_instead(design: DesignResult) -> bool:
    """Whether the explanation without an effect is that sensors are wrong as stated."""
    return design.diagnosis is not None and bool(design.diagnosis.instead_of_sensors)


def _sensor(design: DesignResult) -> str:
    """What a sensor would add, of those that the rig file names."""
    one = design.sensor
    if one is None:
        return ""
    tells = f"with {_named(one)}, the same records and a repeat of the earlier ones would identify it"
    if one.probability < HALF:
        tells = f"an additional sensor would not suffice either: {tells}"
    return f"; {tells} with a probability of {probability(one.probability)}"


def _calibration(design: DesignResult) -> str:
    """What a better calibration would decide, where sensors may be wrong as stated."""
    diagnosis = design.diagnosis
    if diagnosis is None or not diagnosis.instead_of_sensors or not diagnosis.decided_by:
        return ""
    return f"; {decision(diagnosis.decided_by[0])}"


def _least(design: DesignResult, pair: tuple[str, str]) -> float:
    """The smaller of the probabilities that the two are distinguished, whichever of them is right."""
    return min(one.after for one in design.outlooks if {one.truth, one.rival} == set(pair))


def _not_distinguished(design: DesignResult, together: Sequence[tuple[str, str]]) -> str:
    distinguished = len(design.separates) - len(together)
    if len(together) > 1 and not distinguished:
        return "not reliably distinguished: any two of them"
    names = {NONE: _called(design, design.explanations[NONE])} if NONE in design.explanations else {}
    pairs = ", ".join(" and ".join(names.get(name, name) for name in pair) for pair in together)
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
        return f"An additional sensor would not suffice either: {tells}{probability(one.probability)}"
    return f"{tells[0].upper()}{tells[1:]}{probability(one.probability)}"


def _detection(design: DesignResult) -> str:
    names = " or ".join(one.truth for one in design.outlooks)
    if not design.records:
        return f"no record that this bench can make shows {names} at its usual size"
    shows = f"{_amount(design)} {noun(len(design.records), 'shows', 'show')} {names}"
    return (
        f"{shows}, at its usual size, with a probability of {probability(design.after)}, "
        f"now {probability(design.before)}"
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
    improve = f"{_amount(design)} {noun(len(design.records), 'improves', 'improve')}"
    return f"{missing}{improve} the estimate of the size of {name}: {gains} (95 %)"


def _amount(design: DesignResult) -> str:
    if not design.duration:
        return number_of(len(design.records), "row")
    return f"{number_of(len(design.records), 'record')} of {clock_time(design.duration)} of bench time"


def notes(design: DesignResult) -> list[str]:
    """How its probabilities were computed, and why sensors that were asked for are not among them."""
    if design.simulated is None:
        return ["a row's probability is that at the fits, without draws"]
    rivals = len(design.rivals)
    with_each = f"with each of {rivals} rivals" if rivals > 1 else "with it"
    simulated = f"{design.simulated} records were simulated {with_each}"
    no_sensors = "sensors are evaluated only if rivals are to be distinguished"
    left_out = [no_sensors] if design.sensors_left_out else []
    unknown = [f"{name} was not evaluated: {why}" for name, why in design.unknown_sensors.items()]
    return [simulated, *left_out, *unknown]


def summary(design: DesignResult) -> str:
    """The statement, and a line for each record."""
    lines = [
        f"  {settings(one)}: D {significant(one.separation, 3)}, of a repeat {significant(one.of_repeat, 3)}"
        for one in design.records
    ]
    return "\n".join([statement(design), *lines])


def settings(one: ProposedRecord) -> str:
    """The operating point of a record: ``oil 60 degC, supply 30 bar``."""
    return ", ".join(f"{name} {value}" for name, value in one.settings.items())


def procedure(design: DesignResult) -> str:
    """The procedure that takes the records, each with its reason; "" without records, and for rows."""
    recipes = [one.recipe for one in design.records if one.recipe is not None]
    if design.writer is None or not recipes:
        return ""
    return design.writer.text(
        recipes,
        title=f"next for {design.model}",
        description=f"{statement(design)}.",
        why=header(design),
        reasons=[reason(design, number) for number in range(len(recipes))],
    )


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
        f"{probability(one.after)}: expected gain D = {significant(one.separation, 3)} "
        f"± {significant(one.spread, 2)}."
    )


def reason(design: DesignResult, number: int) -> list[str]:
    """The comment above a record of the procedure: what it adds, compared with a repeat."""
    one = design.records[number]
    first = f"Record {number + 1}: {added(design, one)}."
    if design.aim == "precision":
        return [first]
    chance = f"The probability changes from {probability(one.before)} to {probability(one.after)}"
    return [first, f"{chance}; {clock_time(one.duration)} of bench time."]


def added(design: DesignResult, one: ProposedRecord) -> str:
    """What a record adds, compared with a repeat of an earlier one."""
    what = "the logarithm of the precision of the size" if design.aim == "precision" else "D"
    repeat = f"the best repeat of an earlier record would add {significant(one.of_repeat, 3)}"
    return f"{what} increases by {significant(one.separation, 3)}; {repeat}"
