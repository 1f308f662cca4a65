"""What the records that no fit saw say of a model, in sentences."""

from __future__ import annotations

from rigctl.diagnose.error_course import course_text
from rigctl.diagnose.remedies import Remedy, still_missing
from rigctl.diagnose.unseen_group import Unseen
from rigctl.units import parse_unit

#: one record is named where it holds so much of the misfit
_MOST_OF_IT = 0.4


def unseen_sentences(found: Unseen) -> tuple[str, ...]:
    """How good the model is there; where it is worse, how its error runs, and what would make up for it."""
    errors = ", ".join(
        f"{name} {one['rmse']:.3g} {one['unit']} (fitted {one['fitted_rmse']:.3g}, noise {one['noise']:.3g})"
        for name, one in found.channels().items()
        if one["fitted_rmse"] is not None
    )
    if found.as_good:
        return (f"{_which(found)} the model is as good as where it was fitted: {errors}",)
    parts = [f"{_which(found)} the model misses something; its error there: {errors}"]
    parts += [course_text(found.fit, found.course.get(name, ())) for name in found.worse]
    parts.append(_one_record(found))
    parts += [_remedy(found, one) for one in found.remedies[:1]]
    parts += [_less(one) for one in found.remedies[1:]]
    if found.slot and still_missing(found.remedies):
        parts.append(f"the equation that most wants a term there: {found.slot} ({found.slot_meaning})")
    return tuple(part for part in parts if part)


def _which(found: Unseen) -> str:
    count = len(found.records)
    records = f"{count} record{'' if count == 1 else 's'}"
    if found.why == "hold_out":
        return f"on the {records} held out by '{found.condition}'"
    where = f" with {found.where}" if found.where else ""
    return f"on the {records}{where} that '{found.condition}' left out"


def _one_record(found: Unseen) -> str:
    """The record that holds most of the misfit, where one does."""
    count = len(found.records)
    excess = found.excess()
    largest = max(excess, key=lambda label: excess[label])
    share = max(excess[largest], 0.0) / (sum(max(one, 0.0) for one in excess.values()) or 1.0)
    if count < 2 or share < max(_MOST_OF_IT, 2.0 / count):
        return ""
    return f"{100 * share:.0f} % of it is in one record, {found.called(largest)}"


def _remedy(found: Unseen, one: Remedy) -> str:
    share = f"{100 * one.share:.0f} % of it"
    if one.kind == "starts":
        names = " and ".join(one.names)
        return (
            f"{share} would go away ({_errors(found, one)}) if {names} did not begin at rest: these records "
            "begin after something that they do not show, and what it left behind in the bench is not in the "
            "model. Begin to record before the switch, or leave such records out"
        )
    if one.kind == "values":
        moved = ", ".join(
            f"{name} {before:.3g} to {after:.3g}{'' if unit == '1' else ' ' + unit}"
            for name, before, after, unit in one.moved
        )
        return (
            f"{share} would go away ({_errors(found, one)}) with other values of the same parameters "
            f"({moved}): what they stand for is not the same there"
        )
    return f"of the library, {one.names[0]} alone would take {share} away"


def _less(one: Remedy) -> str:
    what = {
        "starts": f"another start of {' and '.join(one.names)}",
        "values": "other values of the parameters",
    }
    return f"{what.get(one.kind, one.names[0])} alone would take {100 * one.share:.0f} % of it away"


def _errors(found: Unseen, one: Remedy) -> str:
    measurements = found.fit.problem.measurements
    units = dict(zip(measurements.outputs, measurements.units, strict=True))
    told = []
    for name in found.worse:
        unit = parse_unit(units[name])
        told.append(f"{name} to {one.rmse[name] / unit.factor:.3g} {'K' if unit.offset else units[name]}")
    return ", ".join(told)
