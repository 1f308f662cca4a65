"""A Python function as an effect, for packages that register theirs.

In the package's ``pyproject.toml``::

    [project.entry-points."rigctl.effects"]
    seal_breathing = "my_package.effects:seal_breathing"
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rigctl.effects.declaration import Effect, EffectParameter, EffectState, Term
from rigctl.physics.families import find_family


def effect(
    slot: str,
    parameters: Sequence[EffectParameter],
    *,
    family: str = "hydraulic_cylinder",
    equation: str,
    source: str = "",
    looks_like: str = "",
    states: Sequence[EffectState] = (),
    confused_with: Sequence[str] = (),
    instead_of: Sequence[str] = (),
    needs: str | None = None,
) -> Callable[[Term], Effect]:
    """Make an effect of the decorated function: its name, and the first line of its docstring as the summary.

    The function takes the model's variables and the effect's parameters, ``(m, p)``, and returns the term at
    `slot`, computed with the functions of `rigctl.engine.symbols`. An effect that acts at several slots is
    declared as an `Effect`.

    >>> size = EffectParameter("size", "N", 0.0, 50.0, 0.0, 500.0, "F")
    >>> @effect("friction", [size], equation="F*v/(1 m/s)")
    ... def drag(m, p):
    ...     "A force in proportion to the speed."
    ...     return p.size * m.velocity / m.constant(1.0, "m/s")
    >>> drag.name, drag.slots, drag.summary
    ('drag', ('friction',), 'A force in proportion to the speed.')

    Raises
    ------
    RigctlError
        there is no such family or slot.
    """
    kind = find_family(family).slot(slot).kind

    def declare(term: Term) -> Effect:
        lines = (term.__doc__ or "").strip().splitlines()
        return Effect(
            name=getattr(term, "__name__", "effect"),
            family=family,
            summary=lines[0] if lines else equation,
            equation=equation,
            source=source,
            looks_like=looks_like,
            terms=((slot, term),),
            parameters=tuple(parameters),
            states=tuple(states),
            kind="sensor" if kind == "sensor" else "process",
            confused_with=tuple(confused_with),
            instead_of=tuple(instead_of),
            needs=needs,
        )

    return declare
