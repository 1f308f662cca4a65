"""A family whose equations are in an FMU: the family file names it, and maps our names to its variables.

In: the family file; of the FMU, only its description is read. Out: a family with a `Program`. The FMU's
outputs become the family's states, as if each had a rate of its own: what is read of them, and every effect
on a reading, a command or a parameter, stays in equations, with their derivatives and units. No other slot
lies inside the FMU, since nothing can be added to equations that are not visible.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from rigctl.errors import RigctlError
from rigctl.files.name import Name as BenchName
from rigctl.files.quantity import AnyQuantity, in_dimension
from rigctl.files.reader import Reader
from rigctl.files.validate import validate
from rigctl.files.yaml import Document
from rigctl.fmu.archive import digest
from rigctl.fmu.description import Description, Port, read_description
from rigctl.fmu.program import FmuProgram
from rigctl.physics.derived_slots import around
from rigctl.physics.family import ModelFamily
from rigctl.physics.user.declare import declare
from rigctl.physics.user.schema import (
    FamilyFile,
    FormulaField,
    InputField,
    Name,
    ParameterField,
    StartField,
    StateField,
)
from rigctl.project import find_project
from rigctl.units import parse_unit


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class FmuCondition(_Part):
    """A quantity with which parameters of the FMU may change, and that it does not have. Its unit is that of
    `value`."""

    value: AnyQuantity = Field(description="what it is when nobody says, with its unit")
    role: Literal["move", "heat", "set_pressure"] | None = Field(
        default=None,
        description="the rig's role whose actuator commands it; else the actuator of its own name does",
    )
    hold: Literal["previous", "linear"] | None = Field(
        default=None, description="between two values: the previous one, or a straight line"
    )
    meaning: str = Field(default="", description="what it is")


class FmuInput(FmuCondition):
    """An input of the FMU. Its unit is that of `value`."""

    variable: str = Field(default="", description="the FMU's name of it; by default the same")


class FmuParameter(ParameterField):
    """A parameter of the FMU."""

    variable: str = Field(default="", description="the FMU's name of it; by default the same")


class FmuOutput(_Part):
    """An output of the FMU, which a channel of this name reads."""

    unit: str = Field(description="in which it is shown")
    variable: str = Field(default="", description="the FMU's name of it; by default the same")
    scale: AnyQuantity = Field(description="a change of it that matters")
    start: StartField | None = Field(
        default=None, description="its value when nothing else is known; by default the FMU's"
    )
    start_variable: str | None = Field(
        default=None,
        description="the FMU's variable that sets its value at the start; by default 'state.NAME', "
        "'NAME_start', 'NAMEstart', 'NAME_0', 'NAME0' or the output itself, as far as they can be set",
    )
    meaning: str = Field(default="", description="what it is")


class FmuFamilyFile(_Part):
    """One kind of bench whose equations are in an FMU."""

    family: Name = Field(description="its name")
    title: str = Field(default="", description="one line about it")
    fmu: str = Field(description="the FMU, FMI 2.0 or 3.0")
    inputs: dict[BenchName, FmuInput] = Field(default_factory=dict, description="what it is given")
    parameters: dict[Name, FmuParameter] = Field(default_factory=dict, description="what a fit may change")
    outputs: dict[BenchName, FmuOutput] = Field(min_length=1, description="what sensors read")
    conditions: dict[BenchName, FmuCondition] = Field(
        default_factory=dict, description="with what parameters may change that the FMU does not have"
    )


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
    for name in written.conditions:
        if name in written.inputs:
            reader.refuse(
                ("conditions", name),
                RigctlError("drifts with the inputs of the FMU are looked for without this", value=name),
            )
        elif name in (*written.outputs, *written.parameters):
            kind = "an output" if name in written.outputs else "a parameter"
            reader.refuse(("conditions", name), RigctlError(f"{kind} has this name already", value=name))
    path = Path(document.path) if document.path else None
    about = reader.read(("fmu",), partial(_described, written.fmu, path))
    reader.stop_at_errors()
    assert about is not None  # noqa: S101 - the reader has stopped where it is
    program = _connected(reader, written, about)
    reader.stop_at_errors()
    # The declarations are checked by the same code as those of a family with equations; its placeholders for
    # rates and outputs are replaced afterwards.
    family = declare(reader, _as_equations(written, about, program))
    reader.stop_at_errors()
    return around(program, family)


def _connected(reader: Reader, written: FmuFamilyFile, about: Description) -> FmuProgram:
    """The FMU with the variables that the file names; what is wrong is reported to `reader`."""
    given: dict[str, dict[str, Port]] = {"inputs": {}, "parameters": {}, "outputs": {}}
    starts: dict[str, Port | None] = {}
    wanted = [
        *(("inputs", name, one.variable, one.value.unit.text or "1") for name, one in written.inputs.items()),
        *(
            ("parameters", name, one.variable, one.value.unit.text or "1")
            for name, one in written.parameters.items()
        ),
        *(("outputs", name, one.variable, one.unit) for name, one in written.outputs.items()),
    ]
    for part, name, variable, unit in wanted:
        port = reader.read((part, name), partial(_port, about, part[:-1], variable or name, unit))
        if port is not None:
            given[part][name] = port
    for name, output in written.outputs.items():
        starts[name] = reader.read(("outputs", name, "start_variable"), partial(_start, about, name, output))
    sizes = {name: _size(one) for name, one in written.parameters.items()}
    tunable = tuple(name for name, port in given["parameters"].items() if about.variable(port.name).tunable)
    return FmuProgram(
        about.path,
        digest(about.path),
        about.kind,
        **given,
        sizes=sizes,
        starts=starts,
        tunable=tunable,
    )


def _as_equations(written: FmuFamilyFile, about: Description, program: FmuProgram) -> FamilyFile:
    """The same family, as if its equations were in the file."""
    inputs = {
        name: InputField.model_construct(**{**dict(one), "delay": None})
        for name, one in (written.inputs | written.conditions).items()
    }
    states = {
        name: StateField.model_construct(
            start=one.start or _default_start(about, program.outputs[name], one),
            scale=one.scale,
            rate="0",
            meaning=one.meaning,
        )
        for name, one in written.outputs.items()
    }
    outputs = {
        name: FormulaField(unit=one.unit, formula=name, meaning=one.meaning)
        for name, one in written.outputs.items()
    }
    return FamilyFile.model_construct(
        family=written.family,
        title=written.title,
        source=about.path.name,
        states=states,
        inputs=inputs,
        parameters=dict(written.parameters),
        outputs=outputs,
    )


def _default_start(about: Description, port: Port, one: FmuOutput) -> StartField:
    variable = about.variable(port.name)
    si = 0.0 if variable.start is None else port.factor * variable.start + port.offset
    return StartField.model_validate(f"{parse_unit(one.unit).from_si(si)!r} {one.unit}")


def _described(fmu: str, beside: Path | None) -> Description:
    project = find_project(beside.parent if beside is not None else None)
    return read_description(project.resolve(fmu, relative_to=beside))


def _size(one: FmuParameter) -> float:
    """A change of a parameter that matters, SI: its value, or for 0 a share of its bounds."""
    low, high = (in_dimension(end, one.value.unit.text or "1") for end in one.bounds)
    return abs(one.value.si) or 0.01 * (high - low)


def _port(about: Description, causality: str, variable: str, unit: str) -> Port:
    """A variable of the FMU, for a quantity of a unit.

    Raises
    ------
    RigctlError
        there is none, it cannot be set, or it is of another dimension.
    """
    found, known = about.variable(variable), about.unit(variable)
    if causality == "input" and found.causality != "input":
        raise RigctlError(f"{variable} is no input of {about.path.name}", value=found.causality)
    if causality == "parameter" and not found.settable:
        raise RigctlError(
            f"{variable} of {about.path.name} cannot be set before a simulation",
            value=found.causality,
            expected=f"one of {', '.join(about.named('parameter'))}",
        )
    if known is not None and known.dimension != parse_unit(unit).dimension:
        raise RigctlError(
            f"{variable} of {about.path.name} has another dimension", value=unit, expected=f"as {known.text}"
        )
    port = about.port(variable)
    if known is None and found.unit is None:  # it says nothing of its unit: the file's is meant
        shown = parse_unit(unit)
        return Port(port.name, port.reference, shown.to_si(1.0) - shown.to_si(0.0), shown.to_si(0.0))
    return port


def _start(about: Description, name: str, one: FmuOutput) -> Port | None:
    variable = one.start_variable or about.start_of(one.variable or name, one.unit)
    return None if variable is None else _port(about, "parameter", variable, one.unit)
