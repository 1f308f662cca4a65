"""A driver of an installed Python package: what is read for each channel, and set for each actuator.

In: the section `python` of a rig file. Out: what the driver's process reads and sets, and the line
protocol by which a run operates that process. Nothing of the package is imported here, or in any process
that runs a procedure.

A rig file may come from a stranger, and names code. It can therefore name only a class of a package that
the user has allowed, and attributes by plain paths, without underscores in front; there are no
expressions. A number is taken in the stated unit, and a driver that states another is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

from pydantic import Field, FiniteFloat

from rigctl.files.name import Name
from rigctl.files.quantity import Q
from rigctl.rig.actuator import Actuator
from rigctl.rig.base import RigFilePart
from rigctl.rig.protocols.client_lines import Every, Tries, client_lines
from rigctl.rig.protocols.lines import WATCHDOG, Lines, Watchdog

_Seconds = Annotated[float, Q("s", positive=True)]

_WORD = r"[A-Za-z][A-Za-z0-9_]*"  # what begins with an underscore is not meant for users of a driver
#: a class of a package: ``package.module:Class``
DRIVER = rf"^{_WORD}(\.[A-Za-z_][A-Za-z0-9_]*)*:{_WORD}(\.{_WORD})*$"
#: an attribute of a driver, of its parts, or of an element of one: ``ch1.voltage``, ``channels[2].voltage``
PATH = rf"^{_WORD}(\[[A-Za-z0-9_]+\])*(\.{_WORD}(\[[A-Za-z0-9_]+\])*)*$"

_Path = Annotated[str, Field(pattern=PATH)]
_Plain = bool | int | float | str

_SPARE = 0.5  # s for the process of the driver to say what came of a call


class DriverCall(RigFilePart):
    """A method of the driver, and its arguments."""

    call: _Path = Field(description="the method, e.g. shutdown, or ch1.off")
    arguments: dict[Name, Any] = Field(default_factory=dict, description="its arguments, by name")


class DriverRead(RigFilePart):
    """What is read for a channel: an attribute, a parameter, a signal, or a method without arguments."""

    get: _Path = Field(description="its name, e.g. voltage, or ch1.voltage")
    item: int | str | None = Field(
        default=None, description="which element of what it returns; without one that must be a number"
    )
    unit: str | None = Field(
        default=None,
        description="the unit of the number that the driver returns; by default that of the channel's raw "
        "values. A driver that states another unit is refused",
    )
    every: Every = None


class DriverSet(RigFilePart):
    """What is set for an actuator, and where its state is read."""

    set: _Path = Field(description="an attribute, a parameter, a signal, or a method with one argument")
    confirm: _Path | None = Field(
        default=None, description="read with each sample; its state must be what was commanded"
    )
    unit: str | None = Field(
        default=None, description="the unit of the number that the driver takes; by default the actuator's"
    )
    scale: tuple[FiniteFloat, FiniteFloat] | None = Field(
        default=None,
        description="for a level: the numbers for its low and high; by default the value in its unit",
    )
    positions: dict[str, _Plain] | None = Field(
        default=None,
        description="for a switch or a directional valve: what the driver takes and returns for its "
        "positions: {off: false, on: true}",
    )
    within: float = Field(
        default=0.0,
        ge=0.0,
        description="by how much the confirmed number may differ from the one that was set: an instrument "
        "rounds",
    )

    @property
    def values(self) -> None:
        """Its positions have their default numbers for the client, which knows what the driver takes."""


class DriverIdentity(RigFilePart):
    """What identifies the device."""

    get: _Path = Field(description="an attribute, a parameter, a signal, or a method without arguments")
    item: int | str | None = Field(default=None, description="which element of what it returns")
    equals: str | None = Field(
        default=None, description="the expected text; any other means a different device"
    )


@dataclass(frozen=True)
class ReadGroup:
    """What is read together: the names of channels and actuators, and their interval, s; None: always."""

    names: tuple[str, ...]
    every: float | None


class PythonDriver(RigFilePart):
    """A driver class of a Python package, which runs in a process of its own."""

    driver: str = Field(
        pattern=DRIVER,
        max_length=300,
        description="the class, e.g. pymeasure.instruments.ohaus:Scout; its package must be allowed, see "
        "rigctl.toml",
    )
    arguments: dict[Name, Any] = Field(
        default_factory=dict,
        description="its arguments, by name; the text {port} in one is replaced by `port` of the backend, "
        "which otherwise is the first argument",
    )
    begin: tuple[DriverCall, ...] = Field(
        default=(), description="called once, after the driver was made, e.g. connect"
    )
    timeout: Annotated[float, Q("s", low="0.05 s", high="60 s")] = Field(
        default=1.0, description="how long each call may take; a driver that takes longer is ended, and lost"
    )
    tries: Tries = 2
    wake: _Seconds = Field(
        default=20.0, description="how long the import of its package and its start may take"
    )
    fastest: Annotated[float, Q("Hz", positive=True)] = Field(
        default=10.0, description="the highest sampling rate"
    )
    identify: DriverIdentity | None = Field(default=None, description="read first")
    channels: dict[Name, DriverRead] = Field(
        default_factory=dict, description="what is read for each channel"
    )
    actuators: dict[Name, DriverSet] = Field(
        default_factory=dict, description="what is set for each driven actuator"
    )
    safe: tuple[DriverCall, ...] = Field(
        default=(),
        description="called first when outputs are made safe; each actuator's safe_state always follows, so "
        "nothing here may disconnect the device",
    )
    watchdog: Watchdog = WATCHDOG

    @property
    def heartbeat(self) -> None:
        """A driver has none."""

    @property
    def package(self) -> str:
        """The package that the user has to allow."""
        return self.driver.partition(":")[0].partition(".")[0]

    @cached_property
    def groups(self) -> tuple[ReadGroup, ...]:
        """What is read, by its interval."""
        found: dict[float | None, list[str]] = {}
        for name, channel in self.channels.items():
            found.setdefault(channel.every, []).append(name)
        for name, part in self.actuators.items():
            if part.confirm is not None:
                found.setdefault(None, []).append(name)
        return tuple(ReadGroup(tuple(names), every) for every, names in found.items())

    def in_lines(self, actuators: Mapping[str, Actuator]) -> Lines:
        """Return the line protocol of its process, `rigctl.backends.python.driver_process`.

        The process of the driver is judged by the time of each call; that of a whole line is only the last
        resort.
        """
        most = max(len(group.names) for group in self.groups) if self.groups else 1
        identity = "" if self.identify is None else ", identity {identity}"
        return client_lines(
            self,
            actuators,
            identity=f"driver {{driver}}, package {{package}}{identity}",
            reads=[(group.names, group.every) for group in self.groups],
            timeout=self.timeout * self.tries * most + _SPARE,
            safe=len(self.safe),
        )
