"""A family is one folder, in which its equations, effects and record-level parameters are found."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

FAMILY = """
from rigctl.physics.family import InputVariable, ModelFamily, OutputVariable
from rigctl.physics.family import ParameterDeclaration, Slot, StateVariable

FAMILY = ModelFamily(
    name="kettle",
    title="Water that is heated",
    source="lumped capacitance",
    states=(
        StateVariable(
            "temperature",
            "K",
            0.1,
            lambda m: (m.power + m.total("heat")) / m.heat_capacity,
            293.15,
            "of the water",
        ),
    ),
    inputs=(InputVariable("power", "W", 0.0, "of the heater"),),
    parameters=(ParameterDeclaration("heat_capacity", "J/K", 4000.0, "of the water", 100.0, 1e5),),
    definitions=(),
    slots=(Slot("heat", "W", "into the water"),),
    outputs=(OutputVariable("temperature", "K", lambda m: m.temperature, "thermometer"),),
    generic=False,
)
"""
EFFECTS = """
from rigctl.effects.declaration import Effect, EffectParameter

EFFECTS = (
    Effect(
        name="boiler_loss",
        family="kettle",
        summary="The kettle loses heat.",
        equation="-U*(T - 293.15 K)",
        source="Newton's law of cooling",
        looks_like="It heats more and more slowly.",
        terms=(("heat", lambda m, p: -p.conductance * (m.temperature - 293.15)),),
        parameters=(EffectParameter("conductance", "W/K", 0.0, 0.1, 0.0, 100.0, "U"),),
    ),
)
"""
RECORD_LEVEL = """
from rigctl.effects.record_level import RecordLevel, Start

RECORD_LEVEL = RecordLevel(starts=(Start("temperature", "measured"),))
"""
USE = """
import sys

import rigctl.families

rigctl.families.__path__.append(sys.argv[1])

from rigctl.effects import library
from rigctl.effects.record_level import record_level
from rigctl.physics.families import FAMILIES

print(FAMILIES["kettle"].title)
print(list(library("kettle")))
print([start.state for start in record_level(FAMILIES["kettle"]).starts])
"""


def test_a_new_family_is_found_from_its_folder_alone(tmp_path: Path) -> None:
    folder = tmp_path / "kettle"
    (folder / "effects").mkdir(parents=True)
    (folder / "__init__.py").write_text("", encoding="utf-8")
    (folder / "family.py").write_text(FAMILY, encoding="utf-8")
    (folder / "effects" / "__init__.py").write_text(EFFECTS, encoding="utf-8")
    (folder / "record_level.py").write_text(RECORD_LEVEL, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["Water that is heated", "['boiler_loss']", "['temperature']"]
