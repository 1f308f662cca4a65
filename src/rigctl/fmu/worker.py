"""Simulates an FMU in a process of its own: ``python -m rigctl.fmu.worker``, commanded through its pipes.

An FMU is a compiled program: if it crashes or never returns, only this process is lost. The first message
names the FMU, a folder to unpack it in, and its connected variables; each further one is a simulation: its
points in time, the inputs from each of them to the next, and what is set before it starts. The inputs may be
followed by the tunable parameters, which then change as inputs do. All values are in the FMU's units.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.foreign.messages import DOUBLE, read_message, write_message

Floats = NDArray[np.float64]

#: relative tolerance of integrations
_TOLERANCE = 1e-8
#: integration steps between two points, and events at one point
_MOST_STEPS, _MOST_EVENTS = 20_000, 1000
#: states between two points at which a derivative is not finite, as it may be beyond the range of a model
_MOST_REFUSED = 100
#: status of a call that was successful with a warning; those above it are failures
_WARNING = 1


class _Calls:
    """The functions that are called at every point, without FMPy between, which takes most of the time."""

    def __init__(self, fmu: Any, two: bool) -> None:
        self.two = two
        size, real, flag = ctypes.c_size_t, ctypes.c_double, ctypes.c_void_p
        at = [size, size, size, size] if two else [size, size, size, size, size]

        def function(name: str, *arguments: Any) -> Callable[..., int]:
            address = ctypes.cast(getattr(fmu.dll, name), ctypes.c_void_p).value
            found: Callable[..., int] = ctypes.CFUNCTYPE(ctypes.c_int, *arguments)(address or 0)
            return found

        self.set = function("fmi2SetReal" if two else "fmi3SetFloat64", *at)
        self.get = function("fmi2GetReal" if two else "fmi3GetFloat64", *at)
        rest = [ctypes.c_int] if two else [ctypes.c_bool, flag, flag, flag, flag]
        self.step = (
            function("fmi2DoStep" if two else "fmi3DoStep", size, real, real, *rest)
            if hasattr(fmu, "doStep")
            else None
        )


class _Instance:
    """One instance of an FMU, for one simulation; the names of FMI 2.0 and 3.0 differ.

    Attributes
    ----------
    drives: (points - 1, inputs) or more rows; or with the tunable parameters.
    rows: (points, outputs), of which the first `done` have been read.
    """

    def __init__(
        self, fmu: Any, calls: _Calls, setup: Mapping[str, Any], about: Any, drives: Floats, points: int
    ) -> None:
        self.time, self.done = 0.0, 0
        self.fmu, self.about, self.two = fmu, about, calls.two
        fmu.instantiate()
        self.drives = np.ascontiguousarray(drives)
        self.rows = np.full((points, len(setup["outputs"])), np.nan)
        self._calls = calls
        self._references = {
            name: np.array(setup[name], dtype=np.uint32) for name in ("given", "outputs", "starts")
        }
        self._component = int(fmu.component)
        self._writes = self._access("given", self.drives)
        self._reads = self._access("outputs", self.rows)

    def _access(self, ports: str, values: Floats) -> tuple[int, int, int, int]:
        """Address of references, their number, address of the values, bytes of a row."""
        count = values.shape[1]
        return self._references[ports].ctypes.data, count, values.ctypes.data, count * DOUBLE

    def give(self, k: int) -> None:
        """Set the inputs that hold from point k on."""
        self._call(self._calls.set, "setting its inputs", self._writes, k)

    def read(self, k: int) -> None:
        """Read the outputs at point k."""
        self._call(self._calls.get, "reading its outputs", self._reads, k)
        self.done = k + 1

    def _call(
        self, function: Callable[..., int], what: str, access: tuple[int, int, int, int], k: int
    ) -> None:
        references, count, values, stride = access
        if not count:
            return
        row = values + k * stride
        if self.two:
            status = function(self._component, references, count, row)
        else:
            status = function(self._component, references, count, row, count)
        if status > _WARNING:
            raise ValueError(f"{what} failed with status {status}")

    def begin(self, time: float, starts: Floats) -> None:
        """Initialise, with values that are set first; one that is not a number keeps the FMU's own."""
        self.time = time
        if self.two:
            self.fmu.setupExperiment(startTime=time, tolerance=_TOLERANCE)
        known = np.isfinite(starts)
        if known.any():
            references = self._references["starts"][known].tolist()
            (self.fmu.setReal if self.two else self.fmu.setFloat64)(references, starts[known].tolist())
        self.give(0)
        if self.two:
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time, tolerance=_TOLERANCE)
        self.fmu.exitInitializationMode()

    def co_simulate(self, points: Sequence[float], changed: Sequence[bool]) -> None:
        """Let a co-simulation FMU go from point to point."""
        do, get, component = self._calls.step, self._calls.get, self._component
        assert do is not None  # noqa: S101 - it is one for co-simulation
        flags = (ctypes.c_bool * 3)()
        last = ctypes.c_double()
        at = ctypes.addressof(flags)
        rest = (1,) if self.two else (True, at, at + 1, at + 2, ctypes.addressof(last))
        references, count, row, stride = self._reads
        sizes = () if self.two else (count,)
        for k, end in enumerate(points[1:]):
            if changed[k]:
                self.give(k)
            begin, self.time = self.time, end
            if do(component, begin, end - begin, *rest) > _WARNING:
                raise ValueError("a step failed")
            if flags[1]:
                raise ValueError("it asks to end the simulation")
            row += stride
            if get(component, references, count, row, *sizes) > _WARNING:
                raise ValueError("reading its outputs failed")
            self.done = k + 2

    def events(self) -> float:
        """Update discrete states until they rest; the time of the next event, infinite if none is known."""
        for _ in range(_MOST_EVENTS):
            update = self.fmu.newDiscreteStates if self.two else self.fmu.updateDiscreteStates
            more, ends, _, _, defined, following = update()
            if ends:
                raise ValueError("it asks to end the simulation")
            if not more:
                self.fmu.enterContinuousTimeMode()
                return float(following) if defined else math.inf
        raise ValueError("its discrete states do not come to rest")

    def free(self) -> None:
        """Free it, but not its program."""
        (self.fmu.fmi2FreeInstance if self.two else self.fmu.fmi3FreeInstance)(self.fmu.component)


class _Held:
    """The inputs between two points, for a solver that would interpolate them: they are constant."""

    def apply(self, *_: object, **__: object) -> None:
        return


def _solver(**parts: Any) -> Any:
    """CVODE for an FMU: with derivatives that are not finite it would creep towards the first of them."""
    from fmpy.sundials import CVodeSolver
    from fmpy.sundials.nvector_serial import NV_DATA_S

    class Solver(CVodeSolver):  # type: ignore[misc]
        failure = ""
        refused = 0

        def f(self, t: float, y: Any, ydot: Any, user_data: Any) -> int:
            try:
                super().f(t, y, ydot, user_data)
            except Exception as problem:  # noqa: BLE001 - it would be lost in C
                self.failure = str(problem)
                return -1
            if all(map(math.isfinite, NV_DATA_S(ydot)[: self.nx])):
                return 0
            self.failure = "a derivative is not a number"
            self.refused += 1
            return 1 if self.refused < _MOST_REFUSED else -1  # CVODE tries a shorter step, or gives up

        def step(self, t: float, end: float) -> tuple[bool, Any, float]:
            self.refused = 0
            try:
                result: tuple[bool, Any, float] = super().step(t, end)
            except Exception as problem:
                raise ValueError(self.failure or str(problem)) from problem
            return result

    return Solver(**parts)


class _Integration:
    """Integrates a model-exchange FMU with CVODE, with its state and time events."""

    def __init__(self, one: _Instance) -> None:
        fmu = one.fmu
        self._one, self._fmu = one, fmu
        self._completes = one.about.modelExchange.needsCompletedIntegratorStep
        self._following = one.events()
        self._solver = _solver(
            nx=one.about.numberOfContinuousStates,
            nz=one.about.numberOfEventIndicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=fmu.getDerivatives if one.two else fmu.getContinuousStateDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalsOfContinuousStates,
            set_time=fmu.setTime,
            input=_Held(),
            startTime=one.time,
            relativeTolerance=_TOLERANCE,
            maxNumSteps=_MOST_STEPS,
        )

    def give(self, k: int) -> None:
        """Set the inputs, which jump at point k: an event."""
        self._fmu.enterEventMode()
        self._one.give(k)
        self._resume()

    def step(self, end: float) -> None:
        """Integrate until `end`."""
        one = self._one
        for _ in range(_MOST_EVENTS):
            if one.time >= end:
                return
            # To the next point, or to the next time event of the FMU if that comes first. After a step three
            # things can call for event mode: a zero crossing found by CVODE, the FMU's own wish after a
            # completed step, and a time event that is due.
            event, goal = False, min(end, max(self._following, one.time))
            if goal > one.time:
                event, _, one.time = self._solver.step(one.time, goal)
            self._fmu.setTime(one.time)
            if self._completes:
                wanted, ends = self._fmu.completedIntegratorStep()
                if ends:
                    raise ValueError("it asks to end the simulation")
                event = event or wanted
            if event or one.time >= self._following:
                self._fmu.enterEventMode()
                self._resume()
        raise ValueError("its events do not end")

    def _resume(self) -> None:
        self._following = self._one.events()
        self._solver.reset(self._one.time)


def _simulated(program: _Program, points: Floats, drives: Floats, starts: Floats) -> tuple[str, Floats]:
    """Why it failed and when, "" if it did not; and the outputs at each point until then, NaN after it.

    At a switch the outputs are those before it.
    """
    times, one = points.tolist(), None
    changed = [False, *(drives[1:] != drives[:-1]).any(axis=1).tolist()]
    rows = np.full((len(times), len(program.setup["outputs"])), np.nan)
    reason = ""
    try:
        one = program.instance(drives, len(times))
        rows = one.rows
        one.begin(times[0], starts)
        one.read(0)
        if program.setup["kind"] == "CoSimulation":
            one.co_simulate(times, changed)
        else:
            integration = _Integration(one)
            for k, end in enumerate(times[1:]):
                if changed[k]:
                    integration.give(k)
                integration.step(end)
                one.read(k + 1)
        one.fmu.terminate()
    except Exception as problem:  # noqa: BLE001 - whatever the FMU or FMPy refuses
        when = times[0] if one is None else one.time
        reason = f"{when:.4g} s: {str(problem) or type(problem).__name__}"
    finally:
        if one is not None:
            one.free()
    if one is not None:
        # An FMU may go on with NaN: the first row that is not finite is the failure, and what follows is not
        # used.
        good = np.isfinite(rows[: one.done])
        if not good.all():
            row = int(np.argmin(good.all(axis=1)))
            column = int(np.argmin(good[row]))
            reason = f"{times[row]:.4g} s: {program.setup['names'][column]} is {rows[row, column]}"
            rows[row:] = np.nan
    return reason, rows


class _Program:
    """An FMU, unpacked and loaded with all imports, which do not count as a simulation's time."""

    def __init__(self, setup: Mapping[str, Any]) -> None:
        from fmpy import extract, read_model_description
        from fmpy.simulation import instantiate_fmu

        if setup["kind"] == "ModelExchange":
            import fmpy.sundials  # noqa: F401 - there is none for some computers
        self.setup = setup
        extract(setup["fmu"], setup["folder"])
        self._about = read_model_description(setup["fmu"])
        # the instance is not used: each simulation has its own
        self._fmu: Any = instantiate_fmu(setup["folder"], self._about, setup["kind"])
        two = self._about.fmiVersion == "2.0"
        (self._fmu.fmi2FreeInstance if two else self._fmu.fmi3FreeInstance)(self._fmu.component)
        self._calls = _Calls(self._fmu, two)

    def instance(self, drives: Floats, points: int) -> _Instance:
        """A new instance."""
        return _Instance(self._fmu, self._calls, self.setup, self._about, drives, points)


def main() -> None:
    """Answer until the commands end. What the FMU prints goes nowhere, as stdout carries the answers."""
    commands = sys.stdin.buffer
    nowhere = os.open(os.devnull, os.O_RDWR)
    program: _Program | None = None
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(nowhere, 1)
        while (message := read_message(commands)) is not None:
            setup, arrays = message
            if program is not None:
                reason, rows = _simulated(program, *arrays)
                write_message(answers, {"reason": reason}, rows)
                continue
            reason = ""
            try:
                program = _Program(setup)
            except Exception as problem:  # noqa: BLE001 - whatever the FMU or FMPy refuses
                reason = str(problem) or type(problem).__name__
            write_message(answers, {"reason": reason})


if __name__ == "__main__":
    main()
