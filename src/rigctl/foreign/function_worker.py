"""Simulates a user's functions: ``python -m rigctl.foreign.function_worker``, commanded through its pipes.

The first message has the functions and the names of their variables; each further one is a simulation: its
points in time, the inputs from each of them to the next, which may be followed by the parameters, and the
values of the parameters and of the states that readings give, all in SI. Between two changes of the inputs
the states are integrated in one go, by LSODA of ODEPACK, which is for stiff equations too.
"""

from __future__ import annotations

import base64
import math
import os
import pickle
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.foreign.messages import read_message, write_message
from rigctl.foreign.variables import Numbers, Time, by_name, name_of

Floats = NDArray[np.float64]

#: relative tolerance of integrations, and the absolute one as a share of a change that matters
_RELATIVE: Final = 1e-7
_ABSOLUTE: Final = 1e-6
#: steps from one point to the next
_MOST_STEPS: Final = 20_000
#: longest steps that are tried one after the other, as shares of the time between points; 0 is no limit.
#: With shorter ones no state is tried that is far from the solution, where a function may fail
_LONGEST: Final = (0.0, 0.1, 0.01)


class _FailedError(Exception):
    """A simulation that ends before its end, at `time` s if that is known."""

    time: float | None = None


class _Functions:
    """The user's functions, called with numbers."""

    def __init__(self, setup: Mapping[str, Any]) -> None:
        sys.path += [folder for folder in setup["path"] if folder not in sys.path]
        self.rates, self.readings = pickle.loads(base64.b85decode(setup["code"]))  # noqa: S301 - of the process that started this one
        self.setup = setup
        self.states: list[str] = list(setup["states"])
        self.outputs: list[str] = setup["outputs"]
        self.starts = [pair[0] for pair in setup["states"].values()]
        self.tolerances = [_ABSOLUTE * pair[1] for pair in setup["states"].values()]
        self.parameters: Numbers | None = None
        self.time = Time()

    def begin(self, given: Sequence[float]) -> list[float]:
        """Set the parameters; returns the states at the start."""
        count = len(self.setup["parameters"])
        self._set(given[:count])
        set_to = dict(zip(self.setup["settable"], given[count:], strict=True))
        return [
            start if math.isnan(set_to.get(name, math.nan)) else set_to[name]
            for name, start in zip(self.states, self.starts, strict=True)
        ]

    def _set(self, values: Sequence[float]) -> None:
        free = dict(zip(self.setup["parameters"], values, strict=True))
        self.parameters = Numbers("parameter", {**self.setup["constants"], **free})

    def inputs(self, values: Sequence[float]) -> Numbers:
        """The inputs as the functions take them; parameters that follow them are set."""
        count = len(self.setup["inputs"])
        if len(values) > count:
            self._set(values[count:])
        return Numbers("input", dict(zip(self.setup["inputs"], values[:count], strict=True)))

    def rates_at(self, values: Sequence[float], inputs: Numbers) -> list[float]:
        """The rates of the states."""
        x = Numbers("state", dict(zip(self.states, values, strict=True)))
        return _numbers(self.rates, (self.time, x, inputs, self.parameters), self.states, "rate")

    def readings_at(self, values: Sequence[float], inputs: Numbers) -> list[float]:
        """The readings."""
        x = Numbers("state", dict(zip(self.states, values, strict=True)))
        return _numbers(self.readings, (x, inputs, self.parameters), self.outputs, "reading")


def _numbers(
    function: Callable[..., object], arguments: Sequence[object], names: Sequence[str], kind: str
) -> list[float]:
    """What a function returns, finite numbers in the order of the names.

    Raises
    ------
    RigctlError
        it returns something else than numbers, or uses what there is not.
    _FailedError
        it raises, or a number is not finite.
    """
    called = name_of(function)
    try:
        result = function(*arguments)
    except RigctlError:
        raise
    except Exception as problem:  # a user's function may fail in any way
        raise _FailedError(
            f"{called} fails: {type(problem).__name__}: {problem}{_line(problem)}"
        ) from problem
    found = by_name(called, result, names, kind)
    numbers = [_number(found[name], called, kind, name) for name in names]
    for number, name in zip(numbers, names, strict=True):
        if not math.isfinite(number):
            raise _FailedError(f"{called} returns {number} as the {kind} of {name}")
    return numbers


def _number(value: Any, called: str, kind: str, name: str) -> float:
    if type(value) is float:
        return value
    one = value.item() if getattr(value, "size", 0) == 1 else value
    if isinstance(one, int | float):
        return float(one)
    raise RigctlError(f"{called} returns no number as the {kind} of {name}", value=repr(value))


def _line(problem: Exception) -> str:
    """Where it was raised, if that is in the user's own code."""
    frames = traceback.extract_tb(problem.__traceback__)
    return f", in line {frames[-1].lineno} of {frames[-1].name}" if len(frames) > 1 else ""


def _simulated(functions: _Functions, points: Floats, drives: Floats, starts: Floats) -> tuple[str, Floats]:
    """Why it failed and when, "" if it did not; and the readings at each point until then, NaN after it.

    At a switch the readings are those before it.
    """
    rows = np.full((points.size, len(functions.outputs)), np.nan)
    state = functions.begin(starts.tolist())
    changes = np.flatnonzero((drives[1:] != drives[:-1]).any(axis=1)) + 1
    ends = [*changes[changes < points.size - 1].tolist(), points.size - 1]
    begin = 0
    try:
        inputs = functions.inputs(drives[0].tolist())
        rows[0] = functions.readings_at(state, inputs)
        for end in ends:
            if end <= begin:
                break
            inputs = functions.inputs(drives[begin].tolist())
            course, failed = _course(functions, state, inputs, points[begin : end + 1])
            for k, reached in enumerate(course, begin + 1):
                rows[k] = functions.readings_at(reached, inputs)
            if failed is not None:
                raise failed
            state, begin = course[-1], end
    except _FailedError as problem:
        done = int(np.isfinite(rows).all(axis=1).sum())
        time = points[max(done - 1, 0)] if problem.time is None else problem.time
        return f"{time:.4g} s: {problem}", rows
    return "", rows


def _course(
    functions: _Functions, state: list[float], inputs: Numbers, points: Floats
) -> tuple[list[list[float]], _FailedError | None]:
    """The states at the points after the first one, with constant inputs, and why they end early."""
    if not functions.states:
        return [[] for _ in points[1:]], None
    from scipy.integrate import odeint

    def rates(time: float, y: Floats) -> list[float]:
        try:
            return functions.rates_at(y.tolist(), inputs)
        except _FailedError as problem:
            problem.time = time
            raise

    failed: _FailedError | None = None
    for share in _LONGEST:
        try:
            found, how = odeint(  # type: ignore[call-overload]  # its stubs know one tolerance
                rates,
                state,
                points,
                tfirst=True,
                rtol=_RELATIVE,
                atol=functions.tolerances,
                mxstep=_MOST_STEPS,
                hmax=share * float(np.diff(points).min()),
                tcrit=points[-1:],
                full_output=True,
            )
        except _FailedError as problem:  # a state that was only tried, or the solution itself
            failed = problem
            continue
        if how["message"] != "Integration successful.":
            raise _FailedError(
                f"the rates need more than {_MOST_STEPS} steps from one point to the next: do they jump "
                "where their own effect switches them back? A steep slope, such as tanh(x/width), is quicker"
            )
        return [row.tolist() for row in found[1:]], None
    assert failed is not None  # noqa: S101 - else it has returned
    assert failed.time is not None  # noqa: S101 - the rates have failed
    before = points[points < failed.time]
    known = _course(functions, state, inputs, before)[0] if 1 < before.size < points.size else []
    return known, failed


def main() -> None:
    """Answer until the commands end. What the functions print goes nowhere, as stdout has the answers."""
    commands = sys.stdin.buffer
    nowhere = os.open(os.devnull, os.O_RDWR)
    functions: _Functions | None = None
    np.seterr(all="ignore")  # what is not finite is said
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(nowhere, 1)
        while (message := read_message(commands)) is not None:
            setup, arrays = message
            if functions is None:
                reason = ""
                try:
                    functions = _Functions(setup)
                except Exception as problem:  # noqa: BLE001 - whatever a user's module does when it is imported
                    reason = f"{type(problem).__name__}: {problem}"
                write_message(answers, {"reason": reason})
                continue
            try:
                reason, rows = _simulated(functions, *arrays)
            except RigctlError as problem:
                write_message(answers, {"reason": "", "refused": _plain(problem)})
            else:
                write_message(answers, {"reason": reason}, rows)


def _plain(problem: RigctlError) -> dict[str, Any]:
    """What a `RigctlError` is made of."""
    return {
        "what": problem.what,
        "value": problem.value,
        "expected": problem.expected,
        "nearest": problem.nearest,
        "hint": problem.hint,
    }


if __name__ == "__main__":
    main()
