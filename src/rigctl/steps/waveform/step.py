"""The step `waveform`: its fields, and its execution.

In: one of five shapes, with values and times. Out: a list of commands at times, which is checked against
all limits of the rig when the plan is made, as nothing of it depends on readings. The one exception is a
ramp from the present command, which is checked when it begins, before the first command.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.plan.action import Action
from rigctl.plan.behaviour import Behaviour, Row, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart
from rigctl.plan.forecast import Basis, Extents, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import (
    COUNT,
    PERIOD,
    RATE,
    AnyTolerance,
    AnyValue,
    Count,
    Duration,
    Period,
    Rate,
    Seed,
)
from rigctl.project import find_project
from rigctl.steps.set_ import Command, read_command
from rigctl.steps.waveform.checks import MOST, SHORTEST, check_commands, check_frequency, check_sampled
from rigctl.steps.waveform.shapes import Multisine, Ramp, Shape, Sine, Steps, Table, commands, count
from rigctl.steps.waveform.table_file import read_table

_SHAPES = ("ramp", "sine", "multisine", "steps", "table")


class RampFields(ProcedurePart):
    """A linear ramp."""

    from_: Command | None = Field(
        default=None, alias="from", description="initial value; by default the present command"
    )
    to: Command = Field(description="final value")
    over: Duration = Field(description="how long it takes")


class SineFields(ProcedurePart):
    """``mean + amplitude·sin(2π·frequency·t + phase)``."""

    mean: Command = Field(description="mean value")
    amplitude: AnyTolerance = Field(description="amplitude about the mean")
    frequency: Rate = Field(description="frequency")
    phase: AnyValue | None = Field(default=None, description="where it begins", examples=["90 deg"])
    for_: Duration = Field(alias="for", description="how long")


class MultisineFields(ProcedurePart):
    """Sines of equal amplitudes at multiples of 1/period, with phases that keep the peaks low."""

    mean: Command = Field(description="mean value")
    from_: Rate = Field(alias="from", description="lowest frequency")
    to: Rate = Field(description="highest frequency")
    amplitude: AnyTolerance | None = Field(
        default=None, description="largest deviation from the mean; or `rms`", examples=["20 %"]
    )
    rms: AnyTolerance | None = Field(
        default=None, description="standard deviation about the mean", examples=["10 %"]
    )
    period: Duration | None = Field(
        default=None, description="duration of a period; by default that of the lowest frequency"
    )
    lines: Count | None = Field(
        default=None,
        description="number of frequencies, spread over the band in equal ratios; by default all multiples "
        "of 1/period",
        examples=[20],
    )
    seed: Seed | None = Field(
        default=None, description="another signal with the same lines for each number; always the same one"
    )

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if (self.amplitude is None) == (self.rms is None):
            raise refusal(RigctlError("a multisine needs its size", expected="either 'amplitude' or 'rms'"))
        return self


class StepsFields(ProcedurePart):
    """Levels one after the other."""

    levels: list[Command] = Field(
        min_length=1, max_length=10_000, description="levels or positions, in order"
    )
    each: Duration = Field(description="duration of each")
    rise: Period = Field(
        default=PERIOD.read("0 s"), description="time of the linear transition from one to the next"
    )


class TableFields(ProcedurePart):
    """Values at times: from a CSV file with the columns ``time [s]`` and ``NAME [unit]``, or listed here."""

    file: str | None = Field(default=None, description="relative to the procedure or to the project")
    points: list[tuple[Period, Command]] | None = Field(
        default=None, min_length=2, max_length=10_000, description="pairs of a time and a value"
    )
    between: Literal["line", "hold"] = Field(
        default="line", description="between two points a linear interpolation, or the value of the first"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.points is None):
            raise refusal(RigctlError("a table needs its values", expected="either 'file' or 'points'"))
        return self


class WaveformFields(ProcedurePart):
    """One actuator along one waveform, which is checked completely against the rig before anything moves."""

    actuator: str = Field(description="what is commanded")
    ramp: RampFields | None = Field(default=None, description="`from`, `to`, `over`: a linear ramp")
    sine: SineFields | None = Field(
        default=None, description="`mean`, `amplitude`, `frequency`, `phase`, `for`: a sine"
    )
    multisine: MultisineFields | None = Field(
        default=None,
        description="`mean`, `from`, `to`, `amplitude` or `rms`, `period`, `lines`, `seed`: one period of a "
        "sum of sines; `repeat` is the number of periods",
    )
    steps: StepsFields | None = Field(
        default=None, description="`levels`, `each`, `rise`: one level after another"
    )
    table: TableFields | None = Field(
        default=None, description="`file` or `points`, `between`: values at times"
    )
    rate: Rate = Field(
        default=RATE.read("10 Hz"), description="commands per second along a curve; not needed for steps"
    )
    repeat: Count = Field(default=COUNT.read(1), description="number of repetitions")
    then: Literal["stay", "safe"] = Field(
        default="stay", description="at the end the actuator keeps the last value, or goes to its safe one"
    )

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        given = [name for name in _SHAPES if getattr(self, name) is not None]
        if len(given) != 1:
            what = f"two shapes, {' and '.join(given)}" if given else "a waveform needs a shape"
            raise refusal(RigctlError(what, expected=f"one of {', '.join(_SHAPES)}"), tuple(given[1:2]))
        return self


class WaveformStep(Step):
    """Command an actuator along a ramp, a sine, a multisine, steps or a table."""

    verb: ClassVar[str] = "waveform"
    example: ClassVar[str] = (
        "- waveform: {actuator: valve, steps: {levels: [extend, neutral], each: 500 ms}, then: safe}\n"
        "- waveform: {actuator: valve, table: {points: [[0 s, extend], [0.4 s, neutral], [1 s, neutral]], "
        "between: hold}}\n"
    )
    waveform: WaveformFields

    def build(self, context: Context) -> Leaf:
        """Return a `Waveform`, which has been checked completely if its start value is known."""
        fields = self.waveform
        name, at = fields.actuator, ("waveform",)
        rig = context.rig
        context.driven(name, *at, "actuator")
        with context.located(*at, "actuator"):
            if fields.then == "safe" and name not in rig.safe_state:
                raise RigctlError("this actuator has no safe value to return to", value=name)
        (kind,) = (kind for kind in _SHAPES if getattr(fields, kind) is not None)
        shape = _Builder(context, name).shape(fields)
        rounds = int(context.si(fields.repeat, *at, "repeat"))
        action = Waveform(
            actuator=name,
            shape=shape,
            period=1.0 / context.si(fields.rate, *at, "rate"),
            rounds=rounds,
            from_now=fields.ramp is not None and fields.ramp.from_ is None,
            stay=fields.then == "stay",
        )
        with context.located(*at, kind):
            if rounds < 1:
                raise RigctlError("repeated never", value=str(rounds), expected="at least once")
            if (many := count(shape, action.period, rounds)) > MOST:
                raise RigctlError("too many commands", value=f"{many:.0f}", expected=f"at most {MOST}")
            if not shape.held and action.period < SHORTEST:
                raise RigctlError(
                    "more commands per second than a host can keep",
                    value=f"a 'rate' of {1.0 / action.period:g} Hz",
                    expected=f"at most {1.0 / SHORTEST:g} Hz",
                )
            check_frequency(rig.actuators[name], shape, action.period, kind)
            if kind == "multisine" and (sampled := context.record_rate) is not None:
                check_sampled(shape, sampled)
            if not shape.held and rig.actuators[name].kind != "level":
                raise RigctlError(
                    f"'{name}' has positions and nothing between them",
                    expected="'steps' without 'rise', or a table with 'between: hold'",
                )
            if not action.from_now:
                check_commands(rig, name, action.course(None), held=shape.held)
        again = f", {rounds} times" if rounds > 1 else ""
        about = f"{kind} of {shape}," if isinstance(shape, Multisine) else kind
        return context.leaf(f"{name}: {about} for {shown_time(action.duration)}{again}", action)


class _Builder:
    """Reads the shape of a waveform."""

    def __init__(self, context: Context, actuator: str) -> None:
        self._context = context
        self._name = actuator
        self._actuator = context.rig.actuators[actuator]

    def shape(self, fields: WaveformFields) -> Shape:
        """Return the shape that the fields define."""
        if fields.ramp is not None:
            return self._ramp(fields.ramp)
        if fields.sine is not None:
            return self._sine(fields.sine)
        if fields.multisine is not None:
            return self._multisine(fields.multisine)
        if fields.steps is not None:
            return self._steps(fields.steps)
        if fields.table is not None:
            return self._table(fields.table)
        raise ValueError("a waveform without a shape")

    def _ramp(self, fields: RampFields) -> Ramp:
        end = self._value(fields.to, "ramp", "to")
        begin = end if fields.from_ is None else self._value(fields.from_, "ramp", "from")
        return Ramp(begin, end, self._context.si(fields.over, "waveform", "ramp", "over"))

    def _sine(self, fields: SineFields) -> Sine:
        keys, context = ("waveform", "sine"), self._context
        unit = self._actuator.display_unit
        return Sine(
            self._value(fields.mean, "sine", "mean"),
            context.si(fields.amplitude, *keys, "amplitude", unit=unit),
            context.si(fields.frequency, *keys, "frequency"),
            context.optional_si(fields.phase, *keys, "phase", unit="deg") or 0.0,
            context.si(fields.for_, *keys, "for"),
        )

    def _multisine(self, fields: MultisineFields) -> Multisine:
        from rigctl.steps.waveform.multisine import multisine  # numpy, which other steps do not need

        keys, context = ("waveform", "multisine"), self._context
        unit = self._actuator.display_unit
        mean = self._value(fields.mean, "multisine", "mean")
        low, high = context.si(fields.from_, *keys, "from"), context.si(fields.to, *keys, "to")
        period = context.optional_si(fields.period, *keys, "period") or 1.0 / low
        lines = context.optional_si(fields.lines, *keys, "lines")
        seed = context.optional_si(fields.seed, *keys, "seed")
        peak = context.optional_si(fields.amplitude, *keys, "amplitude", unit=unit)
        rms = context.optional_si(fields.rms, *keys, "rms", unit=unit)
        with context.located(*keys):
            return multisine(
                mean,
                (low, high),
                period,
                None if lines is None else int(lines),
                amplitude=peak,
                rms=rms,
                seed=None if seed is None else int(seed),
            )

    def _steps(self, fields: StepsFields) -> Steps:
        keys, context = ("waveform", "steps"), self._context
        each, rise = context.si(fields.each, *keys, "each"), context.si(fields.rise, *keys, "rise")
        if rise > each:
            with context.located(*keys, "rise"):
                raise RigctlError("longer than a step", value=f"{rise:g} s", expected=f"at most {each:g} s")
        levels = tuple(self._value(level, "steps", "levels", i) for i, level in enumerate(fields.levels))
        return Steps(levels, each, rise)

    def _table(self, fields: TableFields) -> Table:
        context, held = self._context, fields.between == "hold"
        if fields.file is not None:
            with context.located("waveform", "table", "file"):
                path = context.document.path
                found = find_project(path.parent if path else None).resolve(fields.file, relative_to=path)
            unit = self._actuator.display_unit
            return Table(*read_table(found, self._name, unit, self._actuator.check), held)
        times: list[float] = []
        values: list[float] = []
        for index, (time, value) in enumerate(fields.points or ()):
            keys = ("waveform", "table", "points", index)
            times.append(context.si(time, *keys, 0))
            values.append(self._value(value, "table", "points", index, 1))
            if index and times[-1] <= times[-2]:
                with context.located(*keys):
                    raise RigctlError("the time does not increase", value=f"{times[-1]:g} s")
        return Table(tuple(time - times[0] for time in times), tuple(values), held)

    def _value(self, command: Command, *keys: str | int) -> float:
        with self._context.located("waveform", *keys):
            return read_command(self._context, self._name, self._actuator, command)


@dataclass(frozen=True, slots=True)
class Waveform(Action):
    """Command `actuator` along `shape`; SI.

    Between two commands the earlier one is held. A host that is late skips overdue commands: the commanded
    value is always that of the present time.
    """

    actuator: str
    shape: Shape
    period: float  #: s between two commands along a curve
    rounds: int
    from_now: bool  #: a ramp that starts at the present command
    stay: bool  #: whether the last value is kept at the end; otherwise the safe one follows

    @property
    def duration(self) -> float:
        """The duration of all rounds, s."""
        return self.shape.duration * self.rounds

    def course(self, now: float | None) -> Iterator[tuple[float, float]]:
        """Return its commands, for an actuator that is commanded to `now` at the start."""
        shape = self.shape
        if self.from_now and now is not None and isinstance(shape, Ramp):
            shape = replace(shape, begin=now)
        return commands(shape, self.period, self.rounds)

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration, and the supply pressure if it follows the actuator."""
        after = bench.pass_time(state, self.duration)
        role = bench.rig.roles.set_pressure
        reaches: Extents = {}
        if role is not None and role.actuator == self.actuator:
            values = [value for _, value in self.course(None)]
            reaches = {role.channel: (min(values), max(values))}
            after = replace(after, pressure=values[-1])
        return Forecast(self.duration, Basis.TIMED, after, reaches)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Send every command at its time, after approaching the first value no faster than allowed.

        If it ends early, the outputs are made safe, as for any step.

        Raises
        ------
        StepFailed
            starting from the present command it would be faster than the rig allows; nothing has moved.
        """
        name = self.actuator
        now = bench.commanded.get(name, bench.safe_value(name))
        course = list(self.course(now))
        if self.from_now:
            try:
                check_commands(bench.rig, name, course, held=False)
            except RigctlError as error:
                raise StepFailed(str(error)) from None
        bench.regulated.add(name)
        try:
            # 1. To the first value, if the actuator may not jump there.
            way = self._lead_in(bench, now, course[0][1])
            if way:
                yield from self._follow(bench, way, way[-1][0])
            # 2. The waveform itself.
            late = yield from self._follow(bench, course, self.duration)
            if late:
                bench.event("note", f"{name}: {late} commands were left out, the host was late")
            # 3. The end, with an acknowledgement: on the way a command that was lost is replaced by the next
            #   one.
            last = course[-1][1] if self.stay else bench.safe_value(name)
            if not bench.is_at(name, last):
                yield from bench.command(name, last)
        finally:
            bench.regulated.discard(name)
        return Outcome.COMPLETE

    def _lead_in(self, bench: StepBench, now: float, first: float) -> list[tuple[float, float]]:
        """Return the commands from `now` to the first value, as fast as allowed; none if it may jump."""
        fastest = bench.rig.actuators[self.actuator].max_rate
        if fastest is None or now == first:
            return []
        way = Ramp(now, first, abs(first - now) / fastest)
        return list(commands(way, self.period))

    def _follow(
        self, bench: StepBench, course: list[tuple[float, float]], end: float
    ) -> Generator[Until, Row | None, int]:
        """Send commands at their times until `end`, s; return the number that were skipped because a later
        one was due."""
        begin, late = bench.now, 0
        for index, (time, value) in enumerate(course):
            # A late host leaves commands out rather than shift the waveform: its times are what a model is
            # compared with.
            if index + 1 < len(course) and begin + course[index + 1][0] <= bench.now:
                late += 1
                continue
            if bench.now < begin + time:
                yield Until(begin + time)
            if not bench.is_at(self.actuator, value):
                bench.try_switch(self.actuator, value)
        if bench.now < begin + end:
            yield Until(begin + end)
        return late

    def lasting(self) -> frozenset[str]:
        """Return the actuator if it keeps its last value, otherwise nothing."""
        return frozenset({self.actuator}) if self.stay else frozenset()
