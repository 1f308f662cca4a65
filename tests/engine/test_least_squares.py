"""The fit compared with SciPy on dense problems and with exact solutions, and its failures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import islice
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import least_squares as scipy_least_squares
from scipy.optimize import lsq_linear

from rigctl.engine.compile import CompiledSystem
from rigctl.engine.least_squares import (
    Block,
    Iteration,
    LeastSquaresResult,
    Options,
    Outcome,
    Prior,
    Refused,
    Unknown,
    least_squares,
    multi_start,
    null_columns,
)
from rigctl.engine.least_squares.solve import attempts
from rigctl.engine.least_squares.state import State, Task, Trust
from rigctl.engine.simulate import simulate
from rigctl.errors import RigctlError

Floats = NDArray[np.float64]
T = np.linspace(0.0, 3.0, 40)


class Decays:
    """Records ``y = offset_k + amplitude·exp(-rate·t)·level_k`` with noise: rate and amplitude are shared."""

    def __init__(self, records: int = 5, seed: int = 1) -> None:
        random = np.random.default_rng(seed)
        self.levels = np.linspace(1.0, 2.0, records)
        self.offsets = random.normal(size=records)
        self.sigma = 0.02
        clean = self.model(np.array([3.0, 1.3]), [np.array([offset]) for offset in self.offsets])
        self.data = [y + self.sigma * random.normal(size=T.size) for y in clean]
        self.calls = 0

    def model(self, shared: Floats, local: Sequence[Floats]) -> list[Floats]:
        decay = shared[0] * np.exp(-shared[1] * T)
        return [own[0] + level * decay for own, level in zip(local, self.levels, strict=True)]

    def __call__(self, shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        self.calls += 1
        decay = np.exp(-shared[1] * T)
        blocks = []
        for y, seen, level in zip(self.model(shared, local), self.data, self.levels, strict=True):
            by_shared = level * np.column_stack([decay, -shared[0] * T * decay]) / self.sigma
            by_own = np.ones((T.size, 1)) / self.sigma
            residual = (y - seen) / self.sigma
            blocks.append(Block(residual, by_shared, by_own) if derivatives else Block(residual))
        return blocks

    def unknowns(self, **changes: object) -> list[Unknown]:
        return [
            Unknown("amplitude", **{"start": 1.0, "lower": 0.1, "upper": 20.0, **changes}),  # type: ignore[arg-type]
            Unknown("rate", start=0.5, lower=0.01, upper=10.0, unit="1/s"),
        ]

    def local(self) -> list[list[Unknown]]:
        return [[Unknown("offset", start=0.0, scale=1.0)] for _ in self.levels]

    def dense(self, x: Floats) -> Floats:
        return np.concatenate(
            [b.residual for b in self(x[:2], [x[2 + k : 3 + k] for k in range(len(self.levels))], False)]
        )

    def dense_jacobian(self, x: Floats) -> Floats:
        records = len(self.levels)
        jacobian = np.zeros((records * T.size, 2 + records))
        for k, block in enumerate(self(x[:2], [x[2 + k : 3 + k] for k in range(records)], True)):
            rows = slice(k * T.size, (k + 1) * T.size)
            jacobian[rows, :2] = block.shared
            jacobian[rows, 2 + k : 3 + k] = block.local
        return jacobian

    def scipy(self, **options: object) -> object:
        start = np.array([1.0, 0.5, *np.zeros(len(self.levels))])
        lower = np.array([0.1, 0.01, *np.full(len(self.levels), -np.inf)])
        upper = np.array([options.pop("most_amplitude", 20.0), 10.0, *np.full(len(self.levels), np.inf)])
        return scipy_least_squares(
            self.dense,
            start,
            self.dense_jacobian,
            (lower, upper),
            xtol=1e-12,
            ftol=1e-14,
            gtol=1e-12,
            **options,  # type: ignore[arg-type]
        )


def everything(result: LeastSquaresResult) -> Floats:
    return np.concatenate([result.values, *result.local])


def test_the_optimum_and_covariance_agree_with_a_dense_solver() -> None:
    problem = Decays()
    result = least_squares(problem, problem.unknowns(), problem.local())
    dense = problem.scipy()
    assert result.converged
    assert everything(result) == pytest.approx(dense.x, rel=1e-6)
    assert result.cost == pytest.approx(dense.cost, rel=1e-12)
    inverse = np.linalg.inv(dense.jac.T @ dense.jac)
    assert result.covariance == pytest.approx(inverse[:2, :2], rel=1e-4)
    local = np.array([std[0] for std in result.local_std])
    assert local == pytest.approx(np.sqrt(np.diag(inverse))[2:], rel=1e-4)
    size = np.sqrt(np.diag(inverse)[:2])
    assert result.correlation == pytest.approx(inverse[:2, :2] / np.outer(size, size), rel=1e-4)
    assert result.residual_count == 200
    assert result.parameter_count == 7
    assert 0.7 < result.variance_factor < 1.3
    assert abs(result.value("rate") - 1.3) < 4.0 * result.std[1]


def test_a_parameter_at_its_bound_does_not_stall_the_others() -> None:
    problem = Decays()
    result = least_squares(problem, problem.unknowns(upper=2.0), problem.local())
    dense = problem.scipy(most_amplitude=2.0)
    assert result.converged
    assert result.value("amplitude") == 2.0
    assert result.at_bound == ("amplitude",)
    assert everything(result) == pytest.approx(dense.x, rel=1e-4, abs=1e-4)
    assert result.std[0] == 0.0
    assert result.parameter_count == 6
    assert "held at its bound" in result.summary()


@pytest.mark.parametrize("upper", [20.0, 2.0])
def test_a_linear_unknown_is_neither_damped_nor_limited(upper: float) -> None:
    vague, calls, ends = Prior(mean=0.0, std=1e3), [], []
    for linear in (False, True):
        problem = Decays()
        small = {"start": 0.1, "scale": 1e-3, "upper": upper, "prior": vague}
        result = least_squares(problem, problem.unknowns(**small, linear=linear), problem.local())
        assert result.converged
        calls.append(problem.calls)
        ends.append(everything(result))
    assert ends[1] == pytest.approx(problem.scipy(most_amplitude=upper).x, rel=1e-4, abs=1e-4)  # type: ignore[attr-defined]
    assert calls[1] < 20
    assert calls[0] > 1.5 * calls[1], "limited to a part of its size, it creeps"


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_bounded_linear_problems_agree_with_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    shared_size, own_size, records = 4, 2, 3
    shared = [random.normal(size=(12, shared_size)) for _ in range(records)]
    own = [random.normal(size=(12, own_size)) for _ in range(records)]
    target = [random.normal(size=12) for _ in range(records)]

    def evaluate(g: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        return [
            Block(a @ g + b @ own_g - y, a, b)
            for a, b, own_g, y in zip(shared, own, local, target, strict=True)
        ]

    reach = 0.15
    unknowns = [Unknown(f"g{i}", 0.0, -reach, reach) for i in range(shared_size)]
    local = [[Unknown(f"l{i}", 0.0, -reach, reach) for i in range(own_size)] for _ in range(records)]
    matrix = np.zeros((12 * records, shared_size + own_size * records))
    for k in range(records):
        rows = slice(12 * k, 12 * (k + 1))
        matrix[rows, :shared_size] = shared[k]
        matrix[rows, shared_size + own_size * k : shared_size + own_size * (k + 1)] = own[k]
    dense = lsq_linear(matrix, np.concatenate(target), (-reach, reach), method="bvls")
    result = least_squares(evaluate, unknowns, local, options=Options(largest_step=10.0, cost=1e-13))
    assert result.cost == pytest.approx(dense.cost, rel=1e-7)
    assert np.abs(everything(result)).max() <= reach


def test_each_prior_counts_as_one_more_observation() -> None:
    problem = Decays(records=2)
    prior = Prior(mean=2.0, std=0.001)
    held = least_squares(problem, problem.unknowns(prior=prior), problem.local())
    free = least_squares(problem, problem.unknowns(), problem.local())
    information = 1.0 / held.std[0] ** 2 - 1.0 / prior.std**2
    assert information == pytest.approx(1.0 / free.std[0] ** 2, rel=0.2)
    assert abs(held.value("amplitude") - 2.0) < abs(free.value("amplitude") - 2.0)
    share = 0.5 * ((held.value("amplitude") - 2.0) / 0.001) ** 2
    data = 0.5 * sum(float(b.residual @ b.residual) for b in problem(held.values, held.local, False))
    assert held.cost == pytest.approx(share + data, rel=1e-9)


def test_a_parameter_without_influence_is_refused_unless_it_has_a_prior() -> None:
    problem = Decays()

    def with_null(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        blocks = problem(shared[:2], local, derivatives)
        if not derivatives:
            return blocks
        return [Block(b.residual, np.column_stack([b.shared, np.zeros(T.size)]), b.local) for b in blocks]

    with pytest.raises(RigctlError, match=r"does not act on any residual, got 'barus'.*prior"):
        least_squares(with_null, [*problem.unknowns(), Unknown("barus", 1.0)], problem.local())
    prior = Unknown("barus", 1.0, prior=Prior(3.0, 0.5))
    result = least_squares(with_null, [*problem.unknowns(), prior], problem.local())
    assert result.value("barus") == pytest.approx(3.0)
    assert result.std[2] == pytest.approx(0.5)
    blocks = with_null(np.ones(3), [np.zeros(1)] * 5, True)
    assert null_columns(blocks, ["amplitude", "rate", "barus"]) == ("barus",)


def test_a_combination_not_determined_by_the_data_is_reported() -> None:
    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        pressure, area, friction = shared
        force = 1e5 * T * (1.0 + pressure + area) - friction * T**2
        columns = np.column_stack([1e5 * T, 1e5 * T, -(T**2)])
        return [Block(force - 1.5e5 * T, columns)]

    unknowns = [Unknown("pressure_gain", 0.1), Unknown("area_gain", 0.1), Unknown("friction", 10.0, unit="N")]
    result = least_squares(evaluate, unknowns, [()])
    assert len(result.weak) == 1
    parts = dict(result.weak[0].parts)
    assert parts == pytest.approx({"pressure_gain": math.sqrt(0.5), "area_gain": -math.sqrt(0.5)})
    assert "not determined by these data: +0.71·pressure_gain -0.71·area_gain" in result.summary()
    assert np.isinf(result.std[:2]).all()
    assert np.isfinite(result.std[2])
    assert result.singular_values[-1] < 1e-8
    assert np.isfinite(result.correlation).all()


@pytest.mark.parametrize("accuracy", [0.0, 0.02])
def test_a_combination_is_not_determined_by_the_errors_of_derivatives(accuracy: float) -> None:
    """Two parameters act alike, and the columns of the two differ by an error of 1 %."""
    noise = np.random.default_rng(2).standard_normal((2, T.size))
    columns = np.column_stack([T * (1.0 + 0.01 * noise[0]), T * (1.0 + 0.01 * noise[1]), T**2])

    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        return [Block(T * (shared[0] + shared[1] - 0.5) + T**2 * shared[2], columns)]

    unknowns = [Unknown(name, 0.1) for name in ("one", "other", "third")]
    result = least_squares(evaluate, unknowns, [()], options=Options(accuracy=lambda: accuracy))
    assert len(result.weak) == (1 if accuracy else 0)
    assert np.isinf(result.std[:2]).all() == bool(accuracy)
    assert np.isfinite(result.std[2])


def test_parameters_of_very_different_size_are_fitted_accurately() -> None:
    """A leakage of 1e-15 beside a pressure of 1e6, without loss by rounding."""
    exact = np.array([2.3e-15, 4.5e6, -0.7])

    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        columns = np.column_stack([T * 1e15, np.cos(T) * 1e-6, T**2])
        return [Block(columns @ (shared - exact), columns)]

    unknowns = [Unknown("leakage", 1e-15), Unknown("pressure", 1e6), Unknown("gain", 1.0)]
    result = least_squares(evaluate, unknowns, [()])
    assert result.values == pytest.approx(exact, rel=1e-9)
    assert result.weak == ()


def test_steps_that_the_model_refuses_are_rejected() -> None:
    problem = Decays()
    told: list[Iteration] = []

    def picky(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        if told and len(told) < 3:
            return Refused("not yet")
        return problem(shared, local, derivatives)

    result = least_squares(picky, problem.unknowns(), problem.local(), progress=told.append)
    assert result.value("rate") == pytest.approx(1.3, abs=0.01)
    assert [one.reason for one in told[:4]] == ["", "not yet", "not yet", ""]
    assert [one.accepted for one in told[1:3]] == [False, False]
    assert [one.number for one in told] == list(range(1, len(told) + 1))
    costs = [one.cost for one in told if one.accepted]
    assert costs == sorted(costs, reverse=True)


def test_steps_to_residuals_that_are_not_finite_are_rejected() -> None:
    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(shared[0] - T)
            return [Block(root - np.sqrt(5.0 - T), (0.5 / root)[:, None])]

    result = least_squares(evaluate, [Unknown("a", 40.0, scale=200.0)], [()])
    assert result.value("a") == pytest.approx(5.0)
    with pytest.raises(RigctlError, match=r"no value at the start of the fit: a residual is not a finite"):
        least_squares(evaluate, [Unknown("a", 1.0)], [()])


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.2, 18.0), st.floats(0.02, 9.0), st.sampled_from([20.0, 2.9]))
def test_a_search_continued_from_any_of_its_states_goes_the_same_way(
    seed: int, amplitude: float, rate: float, most: float
) -> None:
    problem = Decays(records=2, seed=seed)
    unknowns = [
        Unknown("amplitude", min(amplitude, most), 0.1, most),
        Unknown("rate", rate, 0.01, 10.0, prior=Prior(1.0, 2.0)),
    ]
    task = Task.of(problem, unknowns, problem.local(), Options(iterations=12))
    blocks = task.blocks(task.start, derivatives=True)
    assert not isinstance(blocks, Refused)
    at = task.linearised(task.start, task.cost(blocks, task.start), blocks)
    first = State(at, Trust(0.3))

    def went(state: State) -> list[tuple[object, ...]]:
        """Every attempt from there, with all digits."""
        return [
            (one.state.at.flat.tobytes(), one.state.at.cost, one.state.trust, one.accepted, one.ended)
            for one in islice(attempts(state), 12)
        ]

    states = [one.state for one in islice(attempts(first), 12)]
    whole = went(first)
    # continued after the search has ended, from states that it left long ago
    for number in {1, len(states) // 2} - {0}:
        assert went(states[number - 1])[: len(whole) - number] == whole[number:]
    found = least_squares(problem, unknowns, problem.local(), options=task.options)
    assert (found.cost, found.iterations) == (states[-1].at.cost, len(states))


def test_the_outcome_of_a_fit_is_reported() -> None:
    problem = Decays()
    short = least_squares(problem, problem.unknowns(), problem.local(), options=Options(iterations=2))
    assert short.outcome is Outcome.ITERATIONS
    assert not short.converged
    assert short.iterations == 2

    def perfect(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        return [Block(shared[0] * T - 2.0 * T, T[:, None])]

    done = least_squares(perfect, [Unknown("a", 2.0)], [()])
    assert done.outcome is Outcome.GRADIENT
    assert done.converged

    def lying(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        return [Block(np.array([1.0 + (shared[0] - 1.0) ** 2]), np.array([[-1.0]]))]

    stalled = least_squares(lying, [Unknown("a", 1.0)], [()])
    assert stalled.outcome is Outcome.STALLED
    assert not stalled.converged


def test_the_summary_lists_the_parameters_with_units_and_the_variance_factor() -> None:
    problem = Decays()
    text = least_squares(problem, problem.unknowns(), problem.local()).summary()
    assert "variance factor" in text
    assert "  rate = 1.3" in text
    assert "1/s" in text


def test_multi_start_finds_the_lowest_of_several_minima() -> None:
    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        wave, slope = np.sin(shared[0] * T), T * np.cos(shared[0] * T)
        return [Block(wave - np.sin(7.0 * T), slope[:, None])]

    unknown = Unknown("frequency", 1.0, lower=0.5, upper=12.0)
    alone = least_squares(evaluate, [unknown], [()])
    assert abs(alone.value("frequency") - 7.0) > 1.0
    several = multi_start(evaluate, [unknown], [()], count=16, seed=3)
    assert several.best.value("frequency") == pytest.approx(7.0)
    assert len(several.costs) == 16
    assert several.costs[0] == pytest.approx(alone.cost)
    assert several.agreeing >= 1
    assert "starts reached the best cost" in several.summary()
    again = multi_start(evaluate, [unknown], [()], count=16, seed=3)
    assert again.costs == several.costs


def test_starts_without_a_value_are_skipped_and_refused_if_no_other_is_left() -> None:
    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        if shared[0] > 3.0:
            return Refused("too high")
        return [Block((shared[0] - 2.0) * T, T[:, None])]

    result = multi_start(evaluate, [Unknown("a", 5.0, lower=0.0, upper=10.0)], [()], count=6)
    assert result.costs[0] == math.inf
    assert result.best.value("a") == pytest.approx(2.0)
    with pytest.raises(RigctlError, match="too high"):
        multi_start(evaluate, [Unknown("a", 5.0, lower=4.0, upper=10.0)], [()], count=3)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"start": math.nan}, "its start is not a finite number"),
        ({"start": 1.0, "lower": 2.0, "upper": 3.0}, "outside its bounds 2 … 3"),
        ({"start": 1.0, "lower": 3.0, "upper": 2.0}, "lower bound is not below"),
        ({"start": 1.0, "scale": 0.0}, "its scale is not positive"),
        ({"start": 1.0, "prior": Prior(0.0, 0.0)}, "no positive standard deviation"),
        ({"start": 1.0, "linear": True}, "it is linear, and has no prior"),
    ],
)
def test_an_invalid_unknown_is_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(RigctlError, match=f"parameter k: .*{message}"):
        Unknown("k", **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda b: b[:-1], "the fit returned 4 records; expected 5"),
        (
            lambda b: [Block(x.residual, x.shared, None) for x in b],
            "record 1: derivatives by the record-level",
        ),
        (
            lambda b: [Block(x.residual, x.shared[:, :1], x.local) for x in b],
            r"shape \(40, 1\); expected \(40, 2\)",
        ),
        (lambda b: [Block(x.residual, x.shared * np.nan, x.local) for x in b], "not finite"),
    ],
)
def test_blocks_of_the_wrong_shape_are_refused(
    spoil: Callable[[list[Block]], list[Block]], message: str
) -> None:
    problem = Decays()
    with pytest.raises(RigctlError, match=message):
        least_squares(lambda s, o, d: spoil(problem(s, o, d)), problem.unknowns(), problem.local())


def test_an_unknown_name_is_refused_with_the_nearest_one() -> None:
    problem = Decays()
    result = least_squares(problem, problem.unknowns(), problem.local())
    with pytest.raises(RigctlError, match=r"unknown fitted parameter, got 'rat'.*'rate'"):
        result.value("rat")
    with pytest.raises(AttributeError):
        result.cost = 0.0  # type: ignore[misc]


def test_a_fit_to_the_cylinder_recovers_the_truth_from_30_percent_off(
    cylinder: ModuleType, cylinder_compiled: CompiledSystem
) -> None:
    """Three parameters start 30 % off; the initial pressure of each record is fitted too."""
    names = ["valve_area", "viscous_damping", "spool_time"]
    records = cylinder.campaign()[::9]
    nominal = {name: value for name, (_, value, _) in cylinder.PARAMETERS.items()}
    sigma = np.array([0.1, 1e4, 2e-4, 1e4])
    truth = [simulate(cylinder_compiled, [record]).outputs[0] for record in records]
    places = [cylinder_compiled.system.parameter_names.index(name) for name in names]
    pressure = cylinder_compiled.system.state_names.index("pressure_cap")

    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        moved = []
        for record, own in zip(records, local, strict=True):
            parameters, initial = record.parameters.copy(), record.initial.copy()
            parameters[places], initial[pressure] = shared, own[0]
            moved.append(record.replace(parameters=parameters, initial=initial))
        result = simulate(
            cylinder_compiled,
            moved,
            columns=names if derivatives else (),
            initial_columns=["pressure_cap"] if derivatives else (),
        )
        if not result.ok:
            return Refused(result.summary())
        blocks = []
        for z, s, y in zip(result.outputs, result.sensitivities, truth, strict=True):
            flat = (s / sigma[:, None]).reshape(z.size, -1)
            blocks.append(Block(((z - y) / sigma).ravel(), flat[:, :3], flat[:, 3:]))
        return blocks

    unknowns = [
        Unknown(name, nominal[name] * factor, 0.1 * nominal[name], 10.0 * nominal[name])
        for name, factor in zip(names, (1.3, 0.7, 1.3), strict=True)
    ]
    local = [[Unknown("pressure_cap", 9e5, -0.9e5, 50e5, scale=1e5)] for _ in records]
    result = least_squares(evaluate, unknowns, local)
    assert result.converged
    for unknown, value in zip(result.unknowns, result.values, strict=True):
        assert value == pytest.approx(nominal[unknown.name], rel=1e-4)
    for record, own in zip(records, result.local, strict=True):
        assert own[0] == pytest.approx(record.initial[pressure], rel=1e-3)


class Valley:
    """Two nearly equivalent gains: their product is determined hundreds of times better than their ratio.

    Along the valley Levenberg-Marquardt damping leaves hardly any step, and a step of useful length leaves
    the valley, because the product is nonlinear.
    """

    sigma = 1e-3

    def __init__(self) -> None:
        self.x = np.linspace(0.0, 1.0, 40000)
        self.seen = self.model(1.0, -0.05) + self.sigma * np.random.default_rng(3).normal(size=self.x.size)
        begun = scipy_least_squares(lambda area: self.residuals(np.array([area[0], 0.0])), [0.9])
        self.begun, self.area = begun.cost, float(begun.x[0])
        self.best = scipy_least_squares(self.residuals, [0.9, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)

    def model(self, area: float, gain: float) -> Floats:
        return area * (1.0 + gain) * self.x + 0.002 * gain * np.sin(9.0 * self.x)

    def residuals(self, values: Floats) -> Floats:
        return np.asarray((self.model(values[0], values[1]) - self.seen) / self.sigma)

    def __call__(self, shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block]:
        area, gain = shared
        by_gain = area * self.x + 0.002 * np.sin(9.0 * self.x)
        columns = np.column_stack([(1.0 + gain) * self.x, by_gain]) / self.sigma
        return [Block(self.residuals(shared), columns) if derivatives else Block(self.residuals(shared))]

    def unknowns(self) -> list[Unknown]:
        """Starts on the floor of the valley, with zero gain."""
        return [Unknown("area", self.area), Unknown("gain", 0.0, -0.5, 0.5, scale=0.01)]


def test_a_narrow_curved_valley_is_followed_to_its_minimum() -> None:
    valley = Valley()
    found = least_squares(valley, valley.unknowns(), [()], options=Options(cost=1e-5, largest_step=1.0))
    assert valley.begun - valley.best.cost > 10.0
    assert found.cost - valley.best.cost < 0.01 * (valley.begun - valley.best.cost)
    assert found.value("gain") == pytest.approx(valley.best.x[1], abs=0.5 * float(found.std[1]))


def test_a_fit_stays_in_a_valley_beyond_which_the_model_has_no_value() -> None:
    valley = Valley()

    def evaluate(shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        return valley(shared, local, derivatives) if abs(shared[1]) < 1e-3 else Refused("no value there")

    told: list[Iteration] = []
    found = least_squares(
        evaluate,
        valley.unknowns(),
        [()],
        options=Options(cost=1e-5, largest_step=1.0),
        progress=told.append,
    )
    assert found.converged
    assert found.cost <= valley.begun
    assert abs(found.value("gain")) < 1e-3
    assert [one.number for one in told] == sorted({one.number for one in told})
