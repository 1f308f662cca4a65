"""Small systems for the engine's tests, and an oracle made from printed equations."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.excitation import Excitation
from rigctl.engine.symbols import Expr, to_text
from rigctl.engine.system import System, SystemBuilder

Floats = NDArray[np.float64]


def lag_builder() -> tuple[SystemBuilder, dict[str, Expr]]:
    """``dx/dt = (gain·u - x)/lag``: exact solutions are exponentials."""
    builder = SystemBuilder()
    names = {
        "x": builder.state("x", "m", scale=1e-2),
        "u": builder.input("u", "m"),
        "gain": builder.parameter("gain", "1", 2.0),
        "lag": builder.parameter("lag", "s", 0.3),
    }
    builder.equation("x", (names["gain"] * names["u"] - names["x"]) / names["lag"])
    builder.output("x", "m", names["x"])
    return builder, names


def lag_record(**changes: object) -> Excitation:
    """Up at 0.5 s, down at 1.25 s, 3 s at 20 Hz."""
    fields: dict[str, object] = {
        "times": np.arange(61) / 20.0,
        "switch_times": [0.0, 0.5, 1.25],
        "inputs": [[0.0], [1.0], [0.0]],
        "initial": [0.0],
        "parameters": [2.0, 0.3],
        "name": "lag",
    }
    return Excitation(**{**fields, **changes})  # type: ignore[arg-type]


def plain_function(system: System) -> Callable[[Floats, Floats, Floats], list[float]]:
    """f(y, u, q) as ordinary Python, made only from the equations that the engine prints."""
    names = [*system.state_names, *system.input_names, *system.parameter_names]
    text = f"lambda {', '.join(names)}: [{', '.join(to_text(expr) for expr in system.rhs)}]"
    function = eval(text, {"exp": math.exp, "log": math.log, "sqrt": math.sqrt, "tanh": math.tanh})
    return lambda y, u, q: function(*y.tolist(), *u.tolist(), *q.tolist())
