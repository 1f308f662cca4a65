"""The two systems of equations around a foreign program: what it is given, and what is read of it.

Both have the parameters of the whole. The first has the states on which the program's inputs depend, and as
outputs those inputs, and what is added to the program's parameters; the second the program's outputs, with
their rates among its inputs, and the states on which readings depend.
"""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.engine.symbols import Expr, variables_of
from rigctl.engine.system import Foreign, Input, Output, System, rate_of
from rigctl.errors import RigctlError


def parts_of(system: System, foreign: Foreign) -> tuple[System, System]:
    """The equations before and after the foreign program.

    Raises
    ------
    RigctlError
        what it is given depends on what it computes: a loop around it, which is not supported.
    """
    exprs = [*foreign.drives, *(one.expr for one in foreign.added), *(one.expr for one in system.delays)]
    before = _states_behind(system, exprs)
    loop = before & set(foreign.responses)
    if loop:
        raise RigctlError(
            f"what {foreign.program.name} is given depends on what it computes",
            value=min(loop),
            expected="effects on its inputs and parameters that use inputs alone",
        )
    after = _states_behind(system, [one.expr for one in system.outputs]) | set(foreign.responses)
    rates = tuple(
        Input(rate_of(name), unit) for name, unit in zip(foreign.responses, foreign.rate_units, strict=True)
    )
    units = {item.name: item.unit for item in system.inputs}
    units |= {item.name: item.unit for item in system.parameters}
    given = [
        *zip(foreign.program.inputs, foreign.drives, strict=True),
        *((one.parameter, one.expr) for one in foreign.added),
    ]
    drives = tuple(Output(name, units[name], expr) for name, expr in given)
    return (
        _part(system, before, system.inputs, drives, delays=True),
        _part(system, after, (*system.inputs, *rates), system.outputs, delays=False),
    )


def _part(
    system: System,
    states: set[str],
    inputs: tuple[Input, ...],
    outputs: tuple[Output, ...],
    *,
    delays: bool,
) -> System:
    chosen = [k for k, name in enumerate(system.state_names) if name in states]
    return System(
        system.graph,
        tuple(system.states[k] for k in chosen),
        inputs,
        system.parameters,
        tuple(system.rhs[k] for k in chosen),
        outputs,
        system.delays if delays else (),
    )


def _states_behind(system: System, exprs: Iterable[Expr]) -> set[str]:
    """The states on which `exprs` depend, also through the rates of others."""
    rates = dict(zip(system.state_names, system.rhs, strict=True))
    found: set[str] = set()
    open_ones = list(exprs)
    while open_ones:
        for variable in variables_of(open_ones.pop()):
            if variable.name in rates and variable.name not in found:
                found.add(variable.name)
                open_ones.append(rates[variable.name])
    return found
