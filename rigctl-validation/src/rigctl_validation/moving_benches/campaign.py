"""One record of a moving twin: its motion, its noise, and the files of its user."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Literal, TypeAlias

import numpy as np

from rigctl_validation.benches.bench import USER_FILES, Floats
from rigctl_validation.moving_benches.equations import CODES
from rigctl_validation.moving_benches.excitation import Motion, excitation
from rigctl_validation.moving_benches.integration import states_of
from rigctl_validation.moving_benches.slow_noise import Colour, noise_series, slow_share
from rigctl_validation.moving_benches.twin import Driven, MovingHidden, Twin

Statement: TypeAlias = Literal["unstated", "stated", "too small", "too large"]
STATEMENTS: Final[tuple[Statement, ...]] = ("unstated", "stated", "too small", "too large")
#: what a wrong statement multiplies the noise with
_STATED: Final[Mapping[str, float]] = {"stated": 1.0, "too small": 0.2, "too large": 5.0}

#: lengths of a record, and samples in a time constant, of which one is drawn
_LENGTHS, _PER_CONSTANT = (400, 500, 800), (8.0, 12.0, 20.0)
#: integration steps between two samples
_STEPS = 16
#: an input that is not commanded wanders through this many periods in a record
_FEWEST_PERIODS, _MOST_PERIODS = 1.5, 4.0
#: the excitation is reduced until every reading is within its limits, in this many steps at most
_REDUCTIONS = 40


@dataclass(frozen=True)
class MovingCampaign:
    """A record of a twin; equal campaigns give identical files.

    Attributes
    ----------
    hidden: what it hides; None for nothing.
    colour, statement: of the noise; what the rig file says of it.
    record: its number, among records of one bench that differ in excitation and noise.
    """

    twin: Twin
    motion: Motion
    hidden: MovingHidden | None = None
    colour: Colour = "white"
    statement: Statement = "unstated"
    seed: int = 0
    record: int = 0

    def rng(self, *part: int) -> np.random.Generator:
        """A generator of the random values of a part of the campaign; 0 to 4 are its own."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=part))

    @cached_property
    def size(self) -> tuple[int, float]:
        """Number of samples, and the sampling period, s."""
        rng = self.rng(0)
        samples, per_constant = int(rng.choice(_LENGTHS)), float(rng.choice(_PER_CONSTANT))
        decays = self.motion == "decay"
        period = self.twin.decay / samples if decays else self.twin.time_constant / per_constant
        return samples, float(f"{period:.3g}")

    @cached_property
    def drawn(self) -> Floats:
        """The values of this bench, in the unit of the equations."""
        rng = self.rng(1)
        return np.array(
            [each.nominal * (1.0 + each.spread * rng.uniform(-1.0, 1.0)) for each in self.twin.drawn]
        )

    @cached_property
    def inputs(self) -> Floats:
        """(samples, inputs) in the units of their columns, small enough for every reading's limits."""
        rng = self.rng(2, self.record)
        samples, period = self.size
        per_constant = self.twin.time_constant / period
        shapes = [self._shape(driven, samples, per_constant, rng) for driven in self.twin.inputs]
        middles = np.array([self._middle(driven) for driven in self.twin.inputs])
        swings = np.array([driven.swing for driven in self.twin.inputs])
        excited = np.array([driven.excited for driven in self.twin.inputs])
        for _ in range(_REDUCTIONS):
            table = middles + np.column_stack(shapes) * swings
            columns = self._readings(table, self.drawn, np.zeros(2), {})
            if all(np.abs(columns[name]).max() <= most for name, most in self.twin.limits.items()):
                break
            swings = np.where(excited, 0.85 * swings, swings)
        return np.asarray(table)

    def _shape(self, driven: Driven, samples: int, per_constant: float, rng: np.random.Generator) -> Floats:
        if driven.excited:
            return excitation(self.motion, samples, per_constant, rng)
        turns = rng.uniform(_FEWEST_PERIODS, _MOST_PERIODS)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        return np.asarray(np.sin(2.0 * np.pi * turns * np.arange(samples) / samples + phase))

    def _middle(self, driven: Driven) -> float:
        if self.motion != "decay" or driven.rest is None:
            return driven.middle
        return driven.rest

    def amplitudes(self, amplitude: float) -> Floats:
        """The amplitudes of the equations that hide the effect with this one."""
        result = np.zeros(2)
        if self.hidden is not None:
            result[self.hidden.place] = amplitude
        return result

    def readings(
        self, amplitude: float, drawn: Floats | None = None, moved: Mapping[int, float] | None = None
    ) -> Mapping[str, Floats]:
        """The noise-free readings in their columns' units.

        Parameters
        ----------
        drawn: other values of the bench.
        moved: added to the initial values of states.
        """
        values = self.drawn if drawn is None else drawn
        return self._readings(self.inputs, values, self.amplitudes(amplitude), moved or {})

    def _readings(
        self, inputs: Floats, drawn: Floats, amplitudes: Floats, moved: Mapping[int, float]
    ) -> Mapping[str, Floats]:
        twin = self.twin
        start = np.array(self._start())
        for index, change in moved.items():
            start[index] += change
        states = np.empty((inputs.shape[0], 0))
        if start.size:
            held = np.array([float(driven.held) for driven in twin.inputs])
            code = CODES[twin.name]
            states = states_of(code, start, inputs, held, drawn, amplitudes, self.size[1], _STEPS)
        return twin.read(states, inputs, drawn, amplitudes)

    def _start(self) -> tuple[float, ...]:
        released = self.twin.released if self.motion == "decay" else None
        return self.twin.start if released is None else released

    @cached_property
    def slow(self) -> Mapping[str, float]:
        """By channel, the standard deviation of the slow part of its noise, in that of the white one."""
        rng = self.rng(3)
        return {name: slow_share(self.colour, rng) for name in self.twin.bench.noise}

    def noise(self) -> Mapping[str, Floats]:
        """The noise of each channel, in its column's unit."""
        rng = self.rng(4, self.record)
        samples, _ = self.size
        return {
            name: np.asarray(sigma * noise_series(self.colour, samples, self.slow[name], rng))
            for name, sigma in self.twin.bench.noise.items()
        }

    def table(self, amplitude: float) -> dict[str, Floats]:
        """The columns of the file as they are logged, with the time [s]."""
        samples, period = self.size
        noise, readings = self.noise(), self.readings(amplitude)
        columns = {name: readings[name] + noise[name] for name in readings}
        given = {driven.column: self.inputs[:, k] for k, driven in enumerate(self.twin.inputs)}
        named = {name: (given | columns)[name] for name in self.twin.bench.columns}
        return {"time": np.asarray(np.arange(samples) * period, dtype=np.float64), **named}

    def total(self, name: str) -> float:
        """Standard deviation of a channel's noise, in its column's unit."""
        return float(self.twin.bench.noise[name] * np.hypot(1.0, self.slow[name]))

    def rig_text(self) -> str:
        """The user's rig file with what it states of the noise."""
        text = self.twin.bench.file("rig.yaml").read_text(encoding="utf-8")
        if self.statement == "unstated":
            return text
        for name in self.twin.bench.noise:
            unit = self.twin.bench.columns[name].replace("degC", "K")
            value = self.total(name) * _STATED[self.statement]
            text = re.sub(
                rf"^(  {name}: {{.*)}}$", rf"\1, noise: {value:.4g} {unit}}}", text, flags=re.MULTILINE
            )
        return text


def write_moving(campaign: MovingCampaign, records: Sequence[Mapping[str, Floats]], folder: Path) -> Path:
    """Write a user's folder: family, rig and model, and the log; returns the path of the log."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in USER_FILES:
        shutil.copyfile(campaign.twin.bench.file(name), folder / name)
    (folder / "rig.yaml").write_text(campaign.rig_text(), encoding="utf-8", newline="\n")
    log = folder / f"{campaign.twin.name}.csv"
    write_log(log, records, campaign.twin.bench.columns)
    return log


def write_log(path: Path, records: Sequence[Mapping[str, Floats]], units: Mapping[str, str]) -> None:
    """A file of records as a logger writes it: an empty cell where a value is missing."""
    units = {**units, "time": "s", "record": ""}
    lines: list[str] = []
    for index, record in enumerate(records, start=1):
        numbered = {"record": np.full(record["time"].size, float(index))} if len(records) > 1 else {}
        columns = {"time": record["time"], **numbered, **record}
        lines = lines or [",".join(f"{name} [{units[name]}]".replace(" []", "") for name in columns)]
        for row in np.column_stack(list(columns.values())).tolist():
            lines.append(",".join("" if math.isnan(value) else f"{value:.9g}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
