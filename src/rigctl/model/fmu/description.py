"""``modelDescription.xml``: the description of a slave for other simulators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final
from xml.etree import ElementTree as ET

from rigctl.engine.system import System
from rigctl.units import parse_unit

#: the base units in the order of a dimension's exponents
_BASES: Final = ("m", "kg", "s", "A", "K", "mol", "cd")
#: first value reference of each kind, as in ``slave.c``
PARAMETERS_AT: Final = 1000
OUTPUTS_AT: Final = 100_000
STATES_AT: Final = 200_000


def model_description(
    system: System,
    *,
    name: str,
    identifier: str,
    guid: str,
    version: str,
    about: str,
    states: Sequence[float],
    inputs: Sequence[float],
    meanings: Mapping[str, str],
) -> bytes:
    """The description of a system as a slave.

    Parameters
    ----------
    name, about: of the model, for a reader.
    identifier: the name of its shared library.
    version: of rigctl.
    states, inputs: at the start, SI.
    meanings: description of each variable, by name.
    """
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=about,
        generationTool=f"rigctl {version}",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    slave = ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canNotUseMemoryManagementFunctions="true",
    )
    ET.SubElement(ET.SubElement(slave, "SourceFiles"), "File", name="slave.c")
    _units(root, system)
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", tolerance="1e-08")
    variables = ET.SubElement(root, "ModelVariables")
    for index, (item, start) in enumerate(zip(system.inputs, inputs, strict=True)):
        _variable(variables, meanings, item.name, item.unit, index, start, "input", "discrete")
    for index, parameter in enumerate(system.parameters):
        reference = PARAMETERS_AT + index
        name_, unit = parameter.name, parameter.unit
        _variable(variables, meanings, name_, unit, reference, parameter.value, "parameter", "fixed")
    for index, (state, start) in enumerate(zip(system.states, states, strict=True)):
        reference = STATES_AT + index
        _variable(
            variables, meanings, f"state.{state.name}", state.unit, reference, start, "local", "continuous"
        )
    # outputs come last, as the structure below names them by their numbers, from 1
    first = len(variables) + 1
    for index, output in enumerate(system.outputs):
        reference = OUTPUTS_AT + index
        _variable(variables, meanings, output.name, output.unit, reference, None, "output", "continuous")
    structure = ET.SubElement(root, "ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        part = ET.SubElement(structure, kind)
        for index in range(len(system.outputs)):
            ET.SubElement(part, "Unknown", index=str(first + index))
    ET.indent(root)
    text: str = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _variable(
    parent: ET.Element,
    meanings: Mapping[str, str],
    name: str,
    unit: str,
    reference: int,
    start: float | None,
    causality: str,
    variability: str,
) -> None:
    about = meanings.get(name.removeprefix("state."), "")
    facts = {
        "name": name,
        "valueReference": str(reference),
        "causality": causality,
        "variability": variability,
    }
    if causality == "local":
        facts["initial"] = "exact"
    if causality == "output":
        facts["initial"] = "calculated"
    variable = ET.SubElement(parent, "ScalarVariable", {**facts, **({"description": about} if about else {})})
    real = {} if start is None else {"start": repr(float(start))}
    ET.SubElement(variable, "Real", {**({"unit": unit} if unit != "1" else {}), **real})


def _units(root: ET.Element, system: System) -> None:
    """Every unit with its exponents of the base units."""
    units = {item.unit for item in system.inputs} | {item.unit for item in system.parameters}
    units |= {item.unit for item in system.states} | {item.unit for item in system.outputs}
    units -= {"1"}
    if not units:
        return
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted(units):
        parsed = parse_unit(unit)
        definition = ET.SubElement(definitions, "Unit", name=unit)
        if all(power.denominator == 1 for power in parsed.dimension.exponents):
            named_powers = zip(_BASES, parsed.dimension.exponents, strict=True)
            powers = {base: str(int(power)) for base, power in named_powers if power}
            ET.SubElement(definition, "BaseUnit", powers)
