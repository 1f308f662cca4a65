"""Rig files with several devices: who belongs to which, and every mistake in that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commands import call
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig

GOOD = """\
name: two
devices:
  daq: {kind: serial, port: /dev/ttyACM0, options: {inputs: [a]}}
  supply: {kind: modbus, port: 10.0.0.7, modbus: {channels: {b: {table: input, address: 0}}}}
channels:
  a: {device: daq, unit: V, quantity: voltage}
  b: {device: supply, unit: V, quantity: voltage}
limits:
  high: {channel: b, above: 5 V}
"""


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            "a: {device: daq, ",
            "a: {",
            "6:3: nothing says which device 'a' belongs to",
        ),
        ("device: supply", "device: suply", "unknown device, got 'suply'; did you mean 'supply'?"),
        ("b: {device: supply", "b: {device: daq", "no channel and no actuator belongs to this device"),
        ("/dev/ttyACM0", "10.0.0.7", "'daq' is at this address already"),
        ("devices:", "backend: {kind: serial}\ndevices:", "one backend or several devices"),
        ("kind: serial", "kind: replay", "3:15: kind: unknown kind of backend, got 'replay'"),
        ("kind: serial, ", "", "3:8: the field 'kind' is missing"),
        (
            "port: 10.0.0.7",
            "port: 10.0.0.7, lost: continue",
            "4:48: lost: a run cannot go on without 'supply': limit 'high' needs b, got 'continue'; "
            "expected stop or pause",
        ),
        (
            "port: 10.0.0.7",
            "port: 10.0.0.7, back_within: 9 s",
            "a run only waits with 'lost: pause', not 'stop'",
        ),
        ("b: {table", "c: {table", "4:62: unknown channel, got 'c'"),
        ("kind: modbus", "kind: opcua", "4:11: nothing says where its nodes are"),
        ("address: 0", "address: 0, count: 1", "4:92: unknown field, got 'count'"),
    ],
)
def test_mistakes_are_named_with_their_place(before: str, after: str, said: str) -> None:
    assert before in GOOD
    with pytest.raises(RigctlError) as caught:
        parse_rig(GOOD.replace(before, after))
    assert said in str(caught.value)


EDGE = """\
actuators:
  trigger: {device: daq, kind: switch}
  level: {device: daq, kind: level, unit: V, low: 0 V, high: 5 V, max_rate: 1 V/s}
  knob: {kind: switch, by: operator}
safe_state: {trigger: off, level: 0 V}
align: {actuator: trigger, to: on, channels: [a, b], hold: 2 s, repeats: 20}
"""


def test_an_edge_that_devices_see_is_read() -> None:
    stated = parse_rig(GOOD + EDGE).align
    assert stated is not None
    assert (stated.actuator, stated.to, stated.channels) == ("trigger", 1.0, ("a", "b"))
    assert (stated.hold, stated.repeats) == (2.0, 20)
    assert parse_rig(GOOD).align is None
    assert all(part.align is None for part in parse_rig(GOOD + EDGE).parts.values())


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("actuator: trigger", "actuator: triger", "unknown actuator, got 'triger'; did you mean 'trigger'?"),
        ("actuator: trigger, to: on", "actuator: level, to: 3 V", "this output has a max_rate"),
        ("actuator: trigger", "actuator: knob", "this output is set by hand, and makes no edge, got 'knob'"),
        ("to: on", "to: off", "15:32: this is its safe state, got 'off'"),
        ("to: on", "to: extend", "15:32: unknown position, got 'extend'"),
        ("[a, b]", "[a, d]", "unknown channel, got 'd'"),
        ("[a, b]", "[a, a]", "a is of the same device, got 'a'; expected one channel of daq"),
        ("[a, b]", "[]", "channels"),
        ("hold: 2 s", "hold: 0 s", "must be greater than zero"),
        ("repeats: 20", "repeats: 1", "repeats"),
    ],
)
def test_an_edge_that_is_none_is_refused(before: str, after: str, said: str) -> None:
    head, _, align = EDGE.partition("align:")
    assert before in align
    with pytest.raises(RigctlError) as caught:
        parse_rig(GOOD + head + "align:" + align.replace(before, after))
    assert said in str(caught.value)


def test_one_device_has_nothing_to_align(small: str) -> None:
    with pytest.raises(RigctlError, match="a bench with one device has nothing to align"):
        parse_rig(small + "align: {actuator: heater, to: on, channels: [temperature]}\n")


def test_a_rig_with_one_device_names_none() -> None:
    text = "name: one\nbackend: {kind: serial}\nchannels:\n  a: {device: daq, unit: V, quantity: voltage}\n"
    with pytest.raises(RigctlError, match="the rig names no devices"):
        parse_rig(text)


def test_two_units_behind_one_gateway_are_two_devices() -> None:
    unit = "{kind: modbus, port: 10.0.0.7, modbus: {unit: 2, channels: {a: {table: input, address: 0}}}}"
    text = GOOD.replace("{kind: serial, port: /dev/ttyACM0, options: {inputs: [a]}}", unit)
    assert list(parse_rig(text).parts) == ["daq", "supply"]


def test_each_part_has_what_belongs_to_its_device() -> None:
    rig = load_rig(shipped("rigs", "oil-circuit-devices.yaml"))
    assert rig.kind == "devices"
    parts = rig.parts
    assert {name: tuple(part.channels) for name, part in parts.items()} == {
        "controller": ("oil_temperature",),
        "plant": ("supply_pressure",),
        "meter": ("line_temperature",),
    }
    assert {name: tuple(part.safe_state) for name, part in parts.items()} == {
        "controller": ("heater",),
        "plant": ("relief_valve",),
        "meter": ("cooler",),
    }
    assert [tuple(part.limits) for part in parts.values()] == [("oil_too_hot",), ("over_pressure",), ()]
    assert parts["controller"].roles.heat is not None
    assert parts["plant"].roles.heat is None
    assert [rig.silence_limit(name, 20.0) for name in parts] == [1.0, 3.0, 1.0]
    assert [rig.rate_of(name, 30.0) for name in parts] == [30.0, 10.0, 20.0]
    one = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
    assert one.parts == {"": one}


@pytest.mark.parametrize("command", ["simulate", "run"])
def test_one_plant_stands_for_all_devices(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples are those of one device, also on the emulated board's plant: whole rows at one time."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    options = ("--backend", "simulated", "--speed", "max") if command == "run" else ()
    done = call(command, str(shipped("procedures", "oil-circuit-devices.yaml")), *options)
    assert done.exit_code == 0, done.output
    record = open_run("latest").record(0)
    assert all(np.isfinite(values).all() for values in record.channels.values())
    assert np.diff(record.time) == pytest.approx(0.05)
    rig = str(shipped("rigs", "oil-circuit-devices.yaml"))
    shown = call("monitor", "--rig", rig, "--backend", "simulated", "--speed", "max", "--count", "3")
    assert shown.exit_code == 0, shown.output
