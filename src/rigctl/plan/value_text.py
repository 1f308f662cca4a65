"""Times and bindings of plans as text."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.plan.values import Variable


def shown_time(seconds: float) -> str:
    """Return a duration in a unit that keeps it short: ``1.05 s``, ``10 min``, ``2 h``."""
    if seconds >= 3600.0 and seconds % 360.0 == 0.0:
        return f"{seconds / 3600.0:g} h"
    if seconds >= 120.0 and seconds % 30.0 == 0.0:
        return f"{seconds / 60.0:g} min"
    return f"{seconds:g} s"


def shown_variable(value: Variable) -> str:
    """Return the value of a variable as text; a list in its order."""
    return ", ".join(str(item) for item in value) if isinstance(value, tuple) else str(value)


def shown_bindings(variables: Mapping[str, Variable]) -> dict[str, str]:
    """Return the values of variables as texts, by name."""
    return {name: shown_variable(value) for name, value in variables.items()}
