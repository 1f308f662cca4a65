"""Backends by name; each is imported only when it is selected."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError, unknown_name
from rigctl.rig import Rig

#: name on the command line -> module whose ``create(rig, clock, options)`` makes it
_MODULES: Mapping[str, str] = {
    "emulated": "rigctl.backends.emulated.create",
    "modbus": "rigctl.backends.modbus.create",
    "opcua": "rigctl.backends.opcua.create",
    "replay": "rigctl.backends.replay.create",
    "serial": "rigctl.backends.serial_port",
    "simulated": "rigctl.backends.simulated.create",
    "visa": "rigctl.backends.visa.create",
}


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
    backend: Backend = import_module(_MODULES[name]).create(rig, clock, settings)
    return backend


def address_of(rig: Rig, port: str | None) -> Address:
    """Return the address of a rig file's device, on the port that `port` or the file names; not opened.

    Raises
    ------
    RigctlError
        the file names no device on a port, or an option is wrong.
    """
    address = address_with(rig, rig.backend_named(), {} if port is None else {"port": port})
    if address is None:
        raise RigctlError(f"the rig '{rig.name}' is on no port", value=rig.backend.kind)
    return address


def address_with(rig: Rig, choice: str | None, options: Mapping[str, object]) -> Address | None:
    """Return the address that `create_backend` would open; None for a backend that is on no port.

    Raises
    ------
    RigctlError
        as `create_backend`.
    """
    name, settings = _chosen(rig, choice, options)
    module = import_module(_MODULES[name])
    address: Address | None = module.address_of(rig, settings) if hasattr(module, "address_of") else None
    return address


def _chosen(
    rig: Rig, choice: str | None, options: Mapping[str, object] | None
) -> tuple[str, dict[str, object]]:
    """Return the name of a backend, and its options."""
    name = choice or rig.backend.kind
    if name not in _MODULES:
        raise unknown_name("backend", name, _MODULES)
    from_rig = rig.backend.options if name == rig.backend.kind else {}
    return name, {**from_rig, **(options or {})}


def other_readings(rig: Rig) -> Iterator[tuple[str, Rig]]:
    """Return the other number formats that the rig file could state, each with the corresponding rig."""
    module = import_module(_MODULES[rig.backend_named()])
    if hasattr(module, "other_orders"):
        yield from module.other_orders(rig)
