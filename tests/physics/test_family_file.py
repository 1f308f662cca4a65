"""A user's family file: the family it gives, and its error messages."""

from __future__ import annotations

import math
import pickle
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.engine.symbols import Expr, Graph
from rigctl.errors import RigctlError
from rigctl.files.schema import json_schema
from rigctl.files.shipped import shipped
from rigctl.files.yaml import parse_document
from rigctl.physics.families import FAMILIES
from rigctl.physics.family import ModelFamily
from rigctl.physics.scope import Addition, Scope
from rigctl.physics.user import load_family, parse_family
from rigctl.physics.user.schema import FamilyFile
from rigctl.units import parse_unit

TANK = shipped("models", "families", "water-tank.yaml")
TEXT = TANK.read_text(encoding="utf-8")
PATH = Path("tank.yaml")

#: a minimal family
SMALL = """\
family: cup
states:
  heat:
    start: 60 degC
    scale: 0.1 K
    rate: (room - heat)/time + warmth
inputs:
  room: {value: 20 degC}
parameters:
  time: {value: 10 min, bounds: [1 min, 2 h]}
slots:
  warmth: {unit: K/min}
outputs:
  heat: {unit: degC, formula: heat}
"""


def refused(text: str) -> str:
    with pytest.raises(RigctlError) as found:
        parse_family(text, PATH)
    return str(found.value)


def changed(old: str, new: str, text: str = SMALL) -> str:
    assert old in text
    return refused(text.replace(old, new))


@pytest.fixture(scope="module")
def tank() -> ModelFamily:
    return load_family(TANK)


def at(tank: ModelFamily, *additions: Addition, **values: float) -> Scope:
    known = {p.name: p.value for p in tank.parameters} | {s.name: s.start for s in tank.states}
    known |= {item.name: item.value for item in tank.inputs}
    return Scope(tank, known | values, additions=additions)


def test_quantities_are_si_and_keep_their_display_unit(tank: ModelFamily) -> None:
    level, temperature = tank.states
    assert (level.unit, level.start, level.scale) == ("m", pytest.approx(0.2), pytest.approx(1e-3))
    assert (temperature.unit, temperature.start, temperature.scale) == ("K", pytest.approx(293.15), 0.1)
    area = tank.parameter("orifice_area")
    assert (area.unit, area.value) == ("mm^2", pytest.approx(20e-6))
    assert (area.low, area.high, area.fixed) == (pytest.approx(1e-6), pytest.approx(500e-6), False)
    assert tank.parameter("gravity").fixed
    heater = next(item for item in tank.inputs if item.name == "heater")
    assert (heater.role, heater.unit, heater.value) == ("heat", "W", 0.0)
    assert tank.slot("orifice").combine == "product"
    assert tank.slot("level_reading").kind == "sensor"


def test_the_equations_of_the_tank_equal_a_hand_calculation(tank: ModelFamily) -> None:
    m = at(tank, level=0.3, temperature=320.0, inflow=5e-5, heater=800.0)
    head = 0.5 * (0.3 + math.hypot(0.3, 1e-3))
    outflow = 0.61 * 20e-6 * math.sqrt(2 * 9.80665 * head)
    assert m.rate("level") == pytest.approx((5e-5 - outflow) / 0.05)
    heat = 800.0 - 3.0 * (320.0 - 293.15) + 998.0 * 4180.0 * 5e-5 * (288.15 - 320.0)
    assert m.rate("temperature") == pytest.approx(heat / (998.0 * 4180.0 * 0.05 * head))


def test_an_addition_acts_at_its_slot(tank: ModelFamily) -> None:
    plain = at(tank)
    leaking = at(tank, Addition("leak", "a hole", lambda m: -1e-5))
    assert float(leaking.rate("level")) - float(plain.rate("level")) == pytest.approx(-1e-5 / 0.05)
    clogged = at(tank, Addition("orifice", "chalk", lambda m: 0.5))
    assert clogged.outflow == pytest.approx(0.5 * float(plain.outflow))
    off = at(tank, Addition("level_reading", "offset", lambda m: 2e-3))
    reading = next(output for output in tank.outputs if output.name == "level")
    assert reading.formula(off) == pytest.approx(0.202)


def test_the_equations_accept_symbols(tank: ModelFamily) -> None:
    graph = Graph()
    known = {s.name: graph.variable(s.name, parse_unit(s.unit).dimension) for s in tank.states}
    known |= {i.name: graph.variable(i.name, parse_unit(i.unit).dimension) for i in tank.inputs}
    known |= {p.name: graph.variable(p.name, parse_unit(p.unit).dimension) for p in tank.parameters}
    assert isinstance(Scope(tank, known).rate("temperature"), Expr)


def test_a_family_can_be_pickled(tank: ModelFamily) -> None:
    again = pickle.loads(pickle.dumps(tank))
    assert at(again).rate("level") == at(tank).rate("level")


def test_a_delay_may_depend_on_the_commands_before_and_after() -> None:
    text = SMALL.replace(
        "room: {value: 20 degC}",
        "room: {value: 20 degC, delay: dead + (after - before)*slope}",
    ).replace(
        "parameters:",
        "parameters:\n"
        "  dead: {value: 2 s, bounds: [0 s, 9 s]}\n"
        "  slope: {value: 1 s/K, bounds: [0 s/K, 9 s/K]}",
    )
    family = parse_family(text)
    delay = family.inputs[0].delay
    assert delay is not None
    values = {p.name: p.value for p in family.parameters}
    assert delay(Scope(family, values), 290.0, 293.0) == pytest.approx(5.0)


def test_the_standard_record_always_has_a_switch_at_time_zero(tank: ModelFamily) -> None:
    record = tank.standard_record
    assert record is not None
    assert (record.times[0], record.times[-1], len(record.times)) == (0.0, 1500.0, 301)
    assert record.switches[0] == (0.0, {"inflow": pytest.approx(5e-5)})
    later = parse_family(
        SMALL
        + "standard_record: {duration: 1 h, rate: 0.1 Hz, switches: [{at: 1 min, set: {room: 30 degC}}]}"
    ).standard_record
    assert later is not None
    assert later.switches == ((0.0, {}), (60.0, {"room": pytest.approx(303.15)}))


def test_the_schema_accepts_what_the_reader_accepts() -> None:
    from jsonschema import Draft202012Validator

    schema = json_schema(FamilyFile, title="rigctl family")
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for text in (TEXT, SMALL):
        assert [error.message for error in validator.iter_errors(parse_document(text).data)] == []
    assert list(validator.iter_errors(parse_document(SMALL.replace("rate:", "rates:")).data))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        # places and nearest names
        ("states:", "sates:", "tank.yaml:2:1: unknown field, got 'sates'"),
        ("rate: (room", "rate: (rom", "tank.yaml:6:11: unknown name, got 'rom'; did you mean 'room'?"),
        ("formula: heat", "formula: heet", "did you mean 'heat'?"),
        ("/time", "/tme", "did you mean 'time'?"),
        # dimensions
        (
            "rate: (room - heat)/time + warmth",
            "rate: (room - heat)/(1 m) + 0*warmth*time/(1 m)",
            "the rate of heat is a quantity in m^-1 K [m^-1 K], got",
        ),
        ("+ warmth", "+ warmth*time", "cannot add"),
        ("{unit: K/min}", "{unit: W}", "cannot add"),
        ("{unit: degC, form", "{unit: bar, form", "the formula of heat is a temperature [K], got 'heat'"),
        ("{unit: degC, formula", "{unit: K, formula", "expected a temperature difference"),
        ("value: 20 degC", "value: 20 bar", "cannot subtract"),
        ("bounds: [1 min, 2 h]", "bounds: [1 min, 2 m]", "wrong dimension, got '2 m'"),
        ("scale: 0.1 K", "scale: 0.1 s", "wrong dimension, got '0.1 s'"),
        ("unit: degC", "unit: degreC", "unknown unit"),
        # numbers
        ("value: 10 min", "value: 3 h", "the value is out of bounds, got '3 h'; expected 1 min to 2 h"),
        ("bounds: [1 min, 2 h]", "bounds: [2 h, 1 min]", "the bounds leave no room"),
        ("scale: 0.1 K", "scale: 0 K", "the scale must be greater than zero"),
        # names
        ("family: cup", "family: Cup", "tank.yaml:1:9"),
        ("time:", "room:", "tank.yaml:10:3: this name is already one of the inputs, got 'room'"),
        ("warmth:", "exp:", "this name has a meaning of its own, got 'exp'"),
        ("warmth:", "total:", "this name has a meaning of its own, got 'total'"),
        # unused declarations
        (" + warmth", "", "tank.yaml:12:3: no equation uses this, got 'warmth'"),
        ("/time", "/(1 s)", "tank.yaml:10:3: no equation uses this, got 'time'"),
        # no slope, no value
        ("(room - heat)/time", "sqrt((heat - 60 degC)*(1 K))/time", "no slope in heat at heat = 333.15"),
        ("(room - heat)/time", "(1 K)*log((heat - 61 degC)/(1 K))/time", "heat has no value at"),
        # branches
        ("(room - heat)/time", "abs(room - heat)/time", "Write absolute(x, width)"),
        ("(room - heat)/time", "max(room - heat, 0 K)/time", "Write positive_part(x, width) for max(x, 0)"),
        ("(room - heat)/time", "(1 K)*(room > heat)/time", "Write smooth_step"),
        ("(room - heat)/time", "heat if room > heat else room", "a formula may not branch: 'if'"),
        # nothing runs
        ("(room - heat)/time", "__import__('os').system('true')", "this has no place in an expression"),
        ("(room - heat)/time", "room.real/time", "this has no place in an expression"),
        ("(room - heat)/time", "$room/time", "variables with a dollar belong to procedures"),
        # slots
        ("{unit: K/min}", "{unit: K/min, combine: product}", "a factor has no unit, got 'K/min'"),
        ("{unit: K/min}", "{unit: K/min, kind: senor}", "expected"),
    ],
)  # fmt: skip
def test_a_mistake_is_reported_with_its_place(old: str, new: str, said: str) -> None:
    message = changed(old, new)
    assert said in message
    assert message.startswith("tank.yaml:")


def test_circular_definitions_are_refused_with_their_names() -> None:
    text = SMALL + "definitions:\n  a: {unit: K, formula: b}\n  b: {unit: K, formula: a}\n"
    assert refused(text) == "tank.yaml:16:25: an equation depends on itself: a -> b -> a"


def test_all_mistakes_are_reported_together() -> None:
    message = changed(
        "(room - heat)/time + warmth", "room/time + wamth", SMALL.replace("unit: degC", "unit: bar")
    )
    assert message.count("tank.yaml:") == 2


def test_the_standard_record_is_checked_against_the_names() -> None:
    record = "standard_record: {duration: 1 h, rate: 1 Hz, switches: [{at: 0 s, set: {rom: 1 degC}}]}"
    assert "unknown input, got 'rom'; did you mean 'room'?" in refused(SMALL + record)
    assert "wrong dimension" in refused(SMALL + record.replace("rom: 1 degC", "room: 1 s"))
    assert "out of order, or after the end" in refused(SMALL + record.replace("at: 0 s", "at: 2 h"))
    assert "too many samples" in refused(SMALL + record.replace("1 Hz", "1 kHz"))


def test_the_name_of_an_existing_family_is_refused() -> None:
    with pytest.raises(RigctlError, match=r"tank\.yaml:1:9: there is a model family of this name already"):
        parse_family(SMALL.replace("cup", "heater_board"), PATH, FAMILIES)


#: text that people and programs leave in a file by accident
SPLINTERS = [
    "", " ", ":", "- ", "{", "}", "[", "]", "$", "0", "-1", "1e999", "nan", ".inf", "true", "null", "~", "*a",
    "!!python/object:os.system ", "\t", "'", "%", "°C", "30 bar", "level", "((((", "^^", "^", "/", "*", "0/0",
    "and", "not ", "<", "\u0000", "\n", "😀", "x" * 300, "9" * 400, "? ", "<<: ", "|", ">", "exp(",
]  # fmt: skip


@settings(max_examples=150)
@given(st.sampled_from([TEXT, SMALL]), st.integers(0, 2**32), st.integers(1, 4))
def test_any_file_gives_a_family_or_a_clear_error(text: str, seed: int, count: int) -> None:
    chance = random.Random(seed)
    for _ in range(count):
        start = chance.randrange(len(text) + 1)
        end = start + chance.choice((0, 0, 1, 5, 40))
        text = text[:start] + chance.choice(SPLINTERS) + text[end:]
    try:
        assert isinstance(parse_family(text, PATH), ModelFamily)
    except RigctlError as error:
        assert str(error)
        assert "pydantic" not in str(error).casefold()
