"""The board's declaration."""

from __future__ import annotations

from rigctl.families.heater_board import equations
from rigctl.families.heater_board.equations import HEATERS
from rigctl.physics.family import Definition, InputVariable, ModelFamily, OutputVariable, Slot, StateVariable
from rigctl.physics.family import ParameterDeclaration as Parameter
from rigctl.physics.standard_record import StandardRecord, grid

STATES = tuple(
    StateVariable(
        f"temperature_{n}",
        "K",
        0.1,
        equations.temperature_rate(n),
        296.15,
        f"of heater {n} and its thermometer",
    )
    for n in HEATERS
)

INPUTS = (
    *(InputVariable(f"heater_{n}", "1", 0.0, f"command of heater {n}, 0 to 1") for n in HEATERS),
    InputVariable("ambient_temperature", "K", 296.15, "around the board, one value for each record"),
)

#: none of the bounds is physical
_USUAL = (True, True)

PARAMETERS = (
    *(
        Parameter(f"heater_gain_{n}", "W", 1.0, f"power of heater {n} at 100 %", 0.01, 100.0, usual=_USUAL)
        for n in HEATERS
    ),
    Parameter("heat_capacity", "J/K", 2.0, "C of one heater with its thermometer", 0.1, 200.0, usual=_USUAL),
    Parameter("convection", "W/K", 0.012, "U: heat lost per kelvin above ambient", 1e-4, 1.0, usual=_USUAL),
)

DEFINITIONS = (
    Definition("room_temperature", "K", equations.ambient, "around the board, as it drifts"),
    *(
        Definition(f"heat_of_heater_{n}", "W", equations.heater_power(n), f"given off by heater {n}")
        for n in HEATERS
    ),
    *(
        Definition(f"heat_to_room_{n}", "W", equations.convection(n), f"from heater {n} to the room")
        for n in HEATERS
    ),
)

SLOTS = (
    *(Slot(f"heat_{n}", "W", f"into heater {n}") for n in HEATERS),
    *(Slot(f"heater_power_{n}", "W", f"of heater {n}, besides what is commanded") for n in HEATERS),
    Slot("heater_gain", "1", "of a heater's power", combine="product", local=(("command", "1"),)),
    Slot("convection", "1", "of the heat loss to the room", combine="product", local=(("difference", "K"),)),
    Slot("ambient", "K", "of the room, above what was recorded"),
    *(
        Slot(f"temperature_{n}_reading", "K", f"of thermometer {n}, beside the truth", kind="sensor")
        for n in HEATERS
    ),
)

OUTPUTS = tuple(
    OutputVariable(f"temperature_{n}", "K", equations.reading(n), f"thermometer {n}") for n in HEATERS
)

STANDARD_RECORD = StandardRecord(
    "heater 1 at 80 %, after 10 min heater 2 at 40 %, both off after 20 min, until 30 min; room at 23 degC",
    times=grid(1800.0, 5.0),
    switches=(
        (0.0, {}),
        (30.0, {"heater_1": 0.8}),
        (600.0, {"heater_2": 0.4}),
        (1200.0, {"heater_1": 0.0, "heater_2": 0.0}),
    ),
)

FAMILY = ModelFamily(
    name="heater_board",
    title="Two heaters with a thermometer each on one board",
    source="Incropera & DeWitt, Fundamentals of Heat and Mass Transfer: lumped capacitance",
    states=STATES,
    inputs=INPUTS,
    parameters=PARAMETERS,
    definitions=DEFINITIONS,
    slots=SLOTS,
    outputs=OUTPUTS,
    rig_names={"heater_gain": ("heater_gain_1", "heater_gain_2")},
    standard_record=STANDARD_RECORD,
    generic=False,
)
