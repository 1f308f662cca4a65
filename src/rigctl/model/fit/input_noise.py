"""The contribution of the noise of measured inputs to the noise of the outputs.

A measured input acts on the model including its noise, which causes an error of the outputs: hardly any for a
slow bench, all of it for a channel that follows the input at once. The model is simulated with additional
input noise, and the change of its outputs is added to their noise, ``σ² = σ_y² + σ_u²``. This also holds for
smoothed inputs: the noise that remains is as large as before at low frequencies, and only there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.problem import Problem
from rigctl.units import show

Floats = NDArray[np.float64]

_DRAWS = 4
#: contributions of inputs below this share of a channel's noise are ignored
_SHARE = 0.1


def with_input_noise(problem: Problem, shared: Floats, local: Sequence[Floats]) -> Problem:
    """The problem with the contribution of its inputs' noise, according to the model at these values."""
    measurements = problem.measurements
    noisy = {
        measurements.inputs.index(name): sigma for name, sigma in measurements.input_noise.items() if sigma
    }
    if not any(index in noisy for record in problem.records for index in record.along):
        return problem
    # a fixed seed: the same data have the same noise, and so the same fit
    plain = problem.simulate(shared, local)
    squares = [np.zeros(len(measurements.outputs)) for _ in problem.records]
    generator = np.random.Generator(np.random.PCG64(0))
    for _ in range(_DRAWS):
        records = []
        for record in problem.records:
            sigma = np.array([noisy.get(index, 0.0) for index in record.along])
            more = generator.standard_normal(record.lines.shape) * sigma
            records.append(replace(record, lines=record.lines + more))
        moved = replace(problem, measurements=replace(measurements, records=tuple(records)))
        simulated = moved.simulate(shared, local)
        if not (plain.ok and simulated.ok):
            return problem
        for index, (before, after) in enumerate(zip(plain.outputs, simulated.outputs, strict=True)):
            squares[index] += np.square((after - before)[:, problem.channels]).mean(axis=0) / _DRAWS
    extra = [
        np.where(np.sqrt(square) > _SHARE * sigma.mean(axis=0), np.sqrt(square), 0.0)
        for square, sigma in zip(squares, problem.sigma, strict=True)
    ]
    if not any(one.any() for one in extra):
        return problem
    return replace(problem, extra=tuple(extra)).whitened()


def input_noise_notes(problem: Problem) -> Iterator[str]:
    """The visible contributions of the measured inputs' noise to the outputs."""
    measurements = problem.measurements
    if problem.extra is None:
        return
    largest = np.max(np.array(problem.extra), axis=0)
    shown = [
        f"{name} {show(float(size), unit, difference=True, digits=2)}"
        for name, unit, size in zip(measurements.outputs, measurements.units, largest, strict=True)
        if size > 0.0
    ]
    if shown:
        yield (
            f"according to the model, the noise of the measured inputs moves {', '.join(shown)}: it counts "
            "as noise of these channels"
        )
