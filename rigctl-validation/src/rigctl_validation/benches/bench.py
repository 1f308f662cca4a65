"""A small bench: its channels, the effect that it can hide, and a campaign on it as a file of samples."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Sampling: TypeAlias = Literal["fast", "slow", "five"]
Noise: TypeAlias = Literal["white", "heavy", "level"]
Signal: TypeAlias = Callable[[float], float]

#: samples per time constant of the bench
SAMPLES: Final[Mapping[Sampling, float]] = {"fast": 50.0, "slow": 15.0, "five": 5.0}
NOISES: Final[tuple[Noise, ...]] = ("white", "heavy", "level")
#: degrees of freedom of heavy tails: outliers of ten sigma are frequent
_TAILS = 3.0
_FILES = Path(__file__).parent / "files"
#: the files that a user would write for a bench
USER_FILES = ("family.yaml", "rig.yaml", "model.yaml")


@dataclass(frozen=True)
class Trace:
    """One record without noise: `time` [s] and every column of the file, in the file's units."""

    time: Floats
    columns: Mapping[str, Floats]


@dataclass(frozen=True)
class Nudge:
    """A small change of a bench, for the derivatives of its readings.

    Attributes
    ----------
    part: index of the drawn value that is changed; -1 for none.
    share: its relative change.
    optional: added to the optional input.
    late: additional delay of every command, s.
    """

    part: int = -1
    share: float = 0.0
    optional: float = 0.0
    late: float = 0.0


NOTHING: Final = Nudge()


@dataclass
class Draw:
    """The settings of a generator, and its random values.

    Attributes
    ----------
    rng: of the values that differ between benches and between records.
    period: between two samples, s.
    amplitude: of the hidden effect, in the unit of `Hidden`; 0 for none.
    steady: the optional input is constant within a record.
    alike: it is also the same in all records, at one end of its range.
    drawn: number of values of the bench drawn so far: those that a model of it fits.
    """

    rng: np.random.Generator
    period: float
    amplitude: float
    steady: bool
    nudge: Nudge = NOTHING
    drawn: int = 0
    alike: bool = False

    def times(self, duration: float) -> Floats:
        """Instants of the samples of a record, from 0 s."""
        return np.asarray(np.arange(round(duration / self.period) + 1) * self.period, dtype=np.float64)

    def about(self, value: float, share: float) -> float:
        """A random value within this share of `value`: no real bench has exactly its nominal values."""
        result = value * (1.0 + share * float(self.rng.uniform(-1.0, 1.0)))
        if self.drawn == self.nudge.part:
            result *= 1.0 + self.nudge.share
        self.drawn += 1
        return result

    def switches(self, times: Sequence[float]) -> list[float]:
        """Times at which a command changes: somewhere between two samples, as on a bench."""
        return [t + self.period * float(self.rng.uniform(0.1, 0.9)) + self.nudge.late for t in times]

    def feed(self, about: float, spread: float, period: float, *, steady: bool = False) -> Signal:
        """An input that is not commanded: its level differs from record to record and, unless it is steady,
        varies slowly within each by a quarter of the spread.
        """
        level = about + spread * float(self.rng.uniform(-1.0, 1.0))
        phase = float(self.rng.uniform(0.0, 2.0 * np.pi))
        swing = 0.0 if steady else 0.25 * spread
        return lambda t: level + swing * float(np.sin(2.0 * np.pi * t / period + phase))

    def optional(self, about: float, spread: float, period: float) -> Signal:
        """Draw the input that a user may not have recorded."""
        signal, more = self.feed(about, spread, period, steady=self.steady), self.nudge.optional
        if self.alike:
            return lambda t: about + spread + more
        return lambda t: signal(t) + more


@dataclass(frozen=True)
class Hidden:
    """The effect that a bench can hide.

    Attributes
    ----------
    what, unit: a description, and the unit of its amplitude.
    typical, largest: amplitudes; beyond the largest the bench would not work.
    counts_as: names of effects that are a right answer.
    """

    what: str
    unit: str
    typical: float
    largest: float
    counts_as: tuple[str, ...]


@dataclass(frozen=True)
class SmallBench:
    """A bench.

    Attributes
    ----------
    name: also of its folder of files.
    title: a short description.
    columns: unit of every column of its file but `time` and `record`.
    noise: standard deviation of every channel, in the unit of its column.
    optional: the input that a user may or may not have recorded.
    spread: of the optional input, in the unit of its column.
    time_constant: s; it determines the sampling. None for a table without time.
    simulate: returns the records of a campaign.
    hold_out: the held-out records, as a condition.
    """

    name: str
    title: str
    columns: Mapping[str, str]
    noise: Mapping[str, float]
    optional: str
    spread: float
    time_constant: float | None
    simulate: Callable[[Draw], list[Trace]] = field(repr=False)
    hidden: Hidden
    hold_out: str = "record > 5"

    def file(self, name: str) -> Path:
        """A file that a user would write: ``family.yaml``, ``rig.yaml`` or ``model.yaml``."""
        return _FILES / self.name / name


@dataclass(frozen=True)
class BenchCampaign:
    """A campaign on a small bench; equal campaigns give identical files.

    Attributes
    ----------
    amplitude: of the hidden effect; 0 for none.
    recorded: whether the optional input is in the file.
    noise: "white"; "heavy" tails (Student's t with 3 degrees of freedom); "level", growing with the reading
        from half to twice the nominal noise; "none" for noise-free data.
    """

    bench: SmallBench
    amplitude: float = 0.0
    sampling: Sampling = "fast"
    recorded: bool = True
    noise: Noise | Literal["none"] = "white"
    seed: int = 0

    @property
    def period(self) -> float:
        """Between two samples, s."""
        return _rounded((self.bench.time_constant or 1.0) / SAMPLES[self.sampling])

    def drawn(self, nudge: Nudge = NOTHING) -> tuple[list[Trace], int]:
        """The noise-free records of a changed bench, and the number of its values that were drawn."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(0,)))
        alike = not self.recorded and self.seed % 2 == 1  # a heater that is always off, a room always warm
        draw = Draw(rng, self.period, self.amplitude, not self.recorded, nudge, alike=alike)
        return self.bench.simulate(draw), draw.drawn

    def traces(self) -> list[Trace]:
        """The noise-free records."""
        return self.drawn()[0]

    def records(self) -> list[Trace]:
        """The records as they are logged."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(1,)))
        traces = self.traces()
        ranges = {name: _range(traces, name) for name in self.bench.noise}
        return [Trace(trace.time, {**trace.columns, **self._read(trace, ranges, rng)}) for trace in traces]

    def _read(
        self, trace: Trace, ranges: Mapping[str, tuple[float, float]], rng: np.random.Generator
    ) -> dict[str, Floats]:
        return {
            name: trace.columns[name] + _noise(self.noise, sigma, trace.columns[name], ranges[name], rng)
            for name, sigma in self.bench.noise.items()
        }

    def write_csv(self, path: Path) -> None:
        """Write the campaign as a logger would: one row for each sample, names with units in the heading."""
        names = [name for name in self.bench.columns if self.recorded or name != self.bench.optional]
        heading = ["time [s]", "record"] if self.bench.time_constant else []
        heading += [f"{name} [{self.bench.columns[name]}]" for name in names]
        lines = [",".join(heading)]
        for index, record in enumerate(self.records(), start=1):
            table = np.column_stack([record.columns[name] for name in names])
            for time, row in zip(record.time.tolist(), table.tolist(), strict=True):
                begin = [f"{time:.9g}", str(index)] if self.bench.time_constant else []
                lines.append(",".join([*begin, *(f"{value:.9g}" for value in row)]))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def write_bench(campaign: BenchCampaign, folder: Path) -> Path:
    """Write a user's folder: family, rig and model, and the log; returns the path of the log."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in USER_FILES:
        shutil.copyfile(campaign.bench.file(name), folder / name)
    log = folder / f"{campaign.bench.name}.csv"
    campaign.write_csv(log)
    return log


def _rounded(period: float) -> float:
    """A sampling period usual for a logger: the nearest of 1, 2, 4, 5 and 8 times powers of ten."""
    power = 10.0 ** np.floor(np.log10(period))
    return float(power * min((1.0, 2.0, 4.0, 5.0, 8.0, 10.0), key=lambda m: abs(np.log(period / power / m))))


def _range(traces: Sequence[Trace], name: str) -> tuple[float, float]:
    return (
        min(float(trace.columns[name].min()) for trace in traces),
        max(float(trace.columns[name].max()) for trace in traces),
    )


def _noise(
    kind: Noise | Literal["none"],
    sigma: float,
    truth: Floats,
    span: tuple[float, float],
    rng: np.random.Generator,
) -> Floats:
    if kind == "none":
        return np.zeros(truth.size)
    if kind == "heavy":
        return np.asarray(sigma * rng.standard_t(_TAILS, truth.size) / np.sqrt(_TAILS))
    white = sigma * rng.standard_normal(truth.size)
    if kind == "white":
        return np.asarray(white)
    low, high = span
    return np.asarray(white * (0.5 + 1.5 * (truth - low) / max(high - low, 1e-300)))
