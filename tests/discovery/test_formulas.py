"""Formulas in effect files are those that were scored, and p-values account for the search."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rigctl.analysis.linear.chi_square import chi2_tail
from rigctl.answers.discovery import tier_statement
from rigctl.discovery.chance import draw_chance, log_tail
from rigctl.discovery.dimensions import tier_of
from rigctl.discovery.effect_file import effect_of, scale_parameters
from rigctl.discovery.formula_fit import Fitted, _parts
from rigctl.discovery.formulas import Factor, Formula, _of_every_slot
from rigctl.discovery.grammar import argument, factors, forms
from rigctl.effects.declaration import qualified
from rigctl.effects.drivers import Driver
from rigctl.effects.writing import write_out
from rigctl.engine.symbols import evaluate
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import FitResult
from rigctl.model.load import load_model
from rigctl.physics.families import find_family, using_families

FAMILY = find_family("hydraulic_cylinder")
FRICTION = FAMILY.slot("friction")
VELOCITY = argument(Driver((("velocity", 1.0),), "m/s"), -0.21, 0.43, FAMILY)
OIL = argument(Driver((("oil_temperature", 1.0),), "K"), 293.4, 352.8, FAMILY)
ACROSS = argument(Driver((("pressure_a", 1.0), ("pressure_b", -1.0)), "Pa"), -2e6, 3.1e6, FAMILY)


def every_factor() -> list[tuple[Factor, ...]]:
    found: list[tuple[Factor, ...]] = []
    for own in (VELOCITY, OIL, ACROSS):
        low, high = (float(end) for end in own.of(np.array([own.low, own.high])))
        inner = [Factor(own, form, form.starts[-1]) for form in forms(low, high)]
        found += [(one,) for one in inner]
        if own is OIL:
            outer = [Factor(VELOCITY, form, form.starts[0]) for form in factors(-1.0, 2.0)]
            found += [(one, other) for one in inner[:2] + inner[-1:] for other in outer]
    return found


@pytest.mark.parametrize("chosen", every_factor(), ids=lambda chosen: " ".join(f.form.name for f in chosen))
def test_the_formula_in_the_file_evaluates_to_the_scored_term(chosen: tuple[Factor, ...]) -> None:
    formula = Formula(FRICTION, chosen, gain=1.0, size=37.0, cost=0.0)
    effect = effect_of(formula, FAMILY)
    (expr, *_) = write_out(effect, FAMILY).terms["friction"]
    scales = {qualified(effect.name, one.name): one.value for one in scale_parameters(formula, FAMILY)}
    for share in (0.07, 0.33, 0.62, 0.95):
        at = {own.driver.weights: own.low + share * (own.high - own.low) for own in (VELOCITY, OIL, ACROSS)}
        values = {
            "velocity": at[VELOCITY.driver.weights],
            "oil_temperature": at[OIL.driver.weights],
            "pressure_a": at[ACROSS.driver.weights] + 1e6,
            "pressure_b": 1e6,
        }
        truth = 37.0 * math.prod(
            float(one.of(np.array([at[one.argument.driver.weights]]))[0]) for one in chosen
        )
        written = evaluate(expr, {**values, **scales, qualified(effect.name, "size"): 37.0})
        assert written == pytest.approx(truth, rel=2e-2, abs=0.1)


def test_an_effect_of_a_family_given_by_the_caller_is_made_within_using_families() -> None:
    """As 'rigctl discover --family FILE' does, in the same process."""
    drag = Formula(FRICTION, every_factor()[0], gain=1.0, size=37.0, cost=0.0)
    with using_families(replace(FAMILY, name="own_cylinder")):
        family = find_family("own_cylinder")
        assert effect_of(drag, family).own_family is family
    assert effect_of(drag, family).own_family is family  # and outside


def test_a_second_formula_of_one_form_has_an_effect_name_of_its_own() -> None:
    drag = Formula(FRICTION, every_factor()[0], gain=1.0, size=37.0, cost=0.0)
    second = replace(drag, number=2)
    assert effect_of(second, FAMILY).name == second.name == f"{drag.name}_2"
    assert second.key == drag.key


def scored(slot: str, chosen: tuple[Factor, ...], cost: float) -> Formula:
    return Formula(FAMILY.slot(slot), chosen, gain=-cost, size=1.0, cost=cost)


def test_formulas_of_every_location_are_compared_though_one_has_dozens() -> None:
    """A damper near the end of the stroke had 40 equivalent formulas at the lines, and none elsewhere."""
    several = every_factor()
    crowd = [scored("line_resistance", chosen, -5000.0 + k) for k, chosen in enumerate(several[:45])]
    others = [
        scored(slot, several[k], -4000.0 + k) for slot in ("friction", "throttle_area") for k in range(5)
    ]
    first = _of_every_slot([(one, cast("Any", None)) for one in [*crowd, *others]])
    assert len(crowd) > 40
    chosen = [formula for formula, _ in first]
    assert chosen[:40] == crowd[:40]
    assert chosen[40:] == [*others[:2], *others[5:7]]


def test_the_factors_of_the_best_products_are_refitted_alone() -> None:
    """A drag that falls with speed came with a factor of the pressure, as the linear problem misjudged it."""
    falling, root, bump = every_factor()[0][0], every_factor()[1][0], every_factor()[2][0]
    pressure = next(one for (one, *_) in every_factor() if one.argument is ACROSS)
    model = load_model(shipped("models", "hl32-textbook.yaml"))
    fit = cast("FitResult", SimpleNamespace(problem=SimpleNamespace(model=model)))

    same = (scored("friction", (root,), -9.0), scored("friction", (root, pressure), -8.0))

    def refitted(*factors: Factor) -> Fitted:
        formula = replace(scored("friction", factors, -10.0), same=same)
        return Fitted(formula, cast("Any", None), 0.0)

    products = [refitted(falling, pressure), refitted(root), refitted(bump, pressure), refitted(bump)]
    parts = _parts(products, fit)
    assert [one.key for one in parts] == [
        scored("friction", (falling,), 0.0).key,
        scored("friction", (pressure,), 0.0).key,
    ]
    assert [one.same for one in parts] == [same[:1], ()], "equivalents over the same variable"
    assert [one.factors for one in parts] == [(falling,), (pressure,)]


def test_temperatures_are_written_relative_to_a_round_reference_in_degrees() -> None:
    assert OIL.text == "(oil_temperature - 20 degC)"
    assert OIL.reference_text == "(60 K)"
    assert OIL.amount("center", 313.15) == "40 degC"
    assert OIL.amount("width", 5.0) == "5 K"


def test_a_coefficient_near_a_dimensionless_group_of_the_parameters_is_tier_a() -> None:
    model = load_model(shipped("models", "hl32-textbook.yaml"))
    linear = next(form for form in forms(-1.0, 2.0) if form.name == "linear")
    drag = Formula(FRICTION, (Factor(VELOCITY, linear),), gain=1.0, size=55.0, cost=0.0)
    found = tier_of(drag, model)
    assert found.letter == "A"
    assert "damping" in found.group
    # the same drag with a size far from every parameter
    far = tier_of(replace(drag, size=5e12), model)
    assert far.letter == "B"
    assert "weaker" in tier_statement(far)


def projected(residual: np.ndarray, columns: np.ndarray, records: int) -> SimpleNamespace:
    """The attributes of a projected linearisation that `draw_chance` reads."""
    own = [SimpleNamespace(residual=part) for part in np.split(residual, records)]
    sizes = np.linalg.norm(columns, axis=0)
    lin = SimpleNamespace(full_lengths=sizes, records=own)
    usable = np.ones(columns.shape[1], dtype=bool)
    return SimpleNamespace(
        residual=residual, signatures=columns, usable=usable, linearisation=lin, noise_degrees=0
    )


def test_the_family_wise_level_counts_only_independent_searches() -> None:
    rng = np.random.default_rng(0)
    columns, noise = rng.standard_normal((160, 24)), rng.standard_normal(160)
    one = draw_chance(projected(noise, columns[:, :3], 4), [slice(0, 3)])
    same = draw_chance(
        projected(noise, np.tile(columns[:, :3], 8), 4), [slice(3 * k, 3 * k + 3) for k in range(8)]
    )
    others = draw_chance(projected(noise, columns, 4), [slice(3 * k, 3 * k + 3) for k in range(8)])
    assert one.family_wise(math.log(0.02)) == pytest.approx(0.02, rel=0.15)
    assert same.family_wise(math.log(0.02)) == pytest.approx(0.02, rel=0.15)
    assert others.family_wise(math.log(0.02)) == pytest.approx(1.0 - 0.98**8, rel=0.15)
    assert others.family_wise(math.log(0.02)) <= 8 * 0.02  # Bonferroni's bound
    assert others.independent == pytest.approx(8.0, rel=0.2)


def test_residuals_slower_than_the_noise_model_raise_the_family_wise_p_value() -> None:
    rng = np.random.default_rng(1)
    white = rng.standard_normal((30, 40))
    slow = np.repeat(rng.standard_normal((30, 5)), 8, axis=1)
    columns = np.tile(np.repeat(np.eye(5), 8, axis=0), (30, 1))
    groups = [slice(k, k + 1) for k in range(5)]
    sure = draw_chance(projected(white.ravel(), columns, 30), groups).family_wise(math.log(1e-3))
    less = draw_chance(projected((white + slow).ravel(), columns, 30), groups).family_wise(math.log(1e-3))
    assert sure < 0.02
    assert less > 10.0 * sure


@pytest.mark.parametrize("known", [0, 60, 2000])
@pytest.mark.parametrize("dof", [1, 8, 25])
def test_the_logarithm_of_a_tail_continues_where_the_probability_underflows(dof: int, known: int) -> None:
    sizes = np.geomspace(1.0, 1e7, 2000)
    logs = log_tail(sizes, dof, known)
    assert np.all(np.isfinite(logs))
    assert np.all(np.diff(logs) < 0.0)
    slopes = np.diff(logs) / np.diff(sizes)
    assert np.all(np.abs(np.diff(slopes[sizes[1:] > 200.0])) < 0.01)  # no step where one formula takes over
    seen = np.array([chi2_tail(float(size), dof, known) for size in sizes])
    assert np.exp(logs) == pytest.approx(seen, rel=1e-9, abs=1e-270)


@pytest.mark.parametrize("known", [0, 500])
def test_a_large_effect_is_significant_although_what_is_left_beside_it_is_large_too(known: int) -> None:
    """Both p-values are below the smallest float: 300 sigma of an effect beside 60 of other misfits."""
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((900, 12))
    one = columns[:, :3] @ np.array([10.0, -6.0, 4.0])
    other = np.repeat(rng.choice([-1.0, 1.0], 9), 100) * columns[:, 6]
    residual = rng.standard_normal(900) + one + 2.0 * other
    at = projected(residual, columns, 9)
    at.noise_degrees = known
    groups = [slice(3 * k, 3 * k + 3) for k in range(4)]
    chance = draw_chance(at, groups)
    basis = np.linalg.qr(columns[:, :3])[0]
    best = float(np.square(basis.T @ residual).sum())
    assert chi2_tail(best, 3) == 0.0
    assert chance.family_wise(log_tail(best, 3, known).item()) < 1e-3
