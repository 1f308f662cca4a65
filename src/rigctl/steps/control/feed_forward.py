"""Feed-forward: an output from a formula in the set-point, readings and parameters of a fitted model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigctl.errors import RigctlError
from rigctl.expressions import Expression, ValueType, parse, type_of_unit
from rigctl.files.yaml import read_document
from rigctl.plan.behaviour import Row, StepBench
from rigctl.plan.context import Context
from rigctl.plan.statistics import Stretch
from rigctl.plan.values import substituted
from rigctl.units import Quantity, parse_quantity

#: the name of the set-point in a formula
SETPOINT: Final = "setpoint"


@dataclass(frozen=True, slots=True)
class FeedForward:
    """A formula in channels, commands, measures, answers and the set-point; `constants` are SI, by name."""

    expression: Expression
    constants: Mapping[str, float]

    def on(self, bench: StepBench) -> Callable[[Row, float], float]:
        """Return the formula as a function of a row of readings and the set-point, SI; NaN if undefined."""
        kept = bench.statistics((), Stretch.RECORD, None)  # measures and answers so far
        fixed, columns = {}, {}
        for name in sorted(self.expression.names - {SETPOINT}):
            if name in bench.columns:
                columns[name] = bench.columns[name]
            else:
                fixed[name] = self.constants[name] if name in self.constants else kept[name]

        def value(row: Row, setpoint: float) -> float:
            readings = {name: row[column] for name, column in columns.items()}
            return float(self.expression.evaluate({SETPOINT: setpoint, **fixed, **readings}))

        return value


def read_feed_forward(
    context: Context,
    text: str,
    model: Path | None,
    channel_unit: str,
    actuator_unit: str,
    *,
    difference: bool,
) -> FeedForward:
    """Return a formula of a procedure, after checking it.

    Parameters
    ----------
    model: a model file whose parameters the formula can use, or None. Constants of the rig are always
        available.

    Raises
    ------
    RigctlError
        the formula or the model file cannot be read, a name is unknown, or the dimension is not that of the
        actuator.
    """
    constants: dict[str, float] = {}
    types: dict[str, ValueType] = {}
    for name, amount in {**context.rig.geometry, **context.rig.constants}.items():
        constants[name], types[name] = float(amount), type_of_unit(amount.unit.text or "1")
    for name, quantity in (_parameters(model) if model is not None else {}).items():
        constants[name], types[name] = quantity.si, type_of_unit(quantity.unit.text or "1")
    types |= {**context.answers, **context.types()}
    types[SETPOINT] = type_of_unit(channel_unit, difference=difference)
    expression = substituted(parse(text), context.variables).checked(
        types, expected=type_of_unit(actuator_unit)
    )
    used = expression.names & constants.keys() - context.types().keys() - context.answers.keys()
    return FeedForward(expression, {name: constants[name] for name in sorted(used)})


def _parameters(path: Path) -> dict[str, Quantity]:
    """Return the values of a model file's parameters, fitted or not."""
    document = read_document(path)
    written: Any = document.data
    parameters = written.get("parameters") if isinstance(written, dict) else None
    if not isinstance(parameters, dict):
        raise RigctlError("this model file has no parameters", value=path.name)
    found = {}
    for name, entry in parameters.items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        try:
            found[str(name)] = parse_quantity(str(value))
        except RigctlError as error:
            raise error.at(document.locate(("parameters", name))) from None
        if not math.isfinite(found[str(name)].si):
            raise RigctlError("no number", value=str(value), where=document.locate(("parameters", name)))
    return found
