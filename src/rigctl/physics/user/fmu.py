"""A family whose equations are in an FMU: the family file names it, and maps our names to its variables.

Only the FMU's description is read here. Its outputs are the family's states, as if each had a rate of its own:
what is read of them, and every effect on a reading or a command, stays in equations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from rigctl.engine.symbols import Expr, Scalar
from rigctl.engine.system import rate_of
from rigctl.errors import RigctlError
from rigctl.files.name import Name as BenchName
from rigctl.files.quantity import AnyQuantity, in_dimension
from rigctl.files.reader import Reader
from rigctl.files.validate import validate
from rigctl.files.yaml import Document
from rigctl.fmu.description import Description, Variable, read_description
from rigctl.fmu.program import Port, Program, digest
from rigctl.physics.derived_slots import per_second, with_edge_slots
from rigctl.physics.family import InputVariable, ModelFamily, OutputVariable, ParameterDeclaration, StateVariable
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.physics.user.schema import Name, ParameterField
from rigctl.project import find_project
from rigctl.units import parse_unit

#: change of an output that matters where none is stated, in its unit
_SCALE = 1e-3


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class FmuInput(_Part):
    """An input of the FMU."""

    value: AnyQuantity = Field(description="what it is when nobody says, with its unit")
    variable: str = Field(default="", description="the FMU's name of it; by default the same")
    role: Literal["move", "heat", "set_pressure"] | None = Field(default=None, description="as of an input")
    meaning: str = Field(default="", description="what it is")


class FmuParameter(ParameterField):
    """A parameter of the FMU."""

    variable: str = Field(default="", description="the FMU's name of it; by default the same")


class FmuOutput(_Part):
    """An output of the FMU, which a channel of this name reads."""

    unit: str = Field(description="in which it is shown")
    variable: str = Field(default="", description="the FMU's name of it; by default the same")
    start: str | None = Field(default=None, description="the variable that sets its value at the start")
    scale: AnyQuantity | None = Field(default=None, description="a change of it that matters")
    meaning: str = Field(default="", description="what it is")


class FmuFamilyFile(_Part):
    """One kind of bench whose equations are in an FMU."""

    family: Name = Field(description="its name")
    title: str = Field(default="", description="one line about it")
    fmu: str = Field(description="the FMU, FMI 2.0 or 3.0")
    inputs: dict[BenchName, FmuInput] = Field(default_factory=dict, description="what it is given")
    parameters: dict[Name, FmuParameter] = Field(default_factory=dict, description="what a fit may change")
    outputs: dict[BenchName, FmuOutput] = Field(min_length=1, description="what sensors read")


@dataclass(frozen=True)
class _Itself:
    """The reading of an output is the output."""

    name: str

    def __call__(self, m: Scope) -> Scalar:
        return m[self.name]


@dataclass(frozen=True)
class _Rate:
    """The rate of an FMU's output: a variable that only a simulation knows; 0 in plain numbers."""

    name: str
    unit: str

    def __call__(self, m: Scope) -> Scalar:
        value = m[self.name]
        if isinstance(value, Expr):
            return value.graph.variable(rate_of(self.name), parse_unit(per_second(self.unit)).dimension)
        return 0.0


def fmu_family(document: Document, taken: Iterable[str]) -> ModelFamily:
    """The family of a file that names an FMU.

    Raises
    ------
    RigctlError
        the file is wrong, or the FMU has no variable of a name, or one of another dimension.
    """
    written = validate(document, FmuFamilyFile)
    reader = Reader(document)
    if written.family in taken:
        error = RigctlError("there is a model family of this name already", value=written.family)
        reader.refuse(("family",), error)
    path = Path(document.path) if document.path else None
    about = reader.read(("fmu",), partial(_described, written.fmu, path))
    reader.stop_at_errors()
    assert about is not None  # noqa: S101 - the reader has stopped where it is
    inputs, parameters, outputs = [], [], []
    for name, one in written.inputs.items():
        unit = one.value.unit.text or "1"
        inputs.append(reader.read(("inputs", name), partial(_port, about, name, one.variable, unit)))
    for name, parameter in written.parameters.items():
        unit = parameter.value.unit.text or "1"
        parameters.append(reader.read(("parameters", name), partial(_port, about, name, parameter.variable, unit)))
    starts = []
    for name, output in written.outputs.items():
        outputs.append(reader.read(("outputs", name), partial(_port, about, name, output.variable, output.unit)))
        starts.append(reader.read(("outputs", name, "start"), partial(_start, about, name, output)))
    reader.stop_at_errors()
    program = Program(
        about.path,
        digest(about.path),
        about.version,
        about.kind,
        tuple(one for one in inputs if one is not None),
        tuple(one for one in outputs if one is not None),
        tuple(one for one in parameters if one is not None),
        tuple(starts),
    )
    return with_edge_slots(_declared(written, about, program))


def _declared(written: FmuFamilyFile, about: Description, program: Program) -> ModelFamily:
    states, outputs = [], []
    for name, one in written.outputs.items():
        unit = si_unit(one.unit)
        shown = parse_unit(one.unit)
        scale = _SCALE * shown.factor if one.scale is None else in_dimension(one.scale, one.unit, difference=True)
        variable = about.variable(one.variable or name)
        start = variable.si(variable.start) if variable.start is not None else 0.0
        difference = not shown.absolute_temperature
        states.append(StateVariable(name, unit, scale, _Rate(name, unit), start, one.meaning, difference))
        outputs.append(OutputVariable(name, unit, _Itself(name), one.meaning, shown=one.unit))
    return ModelFamily(
        name=written.family,
        title=written.title or written.family,
        source=about.path.name,
        states=tuple(states),
        inputs=tuple(
            InputVariable(
                name,
                si_unit(one.value.unit.text or "1"),
                one.value.si,
                one.meaning,
                role=one.role,
                difference=not parse_unit(one.value.unit.text or "1").absolute_temperature,
                shown=one.value.unit.text or "1",
            )
            for name, one in written.inputs.items()
        ),
        parameters=tuple(_parameter(name, one) for name, one in written.parameters.items()),
        definitions=(),
        slots=(),
        outputs=tuple(outputs),
        program=program,
    )


def _parameter(name: str, one: FmuParameter) -> ParameterDeclaration:
    unit = one.value.unit.text or "1"
    low, high = (in_dimension(end, unit) for end in one.bounds)
    return ParameterDeclaration(name, unit, one.value.si, one.meaning, low, high, standing=one.standing or "")


def _described(fmu: str, beside: Path | None) -> Description:
    project = find_project(beside.parent if beside is not None else None)
    return read_description(project.resolve(fmu, relative_to=beside))


def _port(about: Description, name: str, variable: str, unit: str) -> Port:
    found = about.variable(variable or name)
    if found.unit is not None and parse_unit(found.unit).dimension != parse_unit(unit).dimension:
        raise RigctlError(f"{found.name} of {about.path.name} is in {found.unit}", value=unit)
    return _as_port(name, found)


def _start(about: Description, name: str, one: FmuOutput) -> Port | None:
    if one.start is not None:
        return _as_port(name, about.variable(one.start))
    found = about.start_of(one.variable or name)
    return None if found is None else _as_port(name, found)


def _as_port(name: str, found: Variable) -> Port:
    scale = abs(found.factor * (found.nominal or 1.0))
    return Port(name, found.name, found.reference, found.factor, found.offset, scale)
