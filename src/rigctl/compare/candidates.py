"""The effects that a model may lack: those of the library that it has not and that do not contradict it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from rigctl.compare.data_ranges import Ranges
from rigctl.effects.declaration import Effect, EffectParameter, qualified
from rigctl.effects.registry import library
from rigctl.model.model import Model


@dataclass(frozen=True)
class Candidate:
    """One effect at one choice of its shapes.

    Attributes
    ----------
    effect: of the library, or a user's own.
    columns: the parameters that switch it on, as a system knows them.
    signs: of each column, 1 or -1 where physics allows one direction only, 0 where both.
    shapes: values of its shapes that differ from their starts, by qualified name, SI.
    sizes: parameters that are looked at at this value, by qualified name, SI, and not at their null: the
        effect begins at a threshold, and its slope at the null says nothing of it.
    """

    effect: Effect
    columns: tuple[str, ...]
    signs: tuple[int, ...]
    shapes: Mapping[str, float]
    sizes: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name

    def parameter(self, column: str) -> EffectParameter:
        """The effect's parameter that a system knows as `column`."""
        return self.effect.parameter(column.partition(".")[2])


def candidates(
    model: Model, excluded: Collection[str] = (), ranges: Ranges | None = None
) -> tuple[Candidate, ...]:
    """Every effect that `model` may lack, at every shape of its grid, in the library's order.

    Parameters
    ----------
    excluded: names of effects that are not to be looked at.
    ranges: of what was measured, over which thresholds are looked for.
    """
    present = [model.effect(name) for name in model.effects]
    impossible = {name for effect in present for name in (effect.name, *effect.instead_of)} | {*excluded}
    found: list[Candidate] = []
    for effect in (*library(model.family).values(), *model.own):
        says_the_same = any(other.name in effect.instead_of for other in present)
        if effect.terms and effect.name not in impossible and not says_the_same:
            found += _at_each_shape(effect, ranges or {})
    return tuple(found)


def by_effect(found: Sequence[Candidate]) -> dict[str, tuple[int, ...]]:
    """The places of each effect's candidates among `found`."""
    places: dict[str, list[int]] = {}
    for place, candidate in enumerate(found):
        places.setdefault(candidate.name, []).append(place)
    return {name: tuple(own) for name, own in places.items()}


def _at_each_shape(effect: Effect, ranges: Ranges) -> Iterator[Candidate]:
    switching = [parameter for parameter in effect.parameters if not parameter.shape]
    columns = tuple(qualified(effect.name, parameter.name) for parameter in switching)
    signs = tuple(int(parameter.sign) for parameter in switching)
    at_sizes = [(qualified(effect.name, one.name), size) for one in switching for size in one.grid]
    for name, size in at_sizes:
        yield Candidate(effect, columns, signs, {}, {name: size})
    measured = [one for one in effect.parameters if one.shape and one.within in ranges and one.shares]
    if not at_sizes and not measured:
        yield Candidate(effect, columns, signs, {})
    for parameter in effect.parameters:
        if parameter.shape:
            for value in _grid(parameter, ranges):
                yield Candidate(effect, columns, signs, {qualified(effect.name, parameter.name): value})


def _grid(parameter: EffectParameter, ranges: Ranges) -> tuple[float, ...]:
    """The values of a shape that are looked at: over the measured range, where there is one."""
    if parameter.within not in ranges or not parameter.shares:
        return parameter.grid
    low, high = ranges[parameter.within]
    over = [low + share * (high - low) for share in parameter.shares]
    return tuple(min(max(value, parameter.low), parameter.high) for value in over)
