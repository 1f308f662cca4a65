"""Parameters of a model that a fit left at a bound, and the widening of bounds that nobody wrote.

A bound that a user wrote holds. One that is only a default, a factor of the starting value or the usual range
of a shipped family, never decides: it is moved outwards, and the fit goes on from where it ended.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.unknowns import NARROW, WIDE, assumed_unknowns, parameter_unknown
from rigctl.model.model import Model
from rigctl.model.value_table import rounded
from rigctl.physics.family import ParameterDeclaration
from rigctl.units import parse_unit, show

Side = Literal["lower", "upper"]

#: a wider fit replaces the one at the bound unless its cost is higher by more than this share
_NO_WORSE = 1e-9
#: how often the bounds are moved outwards
_WIDENINGS = 2


@dataclass(frozen=True)
class ReachedBound:
    """A parameter that a fit drove to a bound.

    Attributes
    ----------
    bound, value: SI; `value` is where the fit ended.
    unit: in which they are shown.
    widened: the bound was only a default, and was moved outwards.
    held: the fit ended at a bound.
    written: a user wrote the bound.
    assumed: the parameter is an assumed number, and the bound the end of its range.
    """

    parameter: str
    bound: float
    value: float
    side: Side
    unit: str
    widened: bool
    held: bool
    written: bool
    assumed: bool = False

    @property
    def decisive(self) -> bool:
        """Whether a user's bound holds the fit: zero, which is as little as there can be, does not count."""
        return self.held and self.written and self.bound != 0.0

    @property
    def statement(self) -> str:
        """In words: ``heat_capacity ended at its upper bound, 215 J/K: widen it first``."""
        bound, value = show(self.bound, self.unit), show(self.value, self.unit)
        if not self.held:
            beyond = f"{self.parameter} went beyond its usual {self.side} bound, {bound}"
            return f"{beyond}, which was widened: {value}"
        if self.assumed:
            end = f"{self.parameter} ended at the {self.side} end of its assumed range, {bound}"
            return f"{end}: measure it, or state a wider range, first"
        if self.decisive:
            return f"{self.parameter} ended at its {self.side} bound, {bound}: widen it first"
        if self.written:
            return f"{self.parameter} ended at its {self.side} bound, {bound}"
        if not self.widened:
            return f"{self.parameter} ended at the limit of its usual range, {bound}"
        end = "least" if self.side == "lower" else "greatest"
        return (
            f"{self.parameter} ended at {value}, the {end} value that was tried: these data do not limit it"
        )

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in `unit`."""
        unit = parse_unit(self.unit)
        return {
            "parameter": self.parameter,
            "bound": rounded(unit.from_si(self.bound)),
            "value": rounded(unit.from_si(self.value)),
            "unit": self.unit,
            "side": self.side,
            "widened": self.widened,
            "statement": self.statement,
        }


def reached_bounds(fitted: FitResult) -> tuple[ReachedBound, ...]:
    """The parameters of the model's family that a fit drove to a bound, or beyond one that was widened."""
    if fitted.solution is None:
        return ()
    # compared with the bounds before any fit: a bound that was moved outwards and is passed is reported too,
    # since the value is then unusual though nothing holds it
    problem, reached = fitted.problem, []
    for unknown, value in zip(problem.shared, fitted.values.tolist(), strict=True):
        before = _as_written(problem.model, unknown.name)
        if before is None:
            continue
        side: Side = "lower" if value <= max(before.lower, unknown.lower) else "upper"
        bound = before.lower if side == "lower" else before.upper
        held = unknown.name in fitted.at_bound
        if held or not before.lower <= value <= before.upper:
            declared = problem.model.family.parameter(unknown.name)
            at = value if held else bound
            assumed = before.prior is not None and unknown.name in problem.model.assumed
            default = not assumed and _default_sides(declared, before)[side == "upper"]
            widened = bound not in (unknown.lower, unknown.upper)
            unit = _unit(fitted, unknown.name, declared)
            reached.append(
                ReachedBound(unknown.name, at, value, side, unit, widened, held, not default, assumed)
            )
    return tuple(reached)


def _as_written(model: Model, name: str) -> Unknown | None:
    """A parameter of the family as an unknown with its bounds before any fit; None for any other unknown."""
    if name in model.assumed:
        return {one.name: one for one in assumed_unknowns(model)}[name]
    return parameter_unknown(model, name) if name in model.fitted and "." not in name else None


def decisive_bounds(fitted: FitResult) -> tuple[ReachedBound, ...]:
    """The bounds that a user wrote and that hold the fit."""
    return tuple(one for one in reached_bounds(fitted) if one.decisive)


def beyond_defaults(fitted: FitResult) -> list[Unknown] | None:
    """The shared unknowns, starting where the fit ended, with default bounds that hold it moved outwards.

    None if no default bound holds it, and for a table: far outside its usual range nearly every parameter
    explains a few values.
    """
    if fitted.problem.measurements.table:
        return None
    assumed = fitted.problem.model.assumed

    def sides(declared: ParameterDeclaration, before: Unknown) -> tuple[bool, bool]:
        return (False, False) if declared.name in assumed else _default_sides(declared, before)

    return _moved_outwards(fitted, sides)


def beyond_written(fitted: FitResult) -> list[Unknown] | None:
    """As `beyond_defaults`, for bounds that a user wrote: to see whether the model agrees beyond them."""
    wanted = {one.parameter for one in decisive_bounds(fitted)}
    return _moved_outwards(fitted, lambda declared, _: (declared.name in wanted,) * 2)


def with_wider_bounds(
    fitted: FitResult, again: Callable[[FitResult, Sequence[Unknown]], FitResult]
) -> FitResult:
    """The fit continued beyond the default bounds that hold it; the fit itself if there are none.

    `again` fits the problem of a fit with other shared unknowns. Bounds beyond which that is impossible stay.
    """
    # each time from the end of the fit before, with only what is held moved: a fit that ends inside its
    # bounds is never repeated, and one that ends higher than the narrower one is not taken
    for _ in range(_WIDENINGS):
        shared = beyond_defaults(fitted)
        if shared is None or fitted.solution is None:
            break
        try:
            wider = again(fitted, shared)
        except RigctlError:  # so far out the model cannot be simulated, maybe only on the records held out
            break
        if wider.solution is None or wider.solution.cost > (1.0 + _NO_WORSE) * fitted.solution.cost:
            break
        fitted = wider
    return fitted


def _moved_outwards(
    fitted: FitResult, sides: Callable[[ParameterDeclaration, Unknown], tuple[bool, ...]]
) -> list[Unknown] | None:
    """The shared unknowns, starting at the fit, with those `sides` that hold it moved outwards."""
    problem = fitted.problem
    held = fitted.at_bound & {*problem.model.fitted, *problem.model.assumed}
    unknowns, moved = [], False
    for unknown, value in zip(problem.shared, fitted.values.tolist(), strict=True):
        one = unknown
        if unknown.name in held and "." not in unknown.name:
            declared = problem.model.family.parameter(unknown.name)
            before = _as_written(problem.model, unknown.name)
            low, high = (False, False) if before is None else sides(declared, before)
            if low and value <= unknown.lower:
                one = replace(one, lower=_further(unknown.lower, -1.0, declared))
            elif high and value >= unknown.upper:
                one = replace(
                    one, upper=_further(unknown.upper, 1.0, declared), scale=abs(value) or one.scale
                )
            moved = moved or one is not unknown
        unknowns.append(replace(one, start=min(max(value, one.lower), one.upper)))
    return unknowns if moved else None


def _further(bound: float, side: float, declared: ParameterDeclaration) -> float:
    """A bound moved outwards by the factor of default bounds; a usual one as far as `widest` goes."""
    if side < 0.0:
        # outwards, away from the value: towards zero for a positive lower bound, away from zero for a
        # negative one
        low = bound * NARROW if bound > 0.0 else bound * WIDE
        return max(low, declared.widest[0]) if declared.usual[0] else low
    high = bound * WIDE if bound > 0.0 else bound * NARROW
    return min(high, declared.widest[1]) if declared.usual[1] else high


def _default_sides(declared: ParameterDeclaration, unknown: Unknown) -> tuple[bool, bool]:
    """Whether the bounds of an unknown are only defaults: usual ones, or factors of its start."""
    return (
        unknown.lower not in (declared.low, 0.0) or (declared.usual[0] and unknown.lower != 0.0),
        unknown.upper != declared.high or declared.usual[1],
    )


def _unit(fitted: FitResult, name: str, declared: ParameterDeclaration) -> str:
    """The unit in which a parameter is shown: that of the model file, or the declared one."""
    given = fitted.problem.model.parameters.get(name)
    return (given.unit if given is not None else "") or declared.unit
