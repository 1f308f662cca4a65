"""Backends by name; each is imported when it is chosen, and not before."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from rigctl.backends.protocol import Backend
from rigctl.clock import Clock
from rigctl.errors import unknown_name
from rigctl.rig import Rig

#: name on the command line -> module whose ``create(rig, clock, options)`` makes it
_MODULES: Mapping[str, str] = {
    "emulated": "rigctl.backends.emulated.create",
    "replay": "rigctl.backends.replay.create",
    "serial": "rigctl.backends.serial_port",
    "simulated": "rigctl.backends.simulated.create",
}


def backend_names() -> tuple[str, ...]:
    """The names that `create_backend` knows."""
    return tuple(_MODULES)


def create_backend(
    rig: Rig, choice: str | None, clock: Clock, options: Mapping[str, object] | None = None
) -> Backend:
    """Make the backend called `choice`, or the rig file's own when `choice` is None; opens nothing yet.

    Parameters
    ----------
    rig: the bench's description.
    choice: one of `backend_names`.
    clock: the clock that the backend waits on.
    options: what the command line says; each backend's ``create`` lists those it knows. The rig file's own
        options hold where the command line is silent, for the kind of backend that they were written for.

    Raises
    ------
    RigctlError
        there is no such backend, or an option is unknown or wrong.
    """
    name = choice or rig.backend.kind
    if name not in _MODULES:
        raise unknown_name("backend", name, _MODULES)
    from_rig = rig.backend.options if name == rig.backend.kind else {}
    create = import_module(_MODULES[name]).create
    backend: Backend = create(rig, clock, {**from_rig, **(options or {})})
    return backend
