"""The waveforms of an output: SI values as functions of the time since their start, s.

In: the parameters of a ramp, a sine, a multisine, steps or a table. Out: values at any time, and by
`commands` the times and values that are sent. A shape knows nothing of actuators; checks and preview ask
it like the run does.

A shape is either `held`, constant between its edges, and is then commanded at these only, or a curve,
which is commanded at a rate. In rounds, each begins at a multiple of the duration and not of the interval
between commands: every period of a multisine then has the same commands, as an analysis over whole
periods needs.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol


class Shape(Protocol):
    """A waveform: a value as a function of time, of limited duration."""

    @property
    def duration(self) -> float:
        """The duration, s."""
        ...

    @property
    def edges(self) -> tuple[float, ...]:
        """The times of its start and of its jumps, s."""
        ...

    @property
    def held(self) -> bool:
        """True if the value changes only at the edges."""
        ...

    def at(self, time: float) -> float:
        """Return the value at a time, s; at a jump, the value after it."""
        ...


@dataclass(frozen=True, slots=True)
class Ramp:
    """A straight line from `begin` to `end`."""

    begin: float
    end: float
    duration: float
    edges: tuple[float, ...] = (0.0,)
    held: bool = False

    def at(self, time: float) -> float:
        """Return the value on the line."""
        share = min(max(time / self.duration, 0.0), 1.0)
        return self.begin + share * (self.end - self.begin)


@dataclass(frozen=True, slots=True)
class Sine:
    """``mean + amplitude·sin(2π·frequency·t + phase)``."""

    mean: float
    amplitude: float
    frequency: float  #: Hz
    phase: float  #: rad
    duration: float
    edges: tuple[float, ...] = (0.0,)
    held: bool = False

    def at(self, time: float) -> float:
        """Return the value of the sine."""
        angle = 2.0 * math.pi * math.fmod(self.frequency * time, 1.0) + self.phase
        return self.mean + self.amplitude * math.sin(angle)


@dataclass(frozen=True, slots=True)
class Multisine:
    """One period of ``mean + sum amplitude·cos(2π·frequency·t + phase)`` over lines of one amplitude."""

    mean: float
    amplitude: float  #: of each line
    frequencies: tuple[float, ...]  #: Hz, increasing multiples of 1/duration
    phases: tuple[float, ...]  #: rad
    crest_factor: float  #: peak over rms, about the mean
    duration: float
    edges: tuple[float, ...] = (0.0,)
    held: bool = False

    def at(self, time: float) -> float:
        """Return the value of the sum."""
        share, first = math.fmod(time, self.duration), 2.0 * math.pi
        lines = zip(self.frequencies, self.phases, strict=True)
        return self.mean + self.amplitude * sum(math.cos(first * f * share + phase) for f, phase in lines)

    def __str__(self) -> str:
        """The band, the period and the crest factor."""
        count, low, high = len(self.frequencies), self.frequencies[0], self.frequencies[-1]
        lines = f"{count} lines from {low:.4g} to {high:.4g} Hz" if count > 1 else f"one line at {low:.4g} Hz"
        return f"{lines}, period {self.duration:g} s, crest factor {self.crest_factor:.2f}"


@dataclass(frozen=True, slots=True)
class Steps:
    """Levels one after the other, each for `each` s, of which `rise` s are a linear transition."""

    levels: tuple[float, ...]
    each: float
    rise: float = 0.0

    @property
    def duration(self) -> float:
        """The duration of all levels, s."""
        return self.each * len(self.levels)

    @property
    def edges(self) -> tuple[float, ...]:
        """The start of each level, s."""
        return tuple(index * self.each for index in range(len(self.levels)))

    @property
    def held(self) -> bool:
        """True if there is no rise time."""
        return self.rise == 0.0

    def at(self, time: float) -> float:
        """Return the level, or the value on the linear transition to it from the previous one."""
        index = min(max(int(time / self.each + 1e-9), 0), len(self.levels) - 1)
        since = time - index * self.each
        if index == 0 or since >= self.rise:
            return self.levels[index]
        before = self.levels[index - 1]
        return before + max(since, 0.0) / self.rise * (self.levels[index] - before)


@dataclass(frozen=True, slots=True)
class Table:
    """Values at given times; in between the previous value (`held`), or a linear interpolation."""

    times: tuple[float, ...]  #: s, increasing from 0
    values: tuple[float, ...]
    held: bool

    @property
    def duration(self) -> float:
        """The last time of the table, s."""
        return self.times[-1]

    @property
    def edges(self) -> tuple[float, ...]:
        """All times of the table if its values are held, otherwise only the start."""
        return self.times if self.held else self.times[:1]

    def at(self, time: float) -> float:
        """Return the value, held or interpolated between two rows."""
        index = min(max(bisect_right(self.times, time + 1e-9) - 1, 0), len(self.times) - 1)
        if self.held or index == len(self.times) - 1:
            return self.values[index]
        span = self.times[index + 1] - self.times[index]
        share = max(time - self.times[index], 0.0) / span
        return self.values[index] + share * (self.values[index + 1] - self.values[index])


def commands(shape: Shape, period: float, rounds: int = 1) -> Iterator[tuple[float, float]]:
    """Yield the commands of the output: times in s from the start, increasing, and SI values.

    A held waveform is commanded at its edges; any other every `period` s and at its end.
    """
    steps = range(0 if shape.held else math.ceil(shape.duration / period - 1e-9))
    curve = [(index * period, shape.at(index * period)) for index in steps]
    for number in range(rounds):
        begin = number * shape.duration
        if shape.held:
            for edge in shape.edges:
                if edge < shape.duration or number == rounds - 1:  # otherwise the next round begins there
                    yield begin + edge, shape.at(edge)
            continue
        for time, value in curve:
            yield begin + time, value
        if number == rounds - 1:
            yield begin + shape.duration, shape.at(shape.duration)


def highest_frequency(shape: Shape) -> float:
    """Return the frequency of a sine or of the highest line of a multisine, Hz; 0 for other shapes."""
    match shape:
        case Sine():
            return shape.frequency
        case Multisine():
            return shape.frequencies[-1]
        case _:
            return 0.0


def count(shape: Shape, period: float, rounds: int) -> float:
    """Return an upper limit of the number of commands."""
    return rounds * (len(shape.edges) if shape.held else shape.duration / period + 1.0)
