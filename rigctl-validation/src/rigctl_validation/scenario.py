"""One trial of the benchmark: the hidden effects, their sizes and shapes, and the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from rigctl_validation.bench.campaign import PRESSURES, TEMPERATURES, Campaign, Scatter
from rigctl_validation.bench.parameters import BenchParameters
from rigctl_validation.bench.sensing import TEN_BITS, Noise
from rigctl_validation.hidden_effect import Shape, hide
from rigctl_validation.hidden_library import find_hidden

Kind: TypeAlias = Literal["nothing", "one", "two", "removed"]
NoiseVariant: TypeAlias = Literal["white", "coloured", "ten_bits", "scatter", "all"]
NOISES: tuple[NoiseVariant, ...] = ("white", "coloured", "ten_bits", "scatter", "all")

#: correlation of coloured noise from one sample to the next
CORRELATION = 0.6
#: relative repeatability of the pressure setting
SCATTER = 0.002

#: standard deviations of the bench's properties about drawings, scales and data sheets: those of the textbook
#: model's priors, so that these are exactly as accurate as they claim
TOLERANCES = {"mass": 2.0, "spool_time": 8e-3, "dead_a": 15e-6, "dead_b": 15e-6}


@dataclass(frozen=True)
class Wanted:
    """An effect to hide: its size λ in the data, in sigmas, and its direction in the library's sense.

    If `amplitude` (SI) is given, it has that amplitude, whatever its λ.
    """

    effect: str
    size: float
    sign: int = 1
    amplitude: float | None = None

    @property
    def text(self) -> str:
        """``coulomb_friction+10``; with an amplitude ``viscous_friction=60000``."""
        if self.amplitude is not None:
            return f"{self.effect}={self.sign * self.amplitude:g}"
        return f"{self.effect}{'+' if self.sign > 0 else '-'}{self.size:g}"


@dataclass(frozen=True)
class Scenario:
    """A campaign to make and to diagnose; fixes everything except the amplitudes.

    Attributes
    ----------
    kind: of the trial; with "removed" the library used for the diagnosis lacks the hidden effects.
    hidden: none, one or two effects with the wanted sizes.
    noise: "white", "coloured" (correlation 0.6), "ten_bits" (quantised), "scatter" (0.2 % of the pressure
        setting), or "all" three.
    repeated: number of conditions that are measured twice.
    noise_known: the diagnosis is given the standard deviations instead of estimating them.
    """

    kind: Kind
    hidden: tuple[Wanted, ...] = ()
    shape: Shape = "other"
    noise: NoiseVariant = "white"
    chamber_pressures: bool = False
    repeated: int = 4
    noise_known: bool = False
    seed: int = 0
    temperatures: tuple[float, ...] = field(default=TEMPERATURES)
    pressures: tuple[float, ...] = field(default=PRESSURES)

    def __post_init__(self) -> None:
        count = {"nothing": (0,), "one": (1,), "two": (2,), "removed": (1, 2)}[self.kind]
        if len(self.hidden) not in count:
            raise ValueError(f"a scenario of kind {self.kind} cannot hide {len(self.hidden)} effects")

    @property
    def name(self) -> str:
        """All of it in one line, unique: ``one coulomb_friction+10 other white chambers 4 7x4 seed 3``."""
        effects = " ".join(wanted.text for wanted in self.hidden)
        sensors = "chambers" if self.chamber_pressures else "published"
        grid = f"{self.repeated} {len(self.temperatures)}x{len(self.pressures)}"
        noise = f"{self.noise} known" if self.noise_known else self.noise
        parts = (self.kind, effects, self.shape if self.hidden else "", noise, sensors, grid)
        return " ".join([*filter(None, parts), f"seed {self.seed}"])

    @property
    def truth(self) -> tuple[str, ...]:
        """The names of the hidden effects."""
        return tuple(wanted.effect for wanted in self.hidden)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the library used for the diagnosis must lack."""
        return self.truth if self.kind == "removed" else ()

    @property
    def plain(self) -> Campaign:
        """The campaign with its noise, and nothing hidden."""
        noise, scatter = noise_of(self.noise)
        return Campaign(
            noise=noise,
            scatter=scatter,
            temperatures=self.temperatures,
            pressures=self.pressures,
            repeated=self.repeated,
            chamber_pressures=self.chamber_pressures,
            seed=self.seed,
        )

    def campaign(self, amplitudes: Sequence[float]) -> Campaign:
        """The campaign that hides its effects with these amplitudes (SI, signed), one for each.

        The bench is one of many that agree with its drawings: see `TOLERANCES`.
        """
        pairs = [(find_hidden(w.effect), a) for w, a in zip(self.hidden, amplitudes, strict=True)]
        return hide(replace(self.plain, bench=self._bench()), pairs, self.shape)

    def _bench(self) -> BenchParameters:
        """The bench as built: it deviates from its drawings by up to two standard deviations."""
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(self.seed, spawn_key=(0,))))
        drawn = BenchParameters()
        for name, std in TOLERANCES.items():
            off = float(np.clip(rng.standard_normal(), -2.0, 2.0))
            drawn = drawn._replace(**{name: getattr(drawn, name) + std * off})
        return drawn

    def document(self) -> dict[str, Any]:
        """The scenario as plain data."""
        return {
            "kind": self.kind,
            "hidden": [vars(wanted) for wanted in self.hidden],
            "shape": self.shape,
            "noise": self.noise,
            "chamber_pressures": self.chamber_pressures,
            "repeated": self.repeated,
            "noise_known": self.noise_known,
            "seed": self.seed,
            "temperatures": list(self.temperatures),
            "pressures": list(self.pressures),
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Scenario:
        """The scenario that `document` describes."""
        fields = dict(document)
        fields["hidden"] = tuple(Wanted(**wanted) for wanted in fields["hidden"])
        fields["temperatures"], fields["pressures"] = (
            tuple(fields["temperatures"]),
            tuple(fields["pressures"]),
        )
        return cls(**fields)


def noise_of(variant: NoiseVariant) -> tuple[Noise, Scatter]:
    """Noise of every sample and scatter from run to run."""
    coloured = variant in ("coloured", "all")
    stepped = variant in ("ten_bits", "all")
    scattered = variant in ("scatter", "all")
    return (
        Noise(correlation=CORRELATION if coloured else 0.0, step=dict(TEN_BITS) if stepped else {}),
        Scatter(setting=SCATTER if scattered else 0.0),
    )
