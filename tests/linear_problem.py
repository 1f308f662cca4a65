"""A bench that is linear in everything: measurements whose every answer has a closed form.

    y_k = Σ_j θ_j·J_kj + Σ_i φ_i·S_ki + u_k·z_k + ε_k,    ε ~ N(0, R),   u_k ~ N(0, g²)

θ are the model's free parameters, φ those of effects that it may lack, u_k a zero of each record. There are
no equations: the readings' derivatives are given, and `LinearProblem` hands them to whoever has a problem
simulated. What is asked of it is answered here a second time, by dense linear algebra with the records' zeros
taken into the covariance, ``V = R + g²·zzᵀ``:

    Q = V⁻¹ − V⁻¹J(JᵀV⁻¹J)⁻¹JᵀV⁻¹,    χ² = yᵀQy,    z_i = s_iᵀQy/√(s_iᵀQs_i)
    cos_ij = s_iᵀQs_j/√(s_iᵀQs_i·s_jᵀQs_j),    κ_i² = s_iᵀQs_i/s_iᵀR⁻¹s_i
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.fitting import fit_problem
from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.record_level import RecordLevel
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.engine.trajectories import Statistics, Trajectories
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.unknowns import LocalUnknown, shared_unknowns
from rigctl.model.measured.noise import DataNoise
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model, Value
from rigctl.noise import ChannelNoise, NoiseModel, whiten
from rigctl.physics.family import ModelFamily, OutputVariable, ParameterDeclaration, Slot

Floats = NDArray[np.float64]

CHANNELS = ("left", "right")
PHASES = ("rest", "move")
SAMPLES = 12
TEMPERATURES, PRESSURES = (20.0, 40.0, 60.0, 80.0), (1.0, 3.0)
RECORDS = len(TEMPERATURES) * len(PRESSURES)
NUISANCES = ("offset", "gain", "slope")
ZERO, ZERO_STD = "record.zero", 3.0
SIGMA = 0.5

FAMILY = ModelFamily(
    name="linear",
    title="A linear bench",
    source="tests/linear_problem.py",
    states=(),
    inputs=(),
    parameters=tuple(ParameterDeclaration(name, "1", 10.0, name, low=-float("inf")) for name in NUISANCES),
    definitions=(),
    slots=(Slot("anywhere", "1", "where effects act"),),
    outputs=tuple(
        OutputVariable(name, "1", lambda m: m.offset + m.total("anywhere"), name) for name in CHANNELS
    ),
    generic=False,
)


def made_effect(name: str, **changed: Any) -> Effect:
    """An effect of one parameter, `size`, that may have either sign."""
    declared: dict[str, Any] = {
        "summary": f"{name} acts",
        "equation": "size",
        "source": "tests/linear_problem.py",
        "looks_like": f"what {name} does",
        "terms": (("anywhere", lambda m, p: p.size),),
        "parameters": (made_parameter("size"),),
        "own_family": FAMILY,
    }
    return Effect(name, FAMILY.name, **(declared | changed))


def made_parameter(name: str, low: float = -1e4, high: float = 1e4, start: float = 1.0) -> EffectParameter:
    """A parameter that is off at 0; one-sided where a bound is 0."""
    return EffectParameter(name, "1", 0.0, start, low, high, name)


NAMES = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta")
#: effects of one parameter each, which may have either sign
PLAIN = tuple(made_effect(name) for name in NAMES)


def random_gram(rng: np.random.Generator, count: int, directions: int) -> Floats:
    """The products of so many signatures of one sigma that point anywhere in so many directions."""
    drawn = rng.standard_normal((count, directions))
    drawn /= np.linalg.norm(drawn, axis=1)[:, None]
    return np.asarray(drawn @ drawn.T)


@dataclass(frozen=True)
class Design:
    """What acts on the readings, and how.

    Attributes
    ----------
    effects: of the library.
    columns: (records·n·channels) of each parameter, the model's and the effects': the readings' derivative.
    noise: of the readings.
    """

    effects: tuple[Effect, ...]
    columns: Mapping[str, Floats] = field(repr=False)
    noise: NoiseModel

    @cached_property
    def noise_alone(self) -> Floats:
        """R."""
        times = np.arange(float(SAMPLES))
        one = np.zeros((SAMPLES * len(CHANNELS),) * 2)
        for c, channel in enumerate(self.noise.channels):
            one[c :: len(CHANNELS), c :: len(CHANNELS)] = channel.covariance(times, self.noise.spacing)
        return np.asarray(block_diag(*[one] * RECORDS))

    @cached_property
    def covariance(self) -> Floats:
        """V: noise, with the records' zeros integrated out."""
        zero = np.zeros(SAMPLES * len(CHANNELS))
        zero[:: len(CHANNELS)] = ZERO_STD  # it is the left channel's
        return np.asarray(self.noise_alone + block_diag(*[np.outer(zero, zero)] * RECORDS))

    @cached_property
    def root(self) -> Floats:
        """L, V = LLᵀ."""
        return np.asarray(np.linalg.cholesky(self.covariance))

    @cached_property
    def white(self) -> dict[str, Floats]:
        """L⁻¹ of every parameter's derivative."""
        found = np.linalg.solve(self.root, self.matrix(list(self.columns)))
        return dict(zip(self.columns, found.T, strict=True))

    def matrix(self, names: Sequence[str]) -> Floats:
        """(values, names) derivatives."""
        return np.column_stack([self.columns[name] for name in names])

    def left_over(self, y: Floats, free: Sequence[str]) -> Floats:
        """L⁻¹y less what these parameters explain of it: its square is yᵀQy."""
        matrix = np.column_stack([self.white[name] for name in free])
        white = np.linalg.solve(self.root, y)
        return np.asarray(white - matrix @ np.linalg.lstsq(matrix, white, rcond=None)[0])

    def chi2(self, y: Floats, effects: Sequence[str] = ()) -> float:
        """yᵀQy, with every parameter of these effects fitted too."""
        left = self.left_over(y, [*NUISANCES, *self.parameters(effects)])
        return float(left @ left)

    def mbic(self, y: Floats, effects: Sequence[str] = ()) -> float:
        """χ² + k·ln N_eff + 2·m·ln K, K effects in the library."""
        rho = self.noise.channels[0].correlation
        price = math.log(y.size * (1.0 - rho) / (1.0 + rho))
        names = self.parameters(effects)
        return self.chi2(y, effects) + len(names) * price + 2.0 * len(effects) * math.log(len(self.effects))

    def parameters(self, effects: Sequence[str]) -> list[str]:
        """Their parameters, with the names that they have in a system."""
        return [name for name in self.columns if name.partition(".")[0] in effects]

    def signature(self, name: str) -> Floats:
        """L⁻¹s less what the model's own parameters do: its square is sᵀQs."""
        return self.left_over(self.columns[name], NUISANCES)

    def typical_noise(self, seed: int = 0) -> Floats:
        """Noise that no parameter explains anything of, and whose χ² is what is expected of it exactly.

        With it every test of what acts has the value that it has on the average.
        """
        known = np.column_stack([self.matrix(list(self.columns)), _regions()])
        inverse = np.linalg.inv(self.covariance)
        drawn = self.root @ np.random.default_rng(seed).standard_normal(len(inverse))
        inner = known.T @ inverse
        drawn = drawn - known @ (np.linalg.pinv(inner @ known) @ (inner @ drawn))
        wanted = drawn.size - len(NUISANCES)
        return np.asarray(drawn * np.sqrt(wanted / (drawn @ inverse @ drawn)))

    def drawn_noise(self, rng: np.random.Generator) -> Floats:
        """Noise as the bench makes it, the records' zeros among it."""
        return np.asarray(self.root @ rng.standard_normal(len(self.root)))

    def readings(self, sizes: Mapping[str, float], noise: Floats) -> Floats:
        """(records·n·channels) what is measured with parameters of effects at these values."""
        truth = {**dict.fromkeys(NUISANCES, 10.0), **sizes}
        return np.asarray(noise + sum(value * self.columns[name] for name, value in truth.items()))

    def model(self) -> Model:
        """That has none of the effects."""
        known = {name: Value(10.0, fit=True) for name in NUISANCES}
        return Model(FAMILY, parameters=known, own_effects=self.effects)


def _regions() -> Floats:
    """Columns that span the plane test's: each phase and channel, with its temperature and pressure."""
    found = []
    for phase in range(len(PHASES)):
        for channel in range(len(CHANNELS)):
            inside = np.zeros((SAMPLES, len(CHANNELS)))
            inside[phase * SAMPLES // 2 : (phase + 1) * SAMPLES // 2, channel] = 1.0
            planes = np.array([[1.0, t, p, t * p] for t in TEMPERATURES for p in PRESSURES])
            found += [np.concatenate([inside.ravel() * at for at in column]) for column in planes.T]
    return np.column_stack(found)


@dataclass(frozen=True)
class LinearProblem(Problem):
    """A problem whose readings are linear in every parameter: it is never compiled nor integrated."""

    design: Design = field(kw_only=True, repr=False)

    def simulate(
        self, shared: Floats, local: Sequence[Floats], columns: Sequence[str] = (), *, initial: bool = False
    ) -> Trajectories:
        """The sum of what every parameter does."""
        names = self.compiled.system.parameter_names
        values = dict(zip(names, self.base.tolist(), strict=True))
        values |= {u.name: float(v) for u, v in zip(self.shared, shared, strict=True)}
        outputs, slopes = [], []
        for k, own in zip((int(one.index) for one in self.records), local, strict=True):
            moved = dict(zip((one.name for one in self.local[0]), own.tolist(), strict=True))
            outputs.append(sum(v * self._of(name, k) for name, v in (values | moved).items()))
            slopes.append(np.stack([self._of(name, k) for name in columns], axis=2) if columns else _NONE)
        count = len(outputs)
        return Trajectories(
            names=("",) * count,
            times=tuple(record.times for record in self.records),
            states=(np.empty((SAMPLES, 0)),) * count,
            outputs=tuple(outputs),
            sensitivities=tuple(slopes),
            failures=(None,) * count,
            state_names=(),
            output_names=CHANNELS,
            columns=tuple(columns),
            stats=(Statistics(0, 0, 0),) * count,
        )

    def _of(self, name: str, k: int) -> Floats:
        """(n, channels) of record k: the derivative by one parameter."""
        if name == ZERO:
            return np.column_stack([np.ones(SAMPLES), np.zeros(SAMPLES)])
        if name.startswith("disturbance."):  # the location of a misfit is unknown
            return np.zeros((SAMPLES, len(CHANNELS)))
        return self.design.columns[name].reshape(RECORDS, SAMPLES, len(CHANNELS))[k]

    def for_model(  # type: ignore[override]
        self, model: Model, noise: NoiseModel | None = None, *_: Any, library: bool = False, **__: Any
    ) -> LinearProblem:
        """Another model on the same readings."""
        return linear_problem(
            self.design, self.measurements, model, self.noise if noise is None else noise, library=library
        )


_NONE = np.empty((SAMPLES, len(CHANNELS), 0))


def linear_problem(
    design: Design, measurements: Measurements, model: Model, noise: NoiseModel, *, library: bool = False
) -> LinearProblem:
    """A model on measurements; with `library` the other effects are there at their null."""
    present = [effect.name for effect in design.effects if library or effect.name in model.effects]
    names = [*NUISANCES, *design.parameters(present)]
    system = SimpleNamespace(
        parameter_names=tuple(names), output_names=CHANNELS, outputs=CHANNELS, state_names=()
    )
    compiled: Any = SimpleNamespace(system=system, cascade=None)
    zero = LocalUnknown(ZERO, Unknown(ZERO, 0.0, scale=ZERO_STD, prior=Prior(0.0, ZERO_STD)))
    ok = np.ones((SAMPLES, len(CHANNELS)), bool)
    records = measurements.records
    return LinearProblem(
        model=model,
        measurements=measurements,
        noise=noise,
        ok=(ok,) * len(records),
        compiled=compiled,
        level=RecordLevel(),
        shared=tuple(shared_unknowns(model)),
        local=((zero,),) * len(records),
        whiteners=(whiten(noise, records[0].times, ok),) * len(records),
        base=np.array([model.values.get(name, 0.0) for name in names]),
        starts=(np.empty(0),) * len(records),
        design=design,
    )


def measured(y: Floats) -> Measurements:
    """The readings as records at two operating variables."""
    points = [(t, p) for t in TEMPERATURES for p in PRESSURES]
    values = y.reshape(RECORDS, SAMPLES, len(CHANNELS))
    records = tuple(
        MeasuredRecord(
            run="r",
            index=k,
            label=f"r/{k + 1}",
            times=np.arange(float(SAMPLES)),
            switch_times=np.array([0.0]),
            switch_half=np.zeros(1),
            inputs=np.zeros((1, 0)),
            values=values[k],
            condition={"oil": 273.15 + t, "pressure": 1e5 * p},
            group=k,
            phase=np.repeat(np.arange(len(PHASES)), SAMPLES // len(PHASES)),
            phases=PHASES,
        )
        for k, (t, p) in enumerate(points)
    )
    return Measurements(CHANNELS, ("1", "1"), (), records, None, ("r",))


def compared(design: Design, y: Floats, *, excluded: Sequence[str] = ()) -> ModelComparison:
    """The model that has no effect, fitted to readings and tested."""
    measurements = measured(y)
    problem = linear_problem(design, measurements, design.model(), design.noise)
    fitted = fit_problem(problem, DataNoise(design.noise, problem.ok))
    return judge(fitted, "plain", excluded=excluded)


def made_noise(correlation: float = 0.0, white: float = 0.0) -> NoiseModel:
    """Known noise, the same on both channels."""
    return NoiseModel(
        tuple(
            ChannelNoise(name, SIGMA, correlation, source="quiet", guessed=False, white=white)
            for name in CHANNELS
        ),
        1.0,
    )


def made_design(
    effects: Sequence[Effect],
    gram: Floats,
    *,
    kappa: float = 0.6,
    correlation: float = 0.0,
    seed: int = 0,
) -> Design:
    """A design in which the signatures have exactly these products, sigmas squared for each unit.

    Parameters
    ----------
    effects: their parameters, in order, are the rows of `gram`.
    gram: (parameters, parameters) s̃ᵀs̃ once the fitted parameters have done what they can.
    kappa: the share of each signature that is left of it then, the records' zeros being left aside.
    """
    rng = np.random.default_rng(seed)
    count = RECORDS * SAMPLES * len(CHANNELS)
    noise = made_noise(correlation)
    base = {name: rng.standard_normal(count) for name in NUISANCES}
    plain = Design((), base, noise)
    names = [f"{effect.name}.{parameter.name}" for effect in effects for parameter in effect.parameters]
    raw = rng.standard_normal((count, len(names)))
    inverse = np.linalg.inv(plain.covariance)
    keep = np.column_stack([plain.matrix(NUISANCES), _regions()])
    inner = keep.T @ inverse
    raw = raw - keep @ (np.linalg.pinv(inner @ keep) @ (inner @ raw))
    root = np.linalg.cholesky(raw.T @ inverse @ raw)
    values, vectors = np.linalg.eigh(np.asarray(gram, dtype=float))
    wanted = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    signatures = np.linalg.solve(root, raw.T).T @ wanted
    # what a fitted parameter takes over: as much of each signature as leaves the share κ of it
    hider = base[NUISANCES[0]] / np.sqrt(base[NUISANCES[0]] @ inverse @ base[NUISANCES[0]])
    lengths = np.sqrt(np.maximum(np.diag(np.asarray(gram, dtype=float)), 0.0))
    hidden = np.outer(hider, lengths * np.sqrt(1.0 / kappa**2 - 1.0))
    return replace(
        plain,
        effects=tuple(effects),
        columns={**base, **dict(zip(names, (signatures + hidden).T, strict=True))},
    )
