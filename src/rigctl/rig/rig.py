"""The bench, as described by a rig file.

In: the fields of the file, each checked by itself here, and together in `rigctl.rig.checks`. Out: what
everything else asks of a bench: its channels, its columns, its limits, its devices, and how fast and how
often they are read.

A rig with several devices is also seen in parts (`parts`), each a rig with one device, so that backends,
checks and interlocks know only one case; and undivided, as a simulation sees it. Copies are made with
`model_copy`, which drops what was computed from the old fields.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, PrivateAttr
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.files.amount import AnyAmount
from rigctl.files.name import Name
from rigctl.files.quantity import Q, reader_schema
from rigctl.notebook import one_line
from rigctl.plugins import BACKENDS, plugin_names
from rigctl.rig.actuator import Actuator
from rigctl.rig.align import Align
from rigctl.rig.base import RigFilePart
from rigctl.rig.channel import Channel
from rigctl.rig.clock import Clock
from rigctl.rig.layout import Layout
from rigctl.rig.limit import Limit
from rigctl.rig.possible_sensors import PossibleChannel
from rigctl.rig.protocols.lines import Lines
from rigctl.rig.protocols.modbus import Modbus
from rigctl.rig.protocols.opcua import OpcUa
from rigctl.rig.protocols.plugin_options import PluginOptions, options_class
from rigctl.rig.protocols.python_driver import PythonDriver
from rigctl.rig.rates import BOARD_RATES, FASTEST
from rigctl.rig.roles import Roles
from rigctl.rig.setting import Setting
from rigctl.rig.simulation import Simulation

#: cached properties, which are computed from the fields and the text of a rig
_WORKED_OUT = ("layout", "sha256", "parts")

#: the kind of a bench of several devices
DEVICES = "devices"


#: s for which a device is looked for whose loss ends the run
_LOOKED_FOR = 30.0

_Rate = Annotated[float, Q("Hz", positive=True, high=f"{FASTEST:g} Hz")]


#: the kinds of devices that rigctl has itself
_KINDS = ("simulated", "serial", "modbus", "visa", "opcua", "python", "emulated")
_KINDS_OF_ONE = (*_KINDS, "replay")


@dataclass(frozen=True)
class _Kind:
    """Reads a kind of backend: one of rigctl's own, or one that an installed package has registered."""

    known: tuple[str, ...]

    def read(self, written: object) -> str:
        """Return the kind.

        Raises
        ------
        RigctlError
            there is none of this name; the entry points are read only then.
        """
        if isinstance(written, str) and written in self.known:
            return written
        installed = plugin_names(BACKENDS)
        if isinstance(written, str) and written in installed:
            return written
        raise unknown_name("kind of backend", str(written), (*self.known, *installed))

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read`; a RigctlError becomes an error of the field."""
        return reader_schema(self.read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text; editors complete rigctl's own kinds."""
        return {"type": "string", "examples": list(self.known)}


class Backend(RigFilePart):
    """The connection to the bench."""

    kind: Annotated[str, _Kind(_KINDS_OF_ONE)] = "simulated"
    port: str | None = Field(
        default=None,
        description="serial port or pyserial URL, e.g. /dev/ttyACM0; host:port of Modbus; a VISA resource; opc.tcp://…",
    )
    baud: int | None = Field(default=None, ge=300, description="bits per second")
    options: dict[str, Any] = Field(
        default_factory=dict, description="further options of this kind of backend"
    )
    lines: Lines | None = Field(
        default=None,
        description="the protocol of a device without rigctl's firmware, on a serial port or behind VISA",
    )
    modbus: Modbus | None = Field(default=None, description="the registers of a Modbus device")
    opcua: OpcUa | None = Field(default=None, description="the nodes of an OPC UA server")
    python: PythonDriver | None = Field(default=None, description="a driver class of a Python package")

    @property
    def client(self) -> Modbus | OpcUa | PythonDriver | PluginOptions | None:
        """The description of a device behind a protocol library; None for any other."""
        return self.modbus or self.opcua or self.python or self.plugin

    @cached_property
    def plugin(self) -> PluginOptions | None:
        """The options of an installed package's backend, as its class reads them; None if it has none."""
        reads = self.plugin_class
        return None if reads is None else reads.model_validate(self.options)

    @property
    def plugin_class(self) -> type[PluginOptions] | None:
        """The class that reads them."""
        return None if self.kind in _KINDS_OF_ONE else options_class(self.kind)


class Device(Backend):
    """One of several devices of a bench, with the same fields as `backend`."""

    kind: Annotated[str, _Kind(_KINDS)] = Field(description="how the device is reached")
    stale_after: Annotated[float, Q("s", positive=True)] | None = Field(
        default=None,
        description="readings older than this are no values, and silence for this time is a fault; by "
        "default `stale_after` of the rig",
    )
    lost: Literal["stop", "pause", "continue"] = Field(
        default="stop",
        description="what the loss of the device does to a run: `stop` ends it safely; `pause` makes outputs "
        "safe, waits until the device is back, and goes on; `continue` goes on without it, where neither a "
        "limit, nor the safe state, nor a step needs it",
    )
    back_within: Annotated[float, Q("s", positive=True)] = Field(
        default=60.0, description="with `lost: pause`, how long the run waits for the device before it ends"
    )


class Rig(RigFilePart):
    """Channels, actuators, constants of the model, limits and the safe state."""

    name: str = Field(min_length=1, description="name of the bench")
    description: str = Field(default="", description="for reports")
    backend: Backend = Field(
        default=Backend(),
        description="the connection to the bench, unless a command gives another",
    )
    devices: dict[Name, Device] = Field(
        default_factory=dict,
        description="the devices of a bench that has several, by name, instead of `backend`",
    )
    model: str | None = Field(
        default=None, description="model family, e.g. hydraulic_cylinder, or a family file"
    )
    oil: str | None = Field(default=None, description="the fluid, e.g. HL32")
    log_format: str | None = Field(
        default=None,
        description="how `rigctl import` reads logs of this bench, unless --mapping says otherwise: a file "
        "written by its --save-mapping, relative to the project",
    )
    channels: dict[Name, Channel] = Field(min_length=1, description="the measured quantities")
    clocks: dict[Name, Clock] = Field(
        default_factory=dict,
        description="clocks of devices or loggers that may be off against the commands'",
    )
    align: Align | None = Field(
        default=None, description="an edge that several devices see, for `rigctl doctor --align`"
    )
    could_have: dict[Name, PossibleChannel] = Field(
        default_factory=dict, description="sensors that could be added"
    )
    actuators: dict[Name, Actuator] = Field(default_factory=dict, description="the outputs")
    roles: Roles = Field(default=Roles(), description="the actuators and channels used by the steps")
    geometry: dict[Name, AnyAmount] = Field(default_factory=dict, description="lengths, areas, volumes")
    constants: dict[Name, AnyAmount] = Field(
        default_factory=dict, description="other parameters of the model"
    )
    options: dict[Name, str] = Field(default_factory=dict, description="variants of the model")
    limits: dict[Name, Limit] = Field(default_factory=dict, description="interlocks")
    safe_state: dict[Name, Setting] = Field(
        default_factory=dict, description="values of all driven actuators in the event of a fault"
    )
    monitor_rate: _Rate = Field(default=10.0, description="sampling rate between records")
    moving_rate: _Rate = Field(
        default=100.0,
        description="sampling rate between records while a directional valve is not in its safe state",
    )
    stale_after: Annotated[float, Q("s", positive=True)] = Field(
        default=1.0,
        description="silence of the bench for this time is a fault, and so is a channel without a value for "
        "it; a device or a channel may have another",
    )
    unattended_for: Annotated[float, Q("s", positive=True)] = Field(
        default=600.0,
        description="longest wait for an answer, with outputs on, while nobody is there (page, server or "
        "terminal gone); the run then ends",
    )
    simulation: Simulation = Field(default=Simulation(), description="the simulated bench")

    _path: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")

    def __repr__(self) -> str:
        """Its name and the numbers of channels and actuators, on one line."""
        return one_line(self, f"{self.name}: {len(self.channels)} channels, {len(self.actuators)} actuators")

    __str__ = __repr__

    def written_in(self, path: Path | None, text: str) -> Rig:
        """Return a copy of this rig with the path and text of its file."""
        copy = self.model_copy()
        copy._path = path  # noqa: SLF001 - an object of the same class
        copy._text = text  # noqa: SLF001
        return copy

    @property
    def path(self) -> Path | None:
        """The file it was read from."""
        return self._path

    @property
    def kind(self) -> str:
        """The kind of backend that the file names; `DEVICES` if it has several devices."""
        return DEVICES if self.devices else self.backend.kind

    @property
    def stated_kind(self) -> str | None:
        """The same; None if the file does not say how the bench is reached."""
        return self.kind if self.devices or "kind" in self.backend.model_fields_set else None

    def backend_named(self) -> str:
        """Return the kind of backend that the file names, which is the default of commands.

        Raises
        ------
        RigctlError
            the file names none; nothing is simulated or moved without a request.
        """
        kind = self.stated_kind
        if kind is None:
            raise RigctlError(
                f"the rig '{self.name}' does not say how its bench is reached",
                expected="'--backend serial' (modbus, visa, opcua, python, emulated, simulated, replay), or "
                "'backend: {kind: serial}' in the rig file",
                where=Location(self.path),
                hint="Nothing is simulated unasked; 'rigctl simulate' does it",
            )
        return kind

    # --- several devices ---------------------------------------------------------------------------------

    @cached_property
    def parts(self) -> Mapping[str, Rig]:
        """The rig of each device by name; of a bench with one device the rig itself, without a name."""
        return {name: _part(self, name) for name in self.devices} or {"": self}

    @property
    def backends(self) -> Sequence[tuple[tuple[str, ...], Backend]]:
        """How its one device, or each of several, is reached, and where the file says so."""
        several = [(("devices", name), one) for name, one in self.devices.items()]
        return several or [(("backend",), self.backend)]

    @property
    def undivided(self) -> Rig:
        """The same bench as one device, as the simulated bench is."""
        return self.model_copy(update={"devices": {}}) if self.devices else self

    def device_of(self, name: str) -> str:
        """Return the device of a channel or actuator; empty with one device, or for the operator."""
        part: Channel | Actuator | None = self.channels.get(name) or self.actuators.get(name)
        return "" if part is None or not self.devices else part.device or ""

    def rate_of(self, device: str, rate: float) -> float:
        """Return how often a device is read, Hz, when the bench is sampled at `rate`."""
        return min(rate, self.parts[device].fastest)

    def stale_after_of(self, channel: str) -> float:
        """Return the age above which a reading is no value, s, as stated nearest to the channel."""
        return self.channels[channel].stale_after or self.parts[self.device_of(channel)].stale_after

    def stale_limit(self, channel: str, rate: float) -> float:
        """Return that age when the bench is sampled at `rate`: a slow rate makes nothing stale."""
        return max(self.stale_after_of(channel), 3.0 / self.rate_of(self.device_of(channel), rate))

    @property
    def tolerated_silence(self) -> float:
        """The time without any reading, s, after which the first of the channels is stale."""
        return min(map(self.stale_after_of, self.channels), default=self.stale_after)

    @property
    def looked_for(self) -> float:
        """How long the one device is looked for after a loss of contact, s.

        A run that waits for it, or goes on without it, decides itself when it ends.
        """
        device = self.backend
        return math.inf if isinstance(device, Device) and device.lost != "stop" else _LOOKED_FOR

    def silence_limit(self, device: str, rate: float) -> float:
        """Return the longest time without a reading of a device, s, when the bench is sampled at `rate`."""
        return max(self.parts[device].tolerated_silence, 3.0 / self.rate_of(device, rate))

    def whose_stale_after(self, channel: str) -> str:
        """Return whose `stale_after` counts for a channel: its name or its device's; empty for the rig's."""
        device = self.device_of(channel)
        if self.channels[channel].stale_after is not None:
            return channel
        return device if device and self.devices[device].stale_after is not None else ""

    @property
    def text(self) -> str:
        """The file's text, which is stored with every run."""
        return self._text

    @cached_property
    def sha256(self) -> str:
        """The hash of the text, as hexadecimal digits."""
        return sha256(self._text.encode("utf-8")).hexdigest()

    @cached_property
    def layout(self) -> Layout:
        """The columns of the bench's samples."""
        return Layout(
            channels=tuple(self.channels),
            commands=tuple(self.actuators),
            units=(
                "s",
                "1",
                *(channel.unit for channel in self.channels.values()),
                *(actuator.display_unit for actuator in self.actuators.values()),
            ),
            differences=frozenset(name for name, channel in self.channels.items() if channel.difference),
        )

    @property
    def lines(self) -> Lines | None:
        """The line protocol of the one device, or of its client; None without one."""
        backend = self.backend
        if backend.lines is None and backend.client is not None:
            return backend.client.in_lines(self.actuators)
        if backend.lines is not None and backend.kind == "visa":
            return backend.lines.of_a_client
        return backend.lines

    @property
    def fastest(self) -> float:
        """The highest sampling rate of the device, Hz; infinite if not stated."""
        return self.fastest_on(self.kind)

    def fastest_on(self, kind: str) -> float:
        """The same with a kind of backend that may be another than the rig's."""
        if kind == DEVICES:  # the slower ones are read less often
            return max(part.fastest for part in self.parts.values())
        device = self.backend.lines or self.backend.client
        if device is None:
            return BOARD_RATES[1] if kind in ("serial", "emulated") else math.inf
        return math.inf if device.fastest is None else device.fastest

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Rig:
        """Return a copy with some fields changed; cached properties are discarded."""
        copy = super().model_copy(update=update, deep=deep)
        for name in _WORKED_OUT:
            copy.__dict__.pop(name, None)
        return copy

    def warnings(self, today: date) -> list[str]:
        """Return the warnings before a run, e.g. that a calibration is out of date."""
        from rigctl.rig.checks import warnings

        return list(warnings(self, today))


def _part(rig: Rig, device: str) -> Rig:
    """Return a rig with one of its devices only, and what belongs to that."""
    described = rig.devices[device]
    channels = {name: one for name, one in rig.channels.items() if one.device == device}
    actuators = {name: one for name, one in rig.actuators.items() if one.device == device}
    own = {*channels, *actuators}
    simulation = rig.simulation.model_copy(
        update={
            "initial": {name: value for name, value in rig.simulation.initial.items() if name in own},
            "scatter": {name: value for name, value in rig.simulation.scatter.items() if name in own},
        }
    )
    return rig.model_copy(
        update={
            "backend": described,
            "devices": {},
            "model": None,
            "channels": channels,
            "clocks": {},
            "align": None,
            "could_have": {},
            "actuators": actuators,
            "roles": rig.roles.within(own),
            "limits": {
                name: limit
                for name, limit in rig.limits.items()
                if limit.channel in own and (limit.while_on is None or limit.while_on in own)
            },
            "safe_state": {name: value for name, value in rig.safe_state.items() if name in own},
            "stale_after": described.stale_after or rig.stale_after,
            "simulation": simulation,
        }
    )
