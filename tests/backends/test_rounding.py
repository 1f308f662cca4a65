"""A number that only looks like the commanded one does not confirm it."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import pytest

from rigctl.backends.lines.line_codec import LineCodec
from rigctl.backends.modbus.numbers import Place
from rigctl.backends.opcua.client import _Item
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from rigctl.rig.protocols.line_pattern import says


def codec() -> LineCodec:
    rig = load_rig(shipped("rigs", "oil-circuit-opcua.yaml"))
    assert rig.backend.opcua is not None
    return LineCodec(rig, rig.backend.opcua.in_lines(rig.actuators))


def node(value: float, scale: float = 1.0) -> tuple[_Item, Any]:
    status = SimpleNamespace(is_good=lambda: True)
    answer = SimpleNamespace(Value=SimpleNamespace(Value=value), StatusCode=status, SourceTimestamp=None)
    return _Item("i=1", scale, 0.0, None, age=False), answer


def float32(value: float) -> list[int]:
    return list(struct.unpack(">HH", struct.pack(">f", value)))


def register(kind: str, scale: float = 1.0) -> Place:
    return Place(
        "holding", 0, kind, swap_bytes=False, swap_words=False, scale=scale, offset=0.0, invalid=None
    )


def texts(number: int) -> list[str]:
    """A whole number as nodes and registers of several types give it."""
    clock: Any = SimpleNamespace(now=None, stands=0.0)
    nodes = [node(float(number)), node(number), node(10 * number, 0.1)]
    return [
        *(item.text(answer, clock) for item, answer in nodes),
        register("float32").text(float32(number)),
        register("int16").text([number]),
        register("int16", 0.1).text([10 * number]),
    ]


@pytest.mark.parametrize(("commanded", "read"), [(5.4, 5), (5.0, 6), (0.0, 1), (5.0, 5), (0.0, 0)])
def test_a_whole_number_read_from_a_node_or_register_is_exact(commanded: float, read: int) -> None:
    meaning, name, bar = codec(), "relief_valve", 1e5
    assert float(meaning.written(name, commanded * bar)) == pytest.approx(commanded)
    for text in texts(read):
        found = meaning.setting(name, text, commanded * bar)
        assert (found == commanded * bar) == (commanded == read), text
        assert says(text, f"{commanded:.9e}") == (commanded == read), text


def test_what_another_node_or_register_has_may_be_rounded_to_its_step() -> None:
    item, answer = node(54, 0.1)
    assert item.repeats(answer, 5.43)
    assert not item.repeats(answer, 5.5)
    assert register("int16", 0.1).repeats([54], 5.43)
    assert not register("int16", 0.1).repeats([54], 5.5)
    assert register("float32").repeats(float32(5.43), 5.43)
    assert not register("float32").repeats(float32(5.0), 5.4)


@pytest.mark.parametrize("answer", ["1", "1.0", "1.000000000000000e+00", "2", "-1"])
def test_the_other_position_of_a_switch_is_no_rounding(answer: str) -> None:
    """Its guard compares texts, as it does not know the rig."""
    assert not says(answer, "0")
    assert says("0", "0")
    assert says("0.000000000000000e+00", "0")
    assert not says("0", "1")
