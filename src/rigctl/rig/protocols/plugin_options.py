"""The options of a backend of another package, for a device that is reached through a protocol library.

The package's backend has a class ``Options``, made of this one; rigctl reads ``backend.options`` of a rig
file with it, with the same checks and messages as for the sections of its own protocols.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field

from rigctl.errors import RigctlError
from rigctl.files.quantity import Q
from rigctl.plugins import BACKENDS, load_plugin
from rigctl.rig.actuator import Actuator
from rigctl.rig.base import RigFilePart
from rigctl.rig.protocols.client_lines import Beating, Positions, Tries, client_lines
from rigctl.rig.protocols.lines import Lines, Watchdog

_Seconds = Annotated[float, Q("s", positive=True)]


class PluginOutput(RigFilePart):
    """What sets an actuator; a package adds where that is, and where its state is read."""

    values: Positions = None


class PluginOptions(RigFilePart):
    """The options of a plug-in's device behind a protocol library; the package adds channels and actuators.

    Its client (`rigctl.backends.transport.client_port.Client`) answers ``identify`` with ``device`` and a
    text, ``read 0`` with the numbers of all channels and then the states of all actuators, and ``write NAME
    VALUE`` with ``ok``, or with ``error`` and the reason.
    """

    timeout: _Seconds = Field(default=1.0, description="how long an answer may take")
    tries: Tries = 2
    wake: _Seconds = Field(default=5.0, description="how long connecting may take")
    fastest: Annotated[float, Q("Hz", positive=True)] | None = Field(
        default=None, description="the highest sampling rate"
    )
    channels: Mapping[str, Any] = Field(description="where each channel is read")
    actuators: Mapping[str, PluginOutput] = Field(
        default_factory=dict, description="what sets each driven actuator"
    )
    watchdog: Watchdog = 3.0

    @classmethod
    def of(cls, given: PluginOptions | None) -> Self:
        """Return the options of a rig file, ``rig.backend.plugin``, as those of this backend.

        Raises
        ------
        RigctlError
            the file is for another kind of backend.
        """
        if not isinstance(given, cls):
            raise RigctlError("the rig file has no options for this backend", expected="'kind' and 'options'")
        return given

    @property
    def heartbeat(self) -> Beating | None:
        """No counter is written for the device."""
        return None

    def client_settings(self, folder: Path) -> dict[str, Any]:
        """Return what the client is given, JSON-compatible: all options.

        A package overrides this to look into a file that its options name, relative to the `folder` of the
        rig file, before the bench is opened.

        Raises
        ------
        RigctlError
            what the options name is not there.
        """
        return self.model_dump()

    def in_lines(self, actuators: Mapping[str, Actuator]) -> Lines:
        """Return the line protocol of its client."""
        names = (*self.channels, *self.actuators)
        return client_lines(self, actuators, identity="device {device}", reads=[(names, None)])


def options_class(kind: str) -> type[PluginOptions] | None:
    """Return the class that reads the options of an installed backend; None if it has none, or another
    class of that name.

    Raises
    ------
    RigctlError
        the package cannot be loaded.
    """
    found = getattr(load_plugin(BACKENDS, kind), "Options", None)
    return found if isinstance(found, type) and issubclass(found, PluginOptions) else None
