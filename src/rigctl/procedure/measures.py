"""A measure's expression: read, and checked to have the dimension of the unit it is kept in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions import Expression, ValueType, parse, type_of_unit
from rigctl.procedure.statistics import DURATION, STATISTICS, Statistic, find_statistics
from rigctl.procedure.values import Variables, substituted
from rigctl.units import describe, parse_unit


@dataclass(frozen=True, slots=True)
class ReadMeasure:
    """What a measure's text means; with `difference`, its value is an interval of temperatures."""

    expression: Expression
    statistics: tuple[Statistic, ...]
    difference: bool


def read_measure(
    text: str,
    unit: str,
    signals: Mapping[str, ValueType],
    answers: Mapping[str, ValueType],
    variables: Variables,
) -> ReadMeasure:
    """The expression of a measure and the statistics it needs.

    Parameters
    ----------
    text: as written, e.g. ``max(position) - min(position)``.
    unit: what the value is kept in.
    signals: the channels and commands that statistics can be taken of.
    answers: earlier measures and operators' answers, which the expression can name.
    variables: what ``$names`` stand for.

    Raises
    ------
    RigctlError
        not readable, a name that does not exist, a channel without a statistic, or another dimension.
    """
    rewritten, statistics = find_statistics(text)
    for statistic in statistics:
        if statistic.channel not in signals:
            raise unknown_name("channel", statistic.channel, signals)
    types = {**answers, DURATION: type_of_unit("s")}
    types.update({statistic.key: _type_of(statistic, signals[statistic.channel]) for statistic in statistics})
    expression = substituted(parse(rewritten), variables)
    for name in sorted(expression.names):
        if name in signals and name not in types:
            kinds = ", ".join(f"{kind}({name})" for kind in STATISTICS)
            raise RigctlError(
                "a measure needs one value of a channel", value=name, expected=f"one of {kinds}"
            )
    found = expression.check(types)
    wanted = parse_unit(unit).dimension
    if not isinstance(found, ValueType) or found.dimension != wanted:
        raise RigctlError(
            "the value does not have the dimension of its unit", value=text, expected=describe(unit)
        )
    return ReadMeasure(expression, statistics, found.temperature == "difference")


def _type_of(statistic: Statistic, signal: ValueType) -> ValueType:
    if statistic.difference and signal.temperature is not None:
        return ValueType(signal.dimension, "difference")
    return signal
