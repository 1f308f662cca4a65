"""Simulates an FMU in a process of its own: ``python -m rigctl.fmu.worker``, commanded through its pipes.

An FMU is a compiled program: if it crashes or never returns, only this process is lost. Commands and answers
are JSON documents of one line each. The first command names the FMU, a folder to unpack it in, and its
connected variables; each further one is a simulation: its points in time, the inputs from each of them to the
next, and what is set before it starts. All values are in the FMU's units.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any

#: relative tolerance of integrations
_TOLERANCE = 1e-8
#: integration steps between two points, and events at one point
_MOST_STEPS, _MOST_EVENTS = 20_000, 1000
#: states between two points at which a derivative is not finite, as it may be beyond the range of a model
_MOST_REFUSED = 100


class _Instance:
    """One instance of an FMU, for one simulation; the names of FMI 2.0 and 3.0 differ."""

    def __init__(self, setup: Mapping[str, Any], description: Any) -> None:
        from fmpy.simulation import instantiate_fmu

        self.time = 0.0
        self.about = description
        self.two = description.fmiVersion == "2.0"
        self.fmu: Any = instantiate_fmu(setup["folder"], description, setup["kind"])
        self._set, self._get = (
            (self.fmu.setReal, self.fmu.getReal) if self.two else (self.fmu.setFloat64, self.fmu.getFloat64)
        )
        self._setup = setup

    def give(self, row: Sequence[float]) -> None:
        """Set the inputs."""
        if row:
            self._set(self._setup["inputs"], row)

    def read(self) -> list[float]:
        """The outputs, all finite: one that is not would count as one that the FMU does not have."""
        values: list[float] = self._get(self._setup["outputs"])
        for name, value in zip(self._setup["names"], values, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"{name} is {value}")
        return values

    def begin(self, time: float, row: Sequence[float], starts: Mapping[str, float]) -> None:
        """Initialise, with values by reference that are set first."""
        self.time = time
        if self.two:
            self.fmu.setupExperiment(startTime=time, tolerance=_TOLERANCE)
        if starts:
            self._set([int(reference) for reference in starts], list(starts.values()))
        self.give(row)
        if self.two:
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time, tolerance=_TOLERANCE)
        self.fmu.exitInitializationMode()

    def step(self, end: float) -> None:
        """Let a co-simulation FMU go on until `end`."""
        ends = self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=end - self.time)
        if not self.two and ends[1]:
            raise ValueError("it asks to end the simulation")
        self.time = end

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

    def give(self, row: Sequence[float]) -> None:
        """Set the inputs, which jump: an event."""
        self._fmu.enterEventMode()
        self._one.give(row)
        self._resume()

    def step(self, end: float) -> None:
        """Integrate until `end`."""
        one = self._one
        for _ in range(_MOST_EVENTS):
            if one.time >= end:
                return
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


def _simulated(setup: Mapping[str, Any], description: Any, job: Mapping[str, Any]) -> list[list[float]]:
    """The outputs at each point: at a switch, those before it."""
    points, drives = job["points"], job["drives"]
    time = points[0]
    one = None
    try:
        one = _Instance(setup, description)
        one.begin(time, drives[0], job["starts"])
        forward = one if setup["kind"] == "CoSimulation" else _Integration(one)
        rows = [one.read()]
        for k, time in enumerate(points[1:]):
            if k and drives[k] != drives[k - 1]:
                forward.give(drives[k])
            forward.step(time)
            rows.append(one.read())
        one.fmu.terminate()
    except Exception as problem:
        raise ValueError(f"{time:.4g} s: {str(problem) or type(problem).__name__}") from problem
    finally:
        if one is not None:
            one.fmu.freeInstance()
    return rows


def _opened(setup: Mapping[str, Any]) -> Any:
    """Unpack the FMU, and import what its simulations need, which is not counted as their time."""
    import fmpy.simulation
    from fmpy import extract, read_model_description

    if setup["kind"] == "ModelExchange":
        import fmpy.sundials  # noqa: F401 - there is none for some computers

    extract(setup["fmu"], setup["folder"])
    return read_model_description(setup["fmu"])


def main() -> None:
    """Answer until the commands end. What the FMU prints goes nowhere, as stdout carries the answers."""
    commands = sys.stdin.buffer
    nowhere = os.open(os.devnull, os.O_RDWR)
    setup: dict[str, Any] = {}
    description: Any = None
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(nowhere, 1)
        for line in commands:
            command = json.loads(line)
            answer: dict[str, Any] = {}
            try:
                if not setup:
                    setup = command
                    description = _opened(setup)
                else:
                    answer["rows"] = _simulated(setup, description, command)
            except Exception as problem:  # noqa: BLE001 - whatever the FMU or FMPy refuses
                answer = {"reason": str(problem) or type(problem).__name__}
            answers.write(json.dumps(answer).encode() + b"\n")
            answers.flush()


if __name__ == "__main__":
    main()
