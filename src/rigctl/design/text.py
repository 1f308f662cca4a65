"""A designed experiment in words: what it distinguishes, how reliably, and why each record is taken."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.design.result import DesignResult, PredictedPower, SensorSet
from rigctl.planning.outline import clock_time
from rigctl.units import significant

#: a set with a lower probability than this is no answer
HALF = 0.5


def share(probability: float) -> str:
    """A probability in per cent, rounded to whole numbers, but never to 0 or 100."""
    if probability > 0.99:
        return "over 99 %"
    return f"{100.0 * probability:.0f} %" if probability >= 0.01 else "under 1 %"


def title(found: DesignResult) -> str:
    """The answer as a short title."""
    if found.aim == "precision":
        return "To know its size"
    return "Next" if found.separable else "Not distinguishable on this bench"


def statement(found: DesignResult) -> str:
    """The answer in a sentence or two."""
    if found.aim == "precision":
        return _precision(found)
    if found.aim == "detection":
        return _detection(found)
    called = found.explanations
    names = _listed(list(dict.fromkeys(called[name][0] for pair in found.separates for name in pair)))
    if not found.records:
        return f"no record that this bench can make distinguishes {names}{_sensor(found)}"
    together = [pair for pair in found.separates if _least(found, pair) < HALF]
    chance = f"with a probability of {share(found.after)}, now {share(found.before)}"
    if found.separable:
        tells = "tells" if len(found.records) == 1 else "tell"
        return f"{_amount(found)} {tells} {names} apart {chance}"
    what = f"the right one of {names} would be identified {chance}, by {_amount(found)}"
    left = f"; {_left(found, together)}" if together else ""
    return f"{what}{left}{_sensor(found)}"


def _sensor(found: DesignResult) -> str:
    """What a sensor would add, of those that the rig file names."""
    one = found.sensor
    if one is None:
        return ""
    tells = f"with {_named(one)} the same records, and those so far taken again, would"
    if one.probability < HALF:
        return f"; an additional sensor would not suffice either: {tells} reach {share(one.probability)}"
    return f"; {tells} identify it with a probability of {share(one.probability)}"


def _least(found: DesignResult, pair: tuple[str, str]) -> float:
    """The smaller of the probabilities that the two are distinguished, whichever of them is right."""
    return min(one.after for one in found.outlooks if {one.truth, one.rival} == set(pair))


def _left(found: DesignResult, together: Sequence[tuple[str, str]]) -> str:
    pairs = ", ".join(f"{one} and {other}" for one, other in together)
    told = len(found.separates) - len(together)
    others = f"; the other {told} pairs would be distinguished" if told > 1 else ""
    return f"not reliably distinguished: {pairs}{others}"


def _named(one: SensorSet) -> str:
    price = "" if one.price is None else f" (about {one.price:g} {one.currency})"
    return f"{' and '.join(one.channels)}{price}"


def repeats_with(one: SensorSet) -> str:
    """The power of the records so far, taken again with a sensor."""
    tells = f"with {_named(one)} the records so far, taken again, would identify the right one "
    tells += "with a probability of "
    if one.probability < HALF:
        return f"An additional sensor would not suffice either: {tells}{share(one.probability)}"
    return f"{tells[0].upper()}{tells[1:]}{share(one.probability)}"


def _detection(found: DesignResult) -> str:
    names = " or ".join(one.truth for one in found.outlooks)
    if not found.records:
        return f"no record that this bench can make shows {names} at its usual size"
    shows = "shows" if len(found.records) == 1 else "show"
    return (
        f"{_amount(found)} {shows} {names}, at its usual size, with a probability of {share(found.after)}, "
        f"now {share(found.before)}"
    )


def _precision(found: DesignResult) -> str:
    names = found.rivals[0].effects
    name = " and ".join(names or found.rivals[0].name.split(" + "))
    begun = f"{name} {'is' if len(names) < 2 else 'are'} what is missing; " if names else ""
    if not found.records:
        return f"{begun}no record that this bench can make improves the estimate of the size of {name}"
    gains = ", ".join(
        f"{one.name.partition('.')[2]} ± {significant(one.before, 3)} {one.unit} becomes "
        f"± {significant(one.after, 3)} {one.unit}"
        for one in found.sharpened
    )
    improves = "improves" if len(found.records) == 1 else "improve"
    return f"{begun}{_amount(found)} {improves} the estimate of the size of {name}: {gains} (95 %)"


def _amount(found: DesignResult) -> str:
    count, rows = len(found.records), not found.duration
    what = f"{count} {'row' if rows else 'record'}{'' if count == 1 else 's'}"
    return what if rows else f"{what} of {clock_time(found.duration)} of bench time"


def header(found: DesignResult) -> list[str]:
    """The comment at the head of the procedure."""
    runs = ", ".join(found.runs)
    answer = f"{title(found)}: {found.statement}."
    lines = ["Written by 'rigctl design'.", answer, f"Designed for the model '{found.model}' on {runs}."]
    return lines + [outlook_text(one) for one in found.outlooks]


def outlook_text(one: PredictedPower) -> str:
    """The prediction for one pair."""
    return (
        f"If {one.truth} is right, it is distinguished from {one.rival} with {share(one.after)}: "
        f"expected gain D = {significant(one.separation, 3)} ± {significant(one.spread, 2)}."
    )


def reason(found: DesignResult, number: int) -> list[str]:
    """The comment above a record of the procedure: what it adds, compared with a repeat."""
    one = found.records[number]
    first = f"Record {number + 1}: {one.why}."
    if found.aim == "precision":
        return [first]
    chance = f"The probability changes from {share(one.before)} to {share(one.after)}"
    return [first, f"{chance}; {clock_time(one.duration)} of bench time."]


def added(separation: float, of_repeat: float, *, precision: bool) -> str:
    """What a record adds, compared with a repeat of an earlier one."""
    what = "the logarithm of the precision of the size" if precision else "D"
    repeat = f"the best repeat of an earlier record would add {significant(of_repeat, 3)}"
    return f"{what} increases by {significant(separation, 3)}; {repeat}"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
