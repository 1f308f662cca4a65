"""Backends by name; each is imported only when it is selected."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any

from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError, require_known, unknown_name
from rigctl.plugins import BACKENDS, load_plugin, plugin_names
from rigctl.rig import DEVICES, Rig

#: name on the command line -> module whose ``create(rig, clock, options)`` makes it
_MODULES: Mapping[str, str] = {
    DEVICES: "rigctl.backends.combined.create",
    "emulated": "rigctl.backends.emulated.create",
    "modbus": "rigctl.backends.modbus.create",
    "opcua": "rigctl.backends.opcua.create",
    "python": "rigctl.backends.python.create",
    "replay": "rigctl.backends.replay.create",
    "serial": "rigctl.backends.serial_port",
    "simulated": "rigctl.backends.simulated.create",
    "visa": "rigctl.backends.visa.create",
}


#: backends that stand for a whole bench, whatever its devices are
_WHOLE = ("simulated", "emulated", "replay")


def backend_names() -> tuple[str, ...]:
    """Return the names of the backends."""
    return tuple(_MODULES)


def create_backend(
    rig: Rig, choice: str | None, clock: Clock, options: Mapping[str, object] | None = None
) -> Backend:
    """Make the backend called `choice`, or that of the rig file if `choice` is None; not yet open.

    Parameters
    ----------
    rig: the bench's description.
    choice: one of `backend_names`.
    clock: the clock that the backend waits on.
    options: from the command line; each backend's ``create`` lists those that it accepts. They take
        precedence over those of the rig file, which apply only to the kind of backend that the file names.

    Raises
    ------
    RigctlError
        there is no such backend, or an option is unknown or wrong.
    """
    name, settings = _chosen(rig, choice, options)
    backend: Backend = _module(name).create(rig, clock, settings)
    return backend


def address_of(rig: Rig, port: str | None) -> Address:
    """Return the address of a rig file's device, on the port that `port` or the file names; not opened.

    Raises
    ------
    RigctlError
        the file names no device on a port, or an option is wrong.
    """
    addresses = addresses_with(rig, rig.backend_named(), {} if port is None else {"port": port})
    if not addresses:
        raise RigctlError(f"the rig '{rig.name}' is on no port", value=rig.kind)
    return addresses[""]


def addresses_with(rig: Rig, choice: str | None, options: Mapping[str, object]) -> dict[str, Address]:
    """Return the addresses that `create_backend` would open, by device; none for a backend on no port.

    Raises
    ------
    RigctlError
        as `create_backend`; or two devices are at one address.
    """
    name, settings = _chosen(rig, choice, options)
    if name == DEVICES:
        found = {
            device: address
            for device, part in rig.parts.items()
            for address in addresses_with(part, None, options_of_device(rig, device, settings)).values()
        }
        at: dict[str, str] = {}
        for device, address in found.items():
            # By key, not by text: two spellings of one address are one device, and would command each other's
            # outputs.
            if (other := at.setdefault(address.key, device)) != device:
                raise RigctlError(f"'{other}' and '{device}' are at one address", value=address.url)
        return found
    module = _module(name)
    return {"": module.address_of(rig, settings)} if hasattr(module, "address_of") else {}


def options_of_device(rig: Rig, device: str, options: Mapping[str, object]) -> dict[str, object]:
    """Return the options of one of several devices; `options` may have ``port`` by device, ``clear_trips``.

    Raises
    ------
    RigctlError
        there is no such option, or no such device.
    """
    for name in options:
        if name not in ("port", "clear_trips"):
            raise unknown_name("option of a bench of several devices", name, ("port", "clear_trips"))
    ports = options.get("port", {})
    if not isinstance(ports, Mapping):
        raise RigctlError("the rig has several devices", value=str(ports), expected="NAME=ADDRESS")
    require_known("device", ports, rig.devices)
    chosen: dict[str, object] = {"port": ports[device]} if device in ports else {}
    described = rig.devices[device]
    if options.get("clear_trips") and described.lines is None and described.kind in ("serial", "emulated"):
        chosen["clear_trips"] = True
    return chosen


def _chosen(
    rig: Rig, choice: str | None, options: Mapping[str, object] | None
) -> tuple[str, dict[str, object]]:
    """Return the name of a backend, and its options."""
    name = choice or rig.kind
    if name not in _MODULES and name not in (installed := plugin_names(BACKENDS)):
        raise unknown_name("backend", name, (*_MODULES, *installed))
    if (name == DEVICES) != bool(rig.devices) and name not in _WHOLE:
        has = "several devices" if rig.devices else "one backend"
        raise RigctlError(
            f"the rig '{rig.name}' has {has}", value=name, expected=" or ".join((rig.kind, *_WHOLE))
        )
    # Options of the rig file belong to its own kind of backend: a baud rate means nothing to a simulation.
    from_rig = rig.backend.options if name == rig.kind else {}
    return name, {**from_rig, **(options or {})}


def _module(name: str) -> Any:
    """Return what makes a backend: a module of rigctl, or what an installed package has registered."""
    return import_module(_MODULES[name]) if name in _MODULES else load_plugin(BACKENDS, name)


def other_readings(rig: Rig) -> Iterator[tuple[str, Rig]]:
    """Return the other number formats that the rig file could state, each with the corresponding rig."""
    module = _module(rig.backend_named())
    if hasattr(module, "other_orders"):
        yield from module.other_orders(rig)
