"""What an FMU says of itself in its ``modelDescription.xml``; nothing of it is executed.

In: the path of an FMU. Out: its real scalar variables, with units as factor and offset to SI, and how it can
be simulated. The description is read in full before the FMU is allowed to run, so that wrong names, units
and platforms are found without executing foreign code. A unit is first read as rigctl writes it, then as
Modelica does (``kg.m2``), and last by the FMU's own definition in base units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.fmu.archive import checked_platforms
from rigctl.units import Unit, parse_unit

Kind = Literal["CoSimulation", "ModelExchange"]

_REAL = ("Real", "Float64")
#: the base units in which an FMU defines others
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
#: possible names of the variable that sets an output's value at the start
_STARTS = ("state.{}", "{}_start", "{}start", "{}_0", "{}0", "{}")
#: an exponent as Modelica writes it, ``kg.m2``
_MODELICA = re.compile(r"([A-Za-z])(-?\d+)")


@dataclass(frozen=True)
class Variable:
    """A real scalar variable.

    Attributes
    ----------
    reference: its value reference.
    unit: as the FMU writes it; None if it gives none, and the variable is in SI.
    settable: whether its value can be set before a simulation, and is then kept.
    tunable: whether it is a parameter whose value can be set during a simulation, too.
    start, low, high, nominal: its value by default, its bounds and its usual size, in the FMU's unit; None
        if it gives none.
    meaning: its description.
    """

    name: str
    reference: int
    causality: str
    unit: str | None
    settable: bool
    tunable: bool = False
    start: float | None = None
    low: float | None = None
    high: float | None = None
    nominal: float | None = None
    meaning: str = ""


@dataclass(frozen=True)
class Port:
    """A variable that is read or set: ``SI value = factor·value + offset``."""

    name: str
    reference: int
    factor: float
    offset: float


@dataclass(frozen=True)
class Description:
    """The real scalar variables of an FMU, and how it can be simulated.

    Attributes
    ----------
    version: of FMI, "2.0" or "3.0".
    defined, bases: by unit that the FMU defines, its factor and offset to SI, and the unit in SI.
    """

    path: Path
    version: str
    kind: Kind
    variables: Mapping[str, Variable]
    defined: Mapping[str, tuple[float, float]]
    bases: Mapping[str, str]

    def named(self, causality: str) -> list[str]:
        """The names of its inputs or outputs."""
        return [name for name, one in self.variables.items() if one.causality == causality]

    def start_of(self, output: str, unit: str | None = None) -> str | None:
        """The variable that sets an output's value at the start, by its name; None if there is none.

        Parameters
        ----------
        unit: of the output, where the FMU gives none.
        """
        known = self.unit(output) if output in self.variables else None
        if known is None and unit is not None:
            known = parse_unit(unit)
        for pattern in _STARTS:
            one = self.variables.get(pattern.format(output))
            if one is None or not one.settable:
                continue
            own = self.unit(one.name)
            if own is None or known is None or own.dimension == known.dimension:
                return one.name
        return None

    def variable(self, name: str) -> Variable:
        """The variable called `name`.

        Raises
        ------
        RigctlError
            there is none, or it is no real scalar.
        """
        if name not in self.variables:
            raise unknown_name(f"real variable of {self.path.name}", name, self.variables)
        return self.variables[name]

    def unit(self, name: str) -> Unit | None:
        """The unit of the variable called `name`, if rigctl can write it; None if not, or if it has none."""
        written = self.variable(name).unit
        if not written:
            return None
        return _parsed(written) or _parsed(_MODELICA.sub(r"\1^\2", written.replace(".", "*")))

    def port(self, name: str) -> Port:
        """The variable called `name`, to be read or set in SI.

        Raises
        ------
        RigctlError
            its unit is not known, and not defined by the FMU.
        """
        one = self.variable(name)
        if not one.unit:
            return Port(name, one.reference, 1.0, 0.0)
        # The factor and offset of an affine unit follow from two points: offset = SI(0), factor = SI(1) −
        # SI(0).
        unit = self.unit(name)
        if unit is not None:
            offset = float(unit.to_si(0.0))
            return Port(name, one.reference, float(unit.to_si(1.0)) - offset, offset)
        if one.unit not in self.defined:
            raise RigctlError(
                f"the FMU has an unknown unit for {name}, and does not define it",
                value=one.unit,
                where=Location(self.path),
            )
        return Port(name, one.reference, *self.defined[one.unit])


def read_description(path: Path) -> Description:
    """Read the description of an FMU.

    Raises
    ------
    RigctlError
        FMPy is missing, the file is no FMU, it is of another kind, or has no program for this computer.
    """
    if find_spec("fmpy") is None:
        raise RigctlError("running an FMU needs FMPy", hint="pip install 'rigctl[fmu]'")
    platforms = checked_platforms(path)
    from fmpy import platform, platform_tuple, read_model_description

    try:
        found: Any = read_model_description(str(path))
    except Exception as problem:  # a damaged description has many ways to fail
        what = f"the description of the FMU cannot be read: {problem}"
        raise RigctlError(what, where=Location(path)) from problem
    kind = _kind(found, path)
    version = str(found.fmiVersion)
    ours = platform if version == "2.0" else platform_tuple
    if ours not in platforms:
        raise RigctlError(
            "the FMU has no program for this computer",
            where=Location(path),
            value=", ".join(platforms) or "sources alone",
            expected=ours,
        )
    variables = [_variable(one) for one in found.modelVariables if one.type in _REAL and not one.dimensions]
    bases = {one.name: one.baseUnit for one in found.unitDefinitions}
    return Description(
        path=path,
        version=version,
        kind=kind,
        variables={one.name: one for one in variables},
        defined={
            name: (float(base.factor or 1.0), float(base.offset or 0.0))
            for name, base in bases.items()
            if base is not None
        },
        bases={name: _in_base_units(base) for name, base in bases.items() if base is not None},
    )


def _in_base_units(base: Any) -> str:
    """A unit that an FMU defines, in SI: ``kg*m^2*s^-3``."""
    powers = {name: int(getattr(base, name, None) or 0) for name in _BASE}
    return (
        "*".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items() if power) or "1"
    )


def _kind(found: Any, path: Path) -> Kind:
    """How the FMU is simulated: by itself, if it can."""
    if found.fmiVersion in ("2.0", "3.0"):
        if found.coSimulation is not None:
            return "CoSimulation"
        if found.modelExchange is not None:
            return "ModelExchange"
    raise RigctlError(
        "an unsupported kind of FMU",
        where=Location(path),
        value=f"FMI {found.fmiVersion}",
        expected="FMI 2.0 or 3.0, for co-simulation or model exchange",
    )


def _variable(one: Any) -> Variable:
    def own(name: str) -> Any:
        """An attribute of it, or of its declared type."""
        value = getattr(one, name, None)
        return value if value is not None else getattr(one.declaredType, name, None)

    # Only such a value survives the initialisation; anything else that is set before it would be computed
    # anew.
    kept = one.causality == "parameter" or one.initial == "exact"
    return Variable(
        name=str(one.name),
        reference=int(one.valueReference),
        causality=str(one.causality),
        unit=own("unit"),
        settable=kept and one.causality != "input" and one.variability != "constant",
        tunable=one.causality == "parameter" and one.variability == "tunable",
        start=_number(one.start),
        low=_number(own("min")),
        high=_number(own("max")),
        nominal=_number(own("nominal")),
        meaning=str(one.description or ""),
    )


def _number(written: object) -> float | None:
    try:
        return None if written is None else float(str(written))
    except ValueError:
        return None


def _parsed(text: str) -> Unit | None:
    try:
        return parse_unit(text)
    except RigctlError:
        return None
