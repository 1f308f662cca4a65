"""The tests of a fitted model against SciPy and dense algebra, and which of them count."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import f as fisher
from scipy.stats import norm

from linear_problem import NUISANCES, PLAIN, compared, made_design, random_gram
from made_fit import RECORDS, SIZE, made_fit, made_noise
from rigctl.analysis.agreement import adequacy as module
from rigctl.analysis.agreement.adequacy import (
    Adequacy,
    Test,
    adequacy,
    beyond_statement,
    chi2_test,
    plane_test,
    variance_factor,
    white_at_floor,
)
from rigctl.noise import whiten

Floats = np.ndarray

# --- one statistic and what chance explains of it


def test_the_excess_is_what_a_hundredth_of_all_right_models_exceeds() -> None:
    assert Test(500.0, 0.0).excess == 0.0  # -log10 p has no degrees of freedom
    assert Test(500.0, 0.0, dof=100, spread=20.0).excess == pytest.approx(400.0 - 2.33 * 20.0)
    assert Test(140.0, 0.1, dof=100, spread=20.0).excess == 0.0
    least = 10 * fisher.isf(0.01, 10, 20)  # the noise is known from 20 readings
    assert Test(least + 3.0, 0.0, dof=10, known=20).excess == pytest.approx(3.0)
    assert Test(least - 3.0, 0.0, dof=10, known=20).excess == 0.0


def total_misfit(statistic: float, dof: int, degrees: tuple[int, ...] = (0, 0), known: int = 0) -> Test:
    """Of two channels with 80 and 40 readings, whose noise has so many degrees of freedom."""
    problem: Any = SimpleNamespace(
        noise=SimpleNamespace(channels=[SimpleNamespace(degrees=one) for one in degrees]),
        ok=[np.arange(80)[:, None] < np.array([80, 40])],
    )
    problem.only = lambda fitted: problem
    lin = SimpleNamespace(fit=SimpleNamespace(problem=problem, fitted=(0,)))
    residual = np.array([math.sqrt(statistic)])
    made: Any = SimpleNamespace(
        linearisation=lin, residual=residual, dof=dof, noise_degrees=known, records=(0,)
    )
    return chi2_test(made)


@pytest.mark.parametrize("statistic", [90.0, 130.0, 180.0])
def test_the_total_misfit_has_the_spread_of_the_noise_beside_its_own(statistic: float) -> None:
    found = total_misfit(statistic, 100, degrees=(50, 0))
    spread = math.sqrt(2.0 * 100 + 2.0 * 80**2 / 50)  # var n·F(n, m) is near 2n + 2n²/m
    assert (found.dof, found.spread) == (100, pytest.approx(spread))
    assert found.p_value == pytest.approx(norm.sf((statistic - 100) / spread))
    few = total_misfit(statistic, 100, known=8)
    assert few.p_value == pytest.approx(fisher.sf(statistic / 100, 100, 8), rel=1e-9)
    assert few.known == 8
    assert total_misfit(statistic, 100).spread == pytest.approx(math.sqrt(200.0))


def test_a_fit_without_more_readings_than_unknowns_is_not_rejected_by_its_misfit() -> None:
    for dof in (0, -3):
        assert total_misfit(50.0, dof).p_value == 1.0
        assert total_misfit(50.0, dof).dof == 0
    assert total_misfit(50.0, 1).p_value < 1e-6


# --- the residuals on the operating point


def test_the_plane_test_is_what_planes_of_every_phase_and_channel_explain() -> None:
    """By dense algebra: χ² of the model less χ² with 16 more columns. The noise is white, as the sums are."""
    rng = np.random.default_rng(5)
    design = made_design(PLAIN, random_gram(rng, 6, 9))
    y = design.readings({"beta.size": 6.0}, design.drawn_noise(rng))
    found = compared(design, y).adequacy.tests["plane"]
    planes = [
        np.concatenate(
            [np.outer(np.repeat(np.eye(2)[phase], 6), np.eye(2)[channel]).ravel() * at for at in column]
        )
        for phase in range(2)
        for channel in range(2)
        for column in np.array([[1.0, t, p, t * p] for t in range(4) for p in (1.0, 3.0)]).T
    ]
    white = np.linalg.solve(design.root, np.column_stack([design.matrix(NUISANCES), *planes]))
    left = np.linalg.solve(design.root, y)
    left = left - white @ np.linalg.lstsq(white, left, rcond=None)[0]
    assert found.statistic == pytest.approx(design.chi2(y) - left @ left, rel=1e-6)
    assert (found.dof, found.spread) == (16, pytest.approx(math.sqrt(32.0)))


def planes(columns: Floats, absorbed: Floats, residual: Floats, known: int = 0) -> Test:
    """The plane test of one record with a single region of each column, less what `absorbed` does."""
    regions = SimpleNamespace(plane=lambda k: np.ones(1))
    lin = SimpleNamespace(records=[SimpleNamespace(regions=columns)], regions=regions)
    basis = np.linalg.qr(absorbed)[0] if absorbed.size else absorbed
    made: Any = SimpleNamespace(
        linearisation=lin,
        records=(0,),
        project=lambda matrix: matrix - basis @ (basis.T @ matrix),
        residual=residual,
        noise_degrees=known,
    )
    return plane_test(made)


def test_what_the_fitted_parameters_absorb_of_the_planes_is_not_tested() -> None:
    """A column of which 0.7 thousandths are left is nothing but rounding; one of 1.5 is not."""
    unit, residual = np.eye(4), np.array([0.0, 3.0, 4.0, 0.0])
    for share, dof in ((0.7e-3, 1), (1.5e-3, 2)):
        nearly = unit[0] + share * unit[1]
        found = planes(np.column_stack([nearly, 5.0 * unit[2]]), unit[:, :1], residual)
        assert (found.dof, found.statistic) == (dof, pytest.approx(16.0 if dof == 1 else 25.0))
    nothing = planes(unit[:, :2] * [1.0, 0.0], unit[:, :1], residual)
    assert (nothing.dof, nothing.statistic, nothing.p_value) == (0, 0.0, 1.0)


@pytest.mark.parametrize(("tangent", "dof"), [(0.7e-3, 1), (1.5e-3, 2)])
def test_planes_that_coincide_count_once(tangent: float, dof: int) -> None:
    """Singular values of two columns at an angle of 2·atan(t) have the ratio t."""
    angle = math.atan(tangent)
    pair = np.array([[math.cos(angle)] * 2, [math.sin(angle), -math.sin(angle)], [0.0, 0.0]])
    found = planes(pair, np.empty((3, 0)), np.array([2.0, 1.0, 9.0]), known=6)
    assert (found.dof, found.statistic) == (dof, pytest.approx(4.0 if dof == 1 else 5.0))
    assert found.known == 6
    assert found.p_value == pytest.approx(fisher.sf(found.statistic / dof, dof, 6))


# --- residuals that vary more than the noise, and slowly


def summed_term_by_term(fit: Any) -> float:
    """Newey and West's sum with Bartlett's weights up to a quarter of the longest, for white noise."""
    series = []
    for k in fit.fitted:
        for c, channel in enumerate(fit.problem.noise.channels):
            inside = fit.problem.ok[k][:, c]
            if inside.any():
                off = fit.outputs[k][inside, c] - fit.problem.records[k].values[inside, c]
                series.append(off / channel.sigma)
    count = sum(one.size for one in series)
    most = max(one.size for one in series) // 4
    at = [
        sum(float(one[lag:] @ one[: one.size - lag]) for one in series if one.size > lag) / count
        for lag in range(most + 1)
    ]
    weighted = [(1.0 - lag / (most + 1)) * at[lag] for lag in range(1, most + 1)]
    return max(1.0, at[0], at[0] + 2.0 * sum(weighted))


@pytest.mark.parametrize("period", [0.0, 180.0, 2.5])
@pytest.mark.parametrize("gaps", [False, True])
def test_the_variance_factor_is_the_sum_of_all_autocovariances(period: float, gaps: bool) -> None:
    """Of noise, of a slow misfit, and of a quick one, whose sum is less than its variance."""

    def swing(_: int, times: Floats) -> Floats:
        return 0.3 * np.sin(2.0 * np.pi * times / period)

    fit: Any = made_fit(made_noise(), 4, swing if period else None)
    if gaps:  # a channel that was read at the beginning only, and records that were read to different times
        problem = fit.problem
        times = problem.records[0].times
        problem.ok = tuple(times[:, None] < np.array([SIZE + 9.0 * k, 30.0 + k]) for k in range(RECORDS))
        problem.whiteners = tuple(whiten(problem.noise, times, ok) for ok in problem.ok)
    assert variance_factor(fit) == pytest.approx(summed_term_by_term(fit), rel=1e-9)


def test_no_record_is_not_overdispersed() -> None:
    fit: Any = made_fit(made_noise(), 4)
    vars(fit)["fitted"] = ()
    assert variance_factor(fit) == 1.0


# --- which tests count, and which channels are open


def channel(name: str, **changed: Any) -> Any:
    given = {"own_scale": False, "standing": "known", "unusable": False, "floor": 1.0, "plateau": True}
    return SimpleNamespace(name=name, **(given | {"allowed": 0.0, "together": 1.0, "over": 0.0} | changed))


OWN = {"own_scale": True, "standing": "floor"}
GOOD, BAD = Test(10.0, 0.5, 10, 4.0), Test(99.0, 1e-9, 10, 4.0)


@pytest.fixture
def tested(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Adequacy]:
    """The tests of a made fit of channels x and y; their errors are white where `white` names them."""

    def made(
        x: Any = (),
        y: Any = (),
        *,
        plane: Test = GOOD,
        chi2: Test = GOOD,
        scores: bool = True,
        table: bool = False,
        white: str = "",
        follows: dict[str, float] | None = None,
        nrmse: tuple[float, float] = (1.0, 1.0),
        rmse: float = 1.0,
        measured: str = "xy",
        extra: Any = None,
    ) -> Adequacy:
        found = {"x": 0.5, "y": 0.5} if follows is None else follows
        monkeypatch.setattr(module, "plane_test", lambda _: plane)
        monkeypatch.setattr(module, "chi2_test", lambda _: chi2)
        monkeypatch.setattr(module, "sensor_budget", lambda _: "sensors")
        courses = {name: SimpleNamespace(follows=p) for name, p in found.items()}
        monkeypatch.setattr(module, "residual_correlations", lambda _: courses)
        monkeypatch.setattr(module, "white_at_floor", lambda fit, one, found: one.name in white)
        errors = {
            name: SimpleNamespace(rmse=rmse, r2=math.nan, count=200, nrmse=ratio)
            for name, ratio in zip("xy", nrmse, strict=True)
            if name in measured
        }
        problem = SimpleNamespace(
            measurements=SimpleNamespace(table=table),
            noise=SimpleNamespace(channels=(channel("x", **dict(x)), channel("y", **dict(y))), spacing=1.0),
            extra=extra,
        )
        fit = SimpleNamespace(problem=problem, errors=errors, fitted=(0, 1))
        screening: Any = SimpleNamespace(scores=(1,) if scores else (), statistic=7.0, p_value=0.2)
        projected: Any = SimpleNamespace(linearisation=SimpleNamespace(fit=fit))
        return adequacy(projected, screening)

    return made


def test_a_test_counts_if_it_could_be_made(tested: Callable[..., Adequacy]) -> None:
    assert tested().tests == {"score": Test(7.0, 0.2), "plane": GOOD, "chi2": GOOD}
    assert list(tested(scores=False).tests) == ["plane", "chi2"]
    none = Test(0.0, 1.0, 0)
    assert list(tested(plane=none, chi2=none).tests) == ["score", "chi2"]
    assert tested().sensors == tested(table=True).sensors == "sensors"
    open_ = {"standing": "guess"}
    assert (tested(open_).unproven, tested(open_, table=True).unproven) == (("x",), ())


def test_the_correlation_with_inputs_takes_the_place_of_a_noise_level(
    tested: Callable[..., Adequacy],
) -> None:
    assert list(tested(OWN, OWN).tests) == ["score", "plane", "inputs"]
    assert list(tested(OWN).tests) == ["score", "plane", "chi2", "inputs"]
    both = tested(OWN, OWN, follows={"x": 0.4, "y": 1e-4}).tests["inputs"]
    assert (both.p_value, both.statistic) == (pytest.approx(2e-4), pytest.approx(-math.log10(2e-4)))
    assert tested(OWN, follows={"x": 0.4, "y": 1e-4}).tests["inputs"].p_value == pytest.approx(0.4)
    assert tested(OWN, OWN, follows={"y": 1e-4}).tests["inputs"].p_value == pytest.approx(1e-4)
    assert tested(OWN, OWN, follows={"x": 0.8, "y": 0.9}).tests["inputs"] == Test(0.0, 1.0)
    assert tested(OWN, follows={}).tests["inputs"] == Test(0.0, 1.0)
    assert tested(OWN, follows={"x": 0.0}).tests["inputs"].statistic == pytest.approx(300.0)


def test_a_channel_is_open_unless_its_noise_is_known_or_its_errors_are_white_at_the_floor(
    tested: Callable[..., Adequacy],
) -> None:
    assert tested().unproven == ()
    assert tested(OWN, OWN).unproven == ("x", "y")
    assert tested(OWN, OWN, white="y").unproven == ("x",)
    guess = {"standing": "guess"}
    assert tested(guess, OWN, white="xy").unproven == ("x",)  # of a guess not even the floor is known
    assert tested(OWN, guess, measured="y").unproven == ("y",)
    found = tested({**OWN, "allowed": 1.0}, OWN)
    assert (found.unproven, found.stated) == (("y",), ("x",))
    found = tested({**OWN, "allowed": 0.5}, OWN)
    assert (found.unproven, found.stated) == (("x", "y"), ())
    assert tested({"unusable": True}).unusable == ("x",)
    assert tested(OWN, {**OWN, "unusable": True}).unusable == ("y",)


def test_errors_as_large_as_measured_inputs_make_them_are_no_effect(tested: Callable[..., Adequacy]) -> None:
    """The floor is 1; the inputs' noise adds 3 and 4 in two records, √12.5 in the mean; 200 readings."""
    extra = [np.array([9.0, 3.0]), np.array([9.0, 4.0]), np.array([9.0, 99.0])]  # the third is not fitted
    level = math.sqrt(1.0 + 12.5)
    most = level * math.sqrt(1.0 + 2.33 * math.sqrt(2.0 / 200.0))
    assert tested((), OWN, rmse=0.99 * most, extra=extra).unproven == ()
    assert tested((), OWN, rmse=1.01 * most, extra=extra).unproven == ("y",)
    assert tested((), OWN, rmse=1.0).unproven == ("y",)
    assert tested((), OWN, rmse=1.0, extra=[np.zeros(2)] * 2).unproven == ("y",)
    assert tested((), {**OWN, "floor": 0.0}, rmse=1.0, extra=extra).unproven == ("y",)


def test_errors_below_the_noise_make_a_rejection_invalid_where_the_noise_was_learned(
    tested: Callable[..., Adequacy],
) -> None:
    small = (0.9, 0.5)
    assert tested(chi2=BAD, nrmse=small).below_noise
    assert not tested(chi2=BAD, nrmse=(0.91, 0.5)).below_noise
    assert not tested(nrmse=small).below_noise  # nothing rejects
    assert not tested(OWN, plane=BAD, nrmse=small).below_noise  # that scale is the errors' own


# --- errors and the noise that is known


def fitted(rmse: float, r2: float, count: int, one: Any) -> Any:
    errors = {one.name: SimpleNamespace(rmse=rmse, r2=r2, count=count)}
    return SimpleNamespace(errors=errors, problem=SimpleNamespace(noise=SimpleNamespace(spacing=1.0)))


def test_a_few_readings_say_little_of_a_stated_noise() -> None:
    """The mean square of n readings of noise scatters by √(2/n) of itself."""
    one = channel("x", allowed=1.0)
    for count in (8, 50, 1000):
        most = math.sqrt(1.0 + 2.33 * math.sqrt(2.0 / count))
        assert beyond_statement(fitted(0.999 * most, 0.99, count, one), one) == ""
        assert beyond_statement(fitted(1.001 * most, 0.99, count, one), one) == "larger"
    most = math.sqrt(1.0 + 2.33 * math.sqrt(2.0))
    assert beyond_statement(fitted(0.999 * most, math.nan, 0, one), one) == ""
    assert beyond_statement(fitted(1.001 * most, math.nan, 0, one), one) == "larger"


def test_a_model_that_explains_half_of_a_moving_channel_follows_it_and_no_less() -> None:
    one = channel("x", allowed=9.0)
    assert beyond_statement(fitted(4.0, 0.5, 200, one), one) == "unexplained"
    assert beyond_statement(fitted(4.0, 0.501, 200, one), one) == ""
    # it varies by 3 floors, which noise may too
    assert beyond_statement(fitted(3.0 * math.sqrt(0.6), 0.4, 200, one), one) == ""
    assert beyond_statement(fitted(0.1, 1.0, 200, one), one) == ""


@pytest.mark.parametrize(("count", "degrees"), [(20_000, 20_000), (60, 20_000), (60, 9)])
def test_the_floor_and_the_errors_are_known_as_well_as_their_readings_say(count: int, degrees: int) -> None:
    """A ratio of variances scatters by √(2/n + 2/m), and a floor is known to 4 % of itself at best."""
    spread = math.sqrt(2.0 / count + 2.0 / degrees + (2 * 0.04) ** 2)
    most = math.sqrt(1.0 + 2.33 * spread)
    one = channel("x")
    found: Any = SimpleNamespace(white_p=0.5, white_rms=math.nan, white_degrees=degrees)
    assert white_at_floor(fitted(0.999 * most, 0.99, count, one), one, found)
    assert not white_at_floor(fitted(1.001 * most, 0.99, count, one), one, found)


def test_a_floor_of_unknown_degrees_counts_as_known_from_one() -> None:
    one = channel("x")
    found: Any = SimpleNamespace(white_p=0.5, white_rms=math.nan, white_degrees=0)
    most = math.sqrt(1.0 + 2.33 * math.sqrt(2.0 / 400 + 2.0 + 0.0064))
    assert white_at_floor(fitted(0.999 * most, 0.99, 400, one), one, found)
    assert not white_at_floor(fitted(1.001 * most, 0.99, 400, one), one, found)


@pytest.mark.parametrize("plateau", [True, False])
def test_heavy_tails_raise_a_measured_floor_by_no_more_than_two_fifths(plateau: bool) -> None:
    """Tails count in a mean square, and not in a median; a floor that is a bound is no measure at all."""
    one = channel("x", floor=2.0, plateau=plateau)
    for own in (1.5, 2.5, 4.0):
        level = own if not plateau else max(2.0, min(own, 2.8))
        most = level * math.sqrt(1.0 + 2.33 * math.sqrt(4.0 / 20_000 + 0.0064))
        found: Any = SimpleNamespace(white_p=0.5, white_rms=own, white_degrees=20_000)
        assert white_at_floor(fitted(0.999 * most, 0.99, 20_000, one), one, found)
        assert not white_at_floor(fitted(1.001 * most, 0.99, 20_000, one), one, found)
