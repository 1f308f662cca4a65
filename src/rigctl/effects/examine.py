"""Validation of an effect: it is written into its family's equations and evaluated.

At its null value every term must be exactly 0 (or 1 if the slot multiplies), and throughout the bench's range
each term must have a finite value and slope.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Literal, NamedTuple

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.writing import Written, nominal, write_out
from rigctl.engine.symbols import Expr, evaluate, variables_of
from rigctl.errors import RigctlError
from rigctl.physics.family import ModelFamily
from rigctl.physics.family_checks import Point, first_gap, resting_points
from rigctl.units import show


class Fault(NamedTuple):
    """A fault of an effect: `part` is its location, as ``("terms", slot)`` or ``("parameters", name)``."""

    part: tuple[Literal["terms", "parameters"], str]
    error: RigctlError


def examine(effect: Effect, family: ModelFamily, points: Sequence[Point] = ()) -> tuple[Fault, ...]:
    """The faults of an effect with a valid declaration; empty if there are none.

    Evaluated near the family's resting state, and at `points`, e.g. those of a simulated record.
    """
    written = write_out(effect, family)
    if written.refused is not None:
        slot, error = written.refused
        return (Fault(("terms", slot), error),)
    tried = [
        {**nominal(family), **_own_start(effect), **point} for point in (*resting_points(family), *points)
    ]
    return (*_unused(effect, written), *_wrong_terms(effect, family, written, tried))


def _own_start(effect: Effect) -> Point:
    return {qualified(effect.name, state.name): state.start for state in effect.states}


def _unused(effect: Effect, written: Written) -> Iterator[Fault]:
    if not written.terms:  # the default variant of the equations does not use the slot
        return
    used = {variable.name for expr in written.expressions for variable in variables_of(expr)}
    for parameter in effect.parameters:
        if qualified(effect.name, parameter.name) not in used:
            error = RigctlError(
                "no term uses this parameter", value=parameter.name, hint="Use it, or remove it"
            )
            yield Fault(("parameters", parameter.name), error)


def _wrong_terms(
    effect: Effect, family: ModelFamily, written: Written, points: Sequence[Point]
) -> Iterator[Fault]:
    # Both settings of the effect are needed: at the null every candidate of a search is linearised, at its
    # typical size the fit begins.
    off = [{**point, **_parameters(effect, effect.null)} for point in points]
    on = [{**point, **_parameters(effect, effect.start)} for point in points]
    for slot, uses in written.terms.items():
        nothing = 0.0 if family.slot(slot).combine == "sum" else 1.0
        fault = _not_smooth(effect, family, uses, [*off, *on]) or _not_off(effect, uses, nothing, off)
        if fault is not None:
            yield Fault(("terms", slot), fault)


def _parameters(effect: Effect, values: Mapping[str, float]) -> Point:
    return {qualified(effect.name, name): value for name, value in values.items()}


def _not_off(
    effect: Effect, uses: Sequence[Expr], nothing: float, points: Sequence[Point]
) -> RigctlError | None:
    values = [evaluate(expr, point) for point in points for expr in uses]
    # Exactly 0 (or 1), not nearly: a diagnosis evaluates the equations with the whole library at its nulls,
    # and that has to be the model itself.
    wrong = next((value for value in values if value != nothing), None)
    if wrong is None:
        return None
    null = ", ".join(f"{p.name} = {show(p.at_null, p.unit)}" for p in effect.parameters if not p.shape)
    return RigctlError(
        f"the null value, {null}, does not switch the term off: it is {wrong:.4g} there",
        expected=f"exactly {nothing:g}",
        hint="Let a parameter multiply all of it: 'size*(...)'"
        if nothing == 0.0
        else "Write a factor as '1 + size*(...)'",
    )


def _not_smooth(
    effect: Effect, family: ModelFamily, uses: Sequence[Expr], points: Sequence[Point]
) -> RigctlError | None:
    """Where a term first lacks a finite value, or a finite slope in a variable on which it depends."""
    for expr in uses:
        gap = first_gap(expr, points)
        if gap is not None:
            moving = [v.name for v in variables_of(expr) if v.name not in nominal(family)]
            return gap.error("the term", moving, partial(_shown, effect))
    return None


def _shown(effect: Effect, name: str) -> str:
    return name.removeprefix(f"{effect.name}.")
