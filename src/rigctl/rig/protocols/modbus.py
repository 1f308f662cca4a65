"""A device with Modbus registers: the address, encoding and meaning of each number.

In: the section `modbus` of a rig file. Out: the blocks of registers that one request reads, for the
client that holds pymodbus, and the line protocol by which a run operates that client.

A request costs a round trip, however many registers it reads: adjacent ones of one table and one interval
are read together, up to what the standard allows, and over unused registers only if the file permits it
(`read_gaps`). An output is read back where it is written unless the file says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field, FiniteFloat

from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.actuator import Actuator
from rigctl.rig.base import RigFilePart
from rigctl.rig.protocols.client_lines import Every, Positions, Tries, client_lines
from rigctl.rig.protocols.lines import WATCHDOG, Lines, Watchdog

_Seconds = Annotated[float, Q("s", positive=True)]
Table = Literal["coil", "discrete", "input", "holding"]
NumberType = Literal["bool", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
Order = Literal["big", "little"]

#: number of 16-bit registers by type
WIDTHS: Mapping[str, int] = {
    "bool": 1,
    "int16": 1,
    "uint16": 1,
    "int32": 2,
    "uint32": 2,
    "float32": 2,
    "int64": 4,
    "uint64": 4,
    "float64": 4,
}
BITS = ("coil", "discrete")  #: tables of single bits
WRITABLE = ("coil", "holding")
#: largest number of values in one request, according to the standard
_LONGEST = {"coil": 2000, "discrete": 2000, "input": 125, "holding": 125}


class Register(RigFilePart):
    """Place and format of a number."""

    table: Table = Field(description="coil, discrete (input), input (register) or holding (register)")
    address: int = Field(ge=0, le=65535, description="as transmitted, from 0; 40001 in a manual is holding 0")
    type: NumberType | None = Field(
        default=None,
        description="type of the number; by default bool for a coil or discrete input, otherwise uint16",
    )
    byte_order: Order | None = Field(default=None, description="order within a register, if different")
    word_order: Order | None = Field(default=None, description="order of the registers, if different")
    scale: FiniteFloat = Field(default=1.0, description="the number in its unit is register * scale + offset")
    offset: FiniteFloat = Field(default=0.0, description="see scale")
    invalid: int | None = Field(
        default=None, description="the number that marks a missing value, e.g. -32768"
    )

    @property
    def number_type(self) -> NumberType:
        """The data type, or the default if the file states none."""
        return self.type or ("bool" if self.table in BITS else "uint16")

    @property
    def end(self) -> int:
        """The address after its last register."""
        return self.address + WIDTHS[self.number_type]


class ReadRegister(Register):
    """A number read for a channel."""

    every: Every = None


class IdentityRegister(Register):
    """A number that identifies the device."""

    equals: FiniteFloat = Field(description="the expected number; any other means a different device")


class Heartbeat(Register):
    """A register that rigctl increments while running, for a device that switches off when it stops."""

    every: _Seconds = Field(default=0.5, description="interval between two counts")


class WrittenRegister(Register):
    """A number written for an actuator."""

    values: Positions = None
    readback: Register | bool = Field(
        default=True,
        description="where its state is read with each sample: true: where it is written; false: not read",
    )


class Modbus(RigFilePart):
    """A device on Modbus TCP, or RTU on a serial line."""

    unit: int = Field(
        default=1, ge=0, le=255, description="the unit number of the device on its line or gateway"
    )
    frame: str = Field(
        default="8E1", pattern="^8[NEO][12]$", description="for RTU: data bits, parity, stop bits"
    )
    byte_order: Order = Field(default="big", description="order of the two bytes of a register")
    word_order: Order = Field(default="big", description="order of the registers of a longer number")
    timeout: Annotated[float, Q("s", low="0.02 s", high="5 s")] = Field(
        default=0.3, description="how long an answer may take"
    )
    tries: Tries = 2
    wake: _Seconds = Field(default=3.0, description="how long it may be silent after connecting")
    read_gaps: int = Field(
        default=0, ge=0, le=100, description="number of unused registers that may be included in one request"
    )
    fastest: Annotated[float, Q("Hz", positive=True)] | None = Field(
        default=None, description="the highest possible sampling rate"
    )
    identify: IdentityRegister | None = Field(default=None, description="read first")
    channels: dict[Name, ReadRegister] = Field(description="where each channel is read")
    actuators: dict[Name, WrittenRegister] = Field(
        default_factory=dict, description="where each driven actuator is written"
    )
    heartbeat: Heartbeat | None = Field(default=None, description="written again and again")
    watchdog: Watchdog = WATCHDOG

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks of registers to be read, in as few requests as possible."""
        return tuple(_blocks(self))

    def identity(self) -> str:
        """The client's answer to ``identify``."""
        known = "" if self.identify is None else f" is {self.identify.equals:g}"
        return f"modbus unit {self.unit}{known}"

    def in_lines(self, actuators: Mapping[str, Actuator]) -> Lines:
        """Return the line protocol of its client, `rigctl.backends.modbus.client`."""
        return client_lines(
            self,
            actuators,
            identity=self.identity(),
            reads=[(tuple(block.registers), block.every) for block in self.blocks],
        )


@dataclass(frozen=True)
class Block:
    """Adjacent registers that one request reads, with the names of their numbers.

    Parameters
    ----------
    every: shortest interval between two requests, s; None: one for every sample.
    """

    table: Table
    address: int
    count: int
    every: float | None
    registers: Mapping[str, Register]


def _blocks(modbus: Modbus) -> Iterator[Block]:
    """Yield the groups of adjacent registers that have the same table and the same interval."""
    read: dict[tuple[Table, float | None], list[tuple[Register, str]]] = {}
    for name, channel in modbus.channels.items():
        read.setdefault((channel.table, channel.every), []).append((channel, name))
    for name, part in modbus.actuators.items():
        state = part if part.readback is True else part.readback
        if isinstance(state, Register):
            read.setdefault((state.table, None), []).append((state, name))
    for (table, every), registers in read.items():
        held: dict[str, Register] = {}
        first = end = 0
        for register, name in sorted(registers, key=lambda one: one[0].address):
            far = register.address > end + modbus.read_gaps or register.end - first > _LONGEST[table]
            if held and far:
                yield Block(table, first, end - first, every, held)
                held = {}
            if not held:
                first = end = register.address
            held[name], end = register, max(end, register.end)
        yield Block(table, first, end - first, every, held)
